"""Golden figures: what a rebuilt house must still give, command by command, to a hundredth of a millimetre."""

import json
import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import chdir, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import numpy as np

from tests.studies.study import Study, Tell, columns
from vip_factors.cli.main import main
from vip_factors.errors import InputError

FIGURES = Path(__file__).with_name("golden.json")
TOLERANCE = 1e-5  # of a file's numbers: 0.01 mm; degrees, thousands of units and the like are held to 1e-3
ROWS = 9  # of a table that are kept
NUMBER = re.compile(r"[-+]?\d+\.\d+(?:[eE][-+]?\d+)?")
SCENE = ("--seconds", "8", "--camera")
WINDOWS = ("--windows.above-s", "4", "--windows.window-s", "3", "--windows.overlap-s", "1", "--covariance")
SIMULATED: Mapping[str, Sequence[str]] = {
    "thirteen": ("--seconds", "8"),
    "six": ("--seconds", "8", "--placement", "sip6", "--initial-pose", "t-pose"),
    "no-pose": ("--seconds", "8", "--initial-pose", "none"),
    "tripod": (*SCENE, "fixed", "--known-camera-pose", "True"),
    "carried": (*SCENE, "hand-held", "--time-offset-s", "0.3"),
    "walking": (*SCENE, "walking", "--keypoints", "body25b"),
    "cameras": (*SCENE, "fixed", "--cameras", "2"),
    "crowd": (*SCENE, "fixed", "--also", "gestures", "--bystanders", "1"),
}


@dataclass(frozen=True)
class GoldenRow:
    """One command's outcome beside what it was; differences are the largest of all numbers.

    Attributes:
        case: recording and command.
        numbers: how many were compared.
        difference: in units of the tolerance.
        note: what is not there any more, or new.
    """

    case: str
    numbers: int
    difference: float
    note: str = ""


@dataclass(frozen=True, kw_only=True)
class Golden(Study):
    """The numbers of some thirty commands: batch, windows, live, exports, reports; beside those that were kept.

    The package's own recordings are made on the way. What depends on a processor's rounding differs from machine to
    machine: keep the figures of the last good commit on the same machine, then compare.
    """

    recordings: Path | None = None
    """Folder of further recordings (.mcap), which are smoothed and streamed too."""
    only: str = ""
    """Recordings with this in their name, alone."""
    keep: bool = False
    """Keep these figures instead of comparing."""
    figures: Path = FIGURES
    """Where the figures are kept."""

    def rows(self, tell: Tell) -> Iterator[GoldenRow]:
        if not self.keep and not self.figures.exists():
            raise InputError(f"{self.figures}: no such file; --keep makes it, at a commit that is right")
        kept = json.loads(self.figures.read_text()) if self.figures.exists() else {}
        own = sorted(self.recordings.resolve().glob("*.mcap")) if self.recordings else []
        cases = [name for name in (*SIMULATED, *map(str, own)) if self.only in name]
        for number, case in enumerate(cases):
            tell(Path(case).stem, number / len(cases))
            with tempfile.TemporaryDirectory() as folder, chdir(folder):
                for name, found in _outcomes(case):
                    if self.keep:
                        kept[name] = found
                    yield _compared(name, kept.get(name, {}), found)
        if self.keep:
            self.figures.write_text(json.dumps(kept, indent=0) + "\n")

    def tables(self, rows: Sequence[GoldenRow]) -> Iterator[str]:
        yield columns(
            rows,
            {
                "case": lambda row: row.case,
                "numbers": lambda row: row.numbers,
                "difference / tolerance": lambda row: row.difference,
                "": lambda row: row.note,
            },
        )
        same = all(row.difference <= 1 and not row.note for row in rows)
        yield "all as they were" if same else "**NOT as they were**"


def _outcomes(case: str) -> Iterator[tuple[str, dict[str, list[float]]]]:
    """Numbers of every file that comes out, by command."""
    stem, recording = Path(case).stem, case
    if case in SIMULATED:
        recording = f"{case}.mcap"
        _run("simulate", "gestures", recording, "--seed", "7", *SIMULATED[case])
        yield f"{stem} info", {"text": _numbers(_run("info", recording))}
    for command, options in _commands(case).items():
        estimate = f"{command}.mcap"
        _run(command.split("-")[0], recording, "--out", estimate, *options)
        found = dict[str, list[float]]()
        if case in SIMULATED:
            _run("evaluate", estimate, "--truth", recording, "--json", "evaluation.json", "--overwrite")
            found["evaluation"] = _numbers(Path("evaluation.json").read_text())
        files = [f"{command}.csv"]
        if command == "smooth":
            files += [f"{command}{suffix}" for suffix in (".bvh", ".mot", ".trc")]
        _run("export", estimate, *files)
        for path in sorted(Path().glob(f"{command}*")):
            if path.suffix != ".mcap":
                found[path.name] = _numbers(path.read_text(), sampled=True)
        if command == "smooth":
            _run("report", estimate, "--recording", recording, "--out", "page.html")
            found["report"] = _numbers(_tables(Path("page.html").read_text()))
        yield f"{stem} {command}", found


def _commands(case: str) -> dict[str, Sequence[str]]:
    """What is done with a recording: command, with a word behind the hyphen where there are several; options."""
    commands: dict[str, Sequence[str]] = {"smooth": ("--covariance",), "stream": ()}
    if case in ("thirteen", "carried", "crowd"):
        commands["smooth-windows"] = WINDOWS
    return commands


def _run(*words: str) -> str:
    """What a command prints."""
    with redirect_stdout(StringIO()) as out:
        code = main(list(words))
    if code:
        raise InputError(f"vip-factors {' '.join(words)}: exit code {code}")
    return out.getvalue()


def _tables(page: str) -> str:
    """What stands in the cells of a page's tables and lists, but for how long the solves took."""
    text = re.sub(r"<details><summary>How the computation went.*?</details>", "", page, flags=re.DOTALL)
    return " ".join(re.findall(r"<(?:td|dd)[^>]*>([^<]*)", text))


def _numbers(text: str, sampled: bool = False) -> list[float]:
    """All numbers with a point; of a long table those of a few lines, first and last among them."""
    lines = text.splitlines()
    if sampled and len(lines) > ROWS:
        lines = [lines[index] for index in np.linspace(0, len(lines) - 1, ROWS).astype(int)]
    return [float(f"{float(number):.8g}") for line in lines for number in NUMBER.findall(line)]


def _compared(case: str, kept: Mapping[str, Sequence[float]], found: Mapping[str, Sequence[float]]) -> GoldenRow:
    """Every number beside what it was."""
    worst, notes = 0.0, [f"new: {name}" for name in found if name not in kept]
    for name, before in kept.items():
        now = found.get(name)
        if now is None or len(now) != len(before):
            notes.append(f"{name}: {'absent' if now is None else f'{len(now)} numbers, were {len(before)}'}")
        elif before:
            tolerance = np.maximum(TOLERANCE, 1e-3 * (np.abs(before) > 3))
            worst = max(worst, float((np.abs(np.subtract(now, before)) / tolerance).max()))
    return GoldenRow(case, sum(map(len, found.values())), worst, "; ".join(notes))
