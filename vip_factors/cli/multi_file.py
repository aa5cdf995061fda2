"""``smooth`` and ``stream`` over many recordings: an estimate for each, and one table of all.

Estimates that are there are kept, so that a run that was interrupted continues; a recording that cannot be used costs
itself alone. They may be elsewhere: URLs that fsspec reaches (``s3://bucket/walk.mcap``).
"""

import csv
import os
import re
import shutil
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, as_completed
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, fields, replace
from itertools import takewhile
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, cast

from vip_factors.atomic import atomic_open, atomic_path
from vip_factors.cli.options import FAILED as DOUBTED
from vip_factors.cli.options import parse
from vip_factors.cli.terminal import note, progress_bar, say
from vip_factors.cli.workers import run_child, workers
from vip_factors.display import table_cell
from vip_factors.errors import InputError, VipFactorsError
from vip_factors.findings import Severity

ENDINGS = {"smooth": ".estimate.mcap", "stream": ".live.estimate.mcap"}
DONE, THERE, FAILED = "done", "there already", "failed"
GLOB = re.compile(r"[*?\[]")
STREAMS = ("ws", "wss")  # :// of a stream that is no file
RECORDING = re.compile(r"(?!\.).*(?<!\.estimate)(?<!\.partial)\.mcap")


@dataclass(frozen=True)
class Task:
    """A recording, its estimate, and the words of the command that makes it, anew if it may be overwritten."""

    source: Path
    output: Path
    words: tuple[str, ...]
    overwrite: bool


@dataclass(frozen=True)
class Row:
    """Result of one recording.

    Attributes:
        state: done, there already, or failed.
        verdict: GOOD, CARE or DOUBT, and what decides; empty if it is not known.
        frames: number of frames of all wearers.
        seconds: time that the work took.
    """

    input: str
    output: str
    state: str = FAILED
    exit_code: int = 2
    verdict: str = ""
    findings: tuple[str, ...] = ()
    frames: int = 0
    seconds: float = 0.0
    error: str = ""


def is_multi_file(command: str, words: Sequence[str]) -> bool:
    """Whether a command is asked to work on many recordings, or on such that are elsewhere."""
    options = {word.partition("=")[0] for word in words}
    if "--summary" in options or (command != "smooth" and options & {"--jobs", "--cluster"}):
        return True
    return any(map(is_several, _names(words))) or is_url(_taken(words, "--out")[0] or "")


def main(command: str, kind: type[Any], words: Sequence[str]) -> int:
    """Run a command over many recordings, and return the worst exit code; failures are reported, and the others go on.

    Args:
        command: ``smooth`` or ``stream``.
        kind: dataclass of its options.
        words: after the command.

    Raises:
        InputError: for options that do not fit, or where there is nothing to work on.
    """
    names = _names(words)
    out, remaining = _taken(words[len(names) :], "--out")
    options = parse(kind, f"vip-factors {command}", ["some.mcap", *remaining])
    for option in ("--jobs", "--cluster", "--summary", "--fail-on"):
        remaining = _taken(remaining, option)[1]
    files, rows, begun = _files(names, out, ENDINGS[command]), dict[Path, Row](), time.monotonic()
    tasks = [Task(source, output, (command, *remaining), options.overwrite) for output, source in files.items()]
    folder = out or next((name for name in names if Path(name).is_dir()), ".")
    summary = options.summary or Path("." if is_url(folder) else folder) / f"{command}.summary.csv"
    try:
        with workers(options.jobs, options.cluster) as submit, progress_bar() as progress:
            futures: dict[Future[Row], Task] = {submit(work, task): task for task in tasks}
            for future in as_completed(futures):
                task = futures[future]
                try:
                    row = future.result()
                except Exception as error:  # of the cluster: a worker that is lost again and again, say
                    message = f"{type(error).__name__}: {error}"
                    row = Row(str(task.source), str(task.output), exit_code=1, error=message)
                rows[task.output] = row
                if row.error:
                    note(f"note: {row.input}: {row.error}")
                progress(f"{len(rows)} of {len(tasks)} recordings", len(rows) / len(tasks))
    finally:
        if rows:
            write_summary((rows[output] for output in files if output in rows), summary)
    states = [row.state for row in rows.values()]
    counts = ", ".join(f"{states.count(state)} {state}" for state in (DONE, THERE, FAILED))
    say(f"{len(rows)} recordings in {time.monotonic() - begun:.0f} s: {counts}\n{summary}")
    levels = [Severity(row.verdict.partition(",")[0].lower()) for row in rows.values() if row.verdict]
    limit = options.fail_on
    is_bad = limit != "never" and any(level.reaches(Severity(limit)) for level in levels)
    return max([DOUBTED * is_bad, *(row.exit_code for row in rows.values())])


def _files(names: Sequence[str], out: str | None, ending: str) -> dict[Path, Path]:
    """Recordings by the estimates that are made of them."""
    sources = dict[Path, Path]()
    for source, root in recordings(names):
        stem = str(source.relative_to(root)).removesuffix(".mcap")
        output = (root if out is None else location(out)) / (stem + ending)
        if (earlier_source := sources.setdefault(output, source)) != source:
            raise InputError(f"{earlier_source} and {source} would both be written to {output}: give them in two runs")
    if not sources:
        raise InputError(f"no recordings (*.mcap) in {', '.join(names) or 'nothing'}")
    return sources


