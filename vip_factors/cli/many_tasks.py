"""What one command over many files is to do: folders, globs and lists in, a task for each file.

They are here or elsewhere: plain paths, and what fsspec reaches by a URL (``s3://bucket/walk.mcap``).
"""

import glob
import os
import re
import secrets
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

from vip_factors.atomic import atomic_path
from vip_factors.cli.options import FailOn, ManyOptions, options_of, parse
from vip_factors.errors import InputError

# Of these a file appears only once it is whole; elsewhere it is put under another name, and renamed.
WHOLE = ("s3", "s3a", "gs", "gcs", "az", "abfs", "adl")
GLOB = re.compile(r"[*?\[]")
STREAMS = ("ws",)  # :// of a stream that is no file
ESTIMATE = ".estimate.mcap"
NO_RECORDINGS = (ESTIMATE, ".partial.mcap")


@dataclass(frozen=True)
class Many:
    """A command over many files.

    Attributes:
        reads_estimates: whether estimates go in, or else recordings.
        ending: of an output's name, after that of its input.
        output: option that names an output; none if it is told by its place.
        companion: option that names the recording beside an estimate.
    """

    reads_estimates: bool
    ending: str
    output: str = ""
    companion: str = ""

    def takes(self, name: str) -> bool:
        """Whether a file in a folder is one to work on, by its name."""
        if name.startswith(".") or not name.lower().endswith(".mcap"):
            return False
        return name.endswith(ESTIMATE) if self.reads_estimates else not name.endswith(NO_RECORDINGS)


MANY = {
    "smooth": Many(False, ESTIMATE, "--out"),
    "stream": Many(False, f".live{ESTIMATE}", "--out"),
    "evaluate": Many(True, ".json", "--json", "--truth"),
    "export": Many(True, ""),
    "report": Many(True, ".html", "--out", "--recording"),
}


@dataclass(frozen=True, kw_only=True)
class RunOptions(ManyOptions):
    """What is not for the command of each file."""

    out: str | None = None


@dataclass(frozen=True)
class Task:
    """One file, and what is to be made of it.

    Attributes:
        command: of ``vip-factors``.
        source: the file.
        outputs: what it makes.
        words: options of the command.
        companion: the recording of an estimate; empty if there is none.
        texts: content of the settings file, by the option that names it: workers need not see ours.
        overwrite: whether to make anew what is there.
        limit: verdict from which on the exit code is 3.
    """

    command: str
    source: str
    outputs: tuple[str, ...]
    words: tuple[str, ...]
    companion: str = ""
    texts: dict[str, str] = field(default_factory=dict)
    overwrite: bool = False
    limit: FailOn = "never"


def is_many(command: str, words: Sequence[str]) -> bool:
    """Whether a command is asked to work on many files, or on files that are elsewhere; imports nothing."""
    if command not in MANY or any(word in ("-h", "--help") for word in words):
        return False
    names = {word.partition("=")[0] for word in words}
    if "--summary" in names or (command != "smooth" and names & {"--jobs", "--cluster"}):
        return True
    several = any(_is_elsewhere(one) or _is_several(one) for one in leading(words))
    return several or _is_elsewhere(_last_value([*words, ""], "--out", ""))


def leading(words: Sequence[str]) -> list[str]:
    """The words before the first option."""
    count = next((number for number, word in enumerate(words) if word.startswith("-")), len(words))
    return list(words[:count])


def _is_elsewhere(word: str) -> bool:
    scheme, mark, _ = word.partition("://")
    return bool(mark) and scheme not in STREAMS


def _is_several(word: str) -> bool:
    return word.startswith("@") or os.path.isdir(word) or (bool(GLOB.search(word)) and not os.path.exists(word))


def tasks_of(command: str, prog: str, given: Sequence[str], options: RunOptions, rest: Sequence[str]) -> Iterator[Task]:
    """One for each file.

    Raises:
        InputError: if options are not understood, nothing is found, or two files would be written to one.
    """
    kind, formats = MANY[command], [one for one in given if command == "export" and _is_format(one)]
    files = [one for one in given if one not in formats]
    if command == "export" and not formats:
        raise InputError("say what to write of each, by suffixes: vip-factors export FOLDER .bvh .c3d")
    parse(options_of(command), prog, ["some.mcap", *("some" + one for one in formats), *rest])
    companion, rest = _without_folder(rest, kind.companion)
    texts, limit = _settings_text(rest), _last_value(rest, "--fail-on", "never")
    inputs = dict(_expanded(files, kind))  # each once
    if not inputs:
        kinds = f"estimates (*{ESTIMATE})" if kind.reads_estimates else "recordings (*.mcap)"
        raise InputError(f"no {kinds} in {', '.join(files) or 'nothing'}")
    takers: dict[str, str] = {}
    for source, root in inputs.items():
        stem = _below(source, root).removesuffix(".mcap")
        folder = options.out if options.out is not None else root
        outputs = tuple(joined(folder, stem + ending) for ending in formats or [kind.ending])
        for output in outputs:
            if (other := takers.setdefault(output, source)) != source:
                raise InputError(f"{other} and {source} would both be written to {output}: give them in two runs")
        recording = joined(companion or root, stem.removesuffix(".estimate").removesuffix(".live") + ".mcap")
        named = not kind.companion or _last_value(rest, kind.companion, None) is not None
        beside = recording if not named and storage_of(recording).exists() else ""
        yield Task(command, source, outputs, tuple(rest), beside, texts, options.overwrite, limit)


def _is_format(word: str) -> bool:
    return bool(re.fullmatch(r"\.\w+", word)) and not os.path.exists(word)


def _without_folder(words: Sequence[str], option: str) -> tuple[str, list[str]]:
    """The folder of recordings that an option names, and the words without it."""
    folder = _last_value(words, option, "") if option else ""
    if folder.lower().endswith(".mcap") or not (_is_elsewhere(folder) or os.path.isdir(folder)):
        return "", list(words)
    number = next(number for number, word in enumerate(words) if word.partition("=")[0] == option)
    return folder, [*words[:number], *words[number + (1 if "=" in words[number] else 2) :]]


def _last_value(words: Sequence[str], option: str, default: Any) -> Any:
    """What an option is given, as ``--option value`` or ``--option=value``."""
    for number in reversed(range(len(words))):
        name, given, value = words[number].partition("=")
        if name == option:
            return value if given else words[number + 1]
    return default


def _settings_text(words: Sequence[str]) -> dict[str, str]:
    path = _last_value(words, "--settings", None)
    return {} if path is None else {path: Path(path).read_text(encoding="utf-8")}


def _expanded(words: Sequence[str], kind: Many) -> Iterator[tuple[str, str]]:
    """Files, and the folder below which their outputs keep their places."""
    for word in words:
        if word.startswith("@"):
            lines = Path(word[1:]).read_text(encoding="utf-8").splitlines()
            yield from _expanded([line.strip() for line in lines if line.strip() and not line.startswith("#")], kind)
            continue
        place = storage_of(word)
        if GLOB.search(word) and not place.exists():
            root = word[: GLOB.search(word).start()].rpartition("/")[0]  # type: ignore[union-attr]
            root = root or ("/" if word.startswith("/") else ".")
            yield from ((one, root) for one in place.glob() if kind.takes(PurePosixPath(one).name))
        elif place.is_folder():
            yield from ((one, word) for one in place.files() if kind.takes(PurePosixPath(one).name))
        else:  # what is not there is told when its turn comes
            yield word, word.rpartition("/")[0] or "."


def _below(path: str, root: str) -> str:
    return os.path.relpath(path, root) if "://" not in path else path.removeprefix(root.rstrip("/") + "/")


def joined(folder: str, name: str) -> str:
    """The path of a file in a folder, here or behind a URL."""
    return f"{folder.rstrip('/')}/{name}" if "://" in folder else os.path.join(folder, name)


@dataclass(frozen=True)
class Storage:
    """A file, a folder or a glob on this machine, or on a disk that all share.

    Attributes:
        path: as it was given.
    """

    path: str

    def exists(self) -> bool:
        """Whether there is such a file or folder."""
        return os.path.exists(self.path)

    def is_folder(self) -> bool:
        """Whether it is a folder."""
        return os.path.isdir(self.path)

    def files(self) -> list[str]:
        """All files below the folder, sorted."""
        return sorted(os.path.join(top, name) for top, _, names in os.walk(self.path) for name in names)

    def glob(self) -> list[str]:
        """The files that the pattern meets, sorted."""
        return sorted(one for one in glob.glob(self.path, recursive=True) if os.path.isfile(one))

    def fetched(self, folder: Path) -> Path:
        """The file here, in a folder of ours if it was elsewhere."""
        return Path(self.path)

    def put(self, made: Path) -> None:
        """Have a file of ours under this name, whole or not at all."""
        os.makedirs(os.path.dirname(self.path) or ".", exist_ok=True)
        with atomic_path(self.path, overwrite=True) as part:
            shutil.copyfile(made, part)


@dataclass(frozen=True)
class _Elsewhere(Storage):
    """The same behind a URL, which is the path.

    Attributes:
        system: of fsspec.
        inner: path within that.
    """

    system: Any
    inner: str

    def exists(self) -> bool:
        return bool(self.system.exists(self.inner))

    def is_folder(self) -> bool:
        return bool(self.system.isdir(self.inner))

    def files(self) -> list[str]:
        return [self.system.unstrip_protocol(one) for one in sorted(self.system.find(self.inner))]

    def glob(self) -> list[str]:
        return [self.system.unstrip_protocol(one) for one in sorted(self.system.glob(self.inner))]

    def fetched(self, folder: Path) -> Path:
        here = folder / PurePosixPath(self.inner).name
        try:
            self.system.get_file(self.inner, str(here))
        except FileNotFoundError as error:
            raise InputError(f"{self.path}: there is no such file") from error
        return here

    def put(self, made: Path) -> None:
        if self.path.partition("://")[0] in WHOLE:
            self.system.put_file(str(made), self.inner)
            return
        self.system.makedirs(self.inner.rpartition("/")[0], exist_ok=True)
        part = f"{self.inner}.{secrets.token_hex(4)}.part"
        self.system.put_file(str(made), part)
        self.system.mv(part, self.inner)


def storage_of(path: str) -> Storage:
    """Where a path is.

    Raises:
        InputError: for a URL without fsspec, or of a kind that it cannot reach as it is installed.
    """
    if "://" not in path:
        return Storage(path)
    try:
        from fsspec.core import url_to_fs

        system, inner = url_to_fs(path, use_listings_cache=False)
    except (ImportError, ValueError) as error:
        raise InputError(f"{path}: pip install 'vip-factors[cluster]' reads files elsewhere ({error})") from error
    return _Elsewhere(path, system, inner)