def write_summary(rows: Iterable[Row], path: Path) -> None:
    """Write the table (.csv), over one that is there."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_open(path, overwrite=True) as file:
        table = csv.DictWriter(file, [field.name for field in fields(Row)])
        table.writeheader()
        for row in rows:
            cells = asdict(row) | {"findings": "; ".join(row.findings), "seconds": f"{row.seconds:.1f}"}
            table.writerow({name: table_cell(str(cell)) for name, cell in cells.items()})


def work(task: Task, is_stopped: Callable[[], bool] = lambda: False) -> Row:
    """Do a task, if its estimate is not there."""
    row, begun = Row(str(task.source), str(task.output)), time.monotonic()
    try:
        with reaching(task.source):
            if not task.overwrite and task.output.exists():
                return replace(row, state=THERE, exit_code=0, **_facts(task.output))
            with TemporaryDirectory(prefix="vip-factors-") as name:
                folder = Path(name)
                words = [*task.words, "--out", str(folder / "made.mcap")]
                words.insert(1, str(fetched(task.source, folder)))
                code, error = run_child(words, folder, is_stopped)
                row = replace(row, exit_code=code, error=error)
                if code == 0:
                    put(folder / "made.mcap", task.output)
                    row = replace(row, state=DONE, **_facts(folder / "made.mcap"))
    except (VipFactorsError, OSError) as failure:
        row = replace(row, error=" ".join(str(failure).split()))
    return replace(row, seconds=time.monotonic() - begun)


def _facts(path: Path) -> dict[str, Any]:
    """Verdict, findings and frames of an estimate's file; nothing of one that is elsewhere or cannot be read."""
    from vip_factors.io.mcap_estimate import read_head

    if isinstance(path, Path):
        with suppress(VipFactorsError, OSError):
            head, frames = read_head(path)
            return {"verdict": str(head.verdict), "findings": tuple(map(str, head.all_findings)), "frames": frames}
    return {}


def _names(words: Sequence[str]) -> list[str]:
    """The words before the first option."""
    return list(takewhile(lambda word: not word.startswith("-"), words))


def _taken(words: Sequence[str], option: str) -> tuple[str | None, list[str]]:
    """The last value of ``--option value`` or ``--option=value``, and the words without it."""
    value, remaining, iterator = None, list[str](), iter(words)
    for word in iterator:
        name, equals, text = word.partition("=")
        if name == option:
            value = text if equals else next(iterator, None)
        else:
            remaining.append(word)
    return value, remaining


def is_url(word: str) -> bool:
    """Whether a word names a file elsewhere."""
    scheme, mark, _ = word.partition("://")
    return bool(mark) and scheme not in STREAMS


def is_several(word: str) -> bool:
    """Whether a word names a folder, a glob or a file elsewhere: no plain file."""
    return is_url(word) or os.path.isdir(word) or (bool(GLOB.search(word)) and not os.path.exists(word))


def location(text: str) -> Path:
    """A path, or a ``UPath``, which has the same methods, behind a URL.

    Raises:
        InputError: for a URL without fsspec, or of a kind that it cannot reach as it is installed.
    """
    if not is_url(text):
        return Path(text)
    try:
        from fsspec import get_filesystem_class
        from upath import UPath

        get_filesystem_class(text.partition("://")[0])  # UPath takes an unknown kind of URL for a path
        path: Any = UPath(text, use_listings_cache=False)
        path.fs  # noqa: B018 - imports the package of this kind of URL
    except (ImportError, ValueError) as error:
        raise InputError(f"{text}: pip install 'vip-factors[cluster]' reads files elsewhere ({error})") from error
    return cast(Path, path)


@contextmanager
def reaching(path: object) -> Iterator[None]:
    """Turn what the library behind a URL raises into one sentence, an :class:`InputError`."""
    try:
        yield
    except (VipFactorsError, OSError):
        raise
    except Exception as error:  # its class is known to a library that may not be installed
        sentence = " ".join(str(error).split())
        raise InputError(f"{path} cannot be reached: {sentence} ({type(error).__name__})") from error


def recordings(words: Sequence[str]) -> Iterator[tuple[Path, Path]]:
    """Recordings that folders, globs and names stand for, each with the folder below which its output keeps its place.

    Raises:
        InputError: if a location cannot be reached.
    """
    for word in words:
        with reaching(word):
            path, star = location(word), GLOB.search(word)
            if star and not path.exists():
                start = word[: star.start()].rfind("/") + 1
                root, pattern = location(word[:start] or "."), word[start:]
            elif path.is_dir():
                root, pattern = path, "**/*.mcap"
            else:  # a file that is not there fails when its turn comes
                yield path, path.parent
                continue
            yield from ((file, root) for file in sorted(root.glob(pattern)) if RECORDING.fullmatch(file.name))


def fetched(path: Any, folder: Path) -> Path:
    """The file itself, or a copy in ``folder`` of one that is elsewhere."""
    if isinstance(path, Path):
        return path
    if not path.exists():
        raise InputError(f"{path}: there is no such file")
    path.fs.get_file(path.path, str(folder / path.name))
    return folder / str(path.name)


def put(file: Path, path: Any) -> None:
    """Copy a file to its place, whole or not at all, as object stores do it."""
    if isinstance(path, Path):
        os.makedirs(path.parent, exist_ok=True)
        with atomic_path(path, overwrite=True) as temporary:
            shutil.copyfile(file, temporary)
    else:
        path.fs.put_file(str(file), path.path)
