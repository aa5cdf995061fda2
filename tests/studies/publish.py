"""Figures of the documentation: every study behind them, run at one commit, and the pages' tables written from it."""

import json
import os
import platform
import re
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, fields
from datetime import date
from pathlib import Path
from time import perf_counter

from tests.studies.study import Study, Tell, commit_of_sources, markdown, no_news, plain, run, table
from vip_factors.atomic import atomic_open
from vip_factors.cli.options import parse
from vip_factors.errors import InputError

ROOT = Path(__file__).resolve().parents[2]
FIGURES = ROOT / "docs" / "figures.json"
PAGES = (ROOT / "README.md", ROOT / "docs" / "results.md")
BLOCK = re.compile(r"(<!-- figures: ([\w-]+) -->\n).*?(<!-- end of figures -->)", re.DOTALL)
# Part → study and its options. Speed comes last and alone, so that nothing else disturbs its times.
PARTS = {
    "real": "real --data {data}",
    "vip": "vip --motions {motions}",
    "population": "population --simulator {simulator} --motions {motions} --folder {folder}/population "
    "--half neither --standing 30 --jobs 1",
    "gait": "gait --data {data}",
    "repetitions": "repetitions --data {data}",
    "faults": "stream-faults --cameras fixed",
    "kaichi": "kaichi --motions {motions} --imus 13 --seconds 5 --clips 12_02 06_12 02_05 02_07 02_04",
    "speed": "speed --vary wearers sensors cameras --stream",
}
ALONE = ("speed",)
# README's table: data, part, first cell of the row, columns, sentence about the cells' first numbers, paper or peer.
SUMMARY = (
    ("simulated, 13 sensors and a camera: joint position, bone orientation", "vip", "VIP", ("mean",), "{0} mm, {1}°",
     "VIP thesis, on TotalCapture: 26.0 mm, 12.3°"),
    ("30 clips of an independent simulator, only stature known (median)", "population", "tripod 13 t constant",
     ("MPJPE mm", "MPJAE °"), "{0} mm, {3}°", ""),
    ("real walk, 7 Xsens sensors against Vicon: knee flexion RMSE (mean removed)", "real", "xsens_vicon_walk",
     ("knee °",), "{0}° ({1}°)", "Xsens MVN, full body: 5.4° (3.0°)"),
    ("real treadmill, orientations only: knee flexion RMSE (mean removed)", "real",
     "xsens_treadmill_optical, pose declared", ("knee °",), "{0}° ({1}°)", "OpenSense: 12.3° (7.3°)"),
    ("two foot sensors against markers: stride length, median error", "gait", "gaitmap_feet", ("length cm",),
     "{0} cm", "Rampp's method in gaitmap: 3.4 cm"),
    ("live, 13 sensors and a camera: computing time of a frame", "speed",
     "1000 frames, 1 wearers, 0 strangers, 13 sensors, 1 cameras, 1 cores", ("median ms", "99 %"),
     "median {0} ms, p99 {1} ms", ""),
)  # fmt: skip


@dataclass(frozen=True)
class Part:
    """One study's tables.

    Attributes:
        name: as in :data:`PARTS`.
        command: that prints the tables again.
        options: of the study, seeds among them.
        date: on which it ran.
        seconds: that it took.
        tables: Markdown lines.
        commit: at which it ran, if not at that of the file.
    """

    name: str
    command: str
    options: Mapping[str, object]
    date: str
    seconds: float
    tables: tuple[str, ...]
    commit: str = ""


@dataclass(frozen=True, kw_only=True)
class Publish(Study):
    """Run every study whose figures stand in README or results, and write these pages' tables; can be resumed."""

    data: Path
    """Folder with the public recordings."""
    motions: Path
    """Folder of motion capture (BVH)."""
    folder: Path
    """Where simulated scenes are kept between runs."""
    simulator: Path | None = None
    """Program that makes independent scenes; without it, their study is left out."""
    only: tuple[str, ...] = ()
    """Parts to run; all if absent."""
    figures: Path = FIGURES
    """The file of figures. Parts measured at the present commit are kept."""
    processes: int = 2
    """Studies that run side by side, but for those that measure time."""

    def rows(self, tell: Tell) -> Iterator[Part]:
        commit = commit_of_sources()
        parts = {part.name: part for part in _parts(self.figures, commit)}
        self.folder.mkdir(parents=True, exist_ok=True)
        if not parts:  # rows that another commit left
            for path in self.folder.glob("population/rows_*.jsonl"):
                path.unlink()
        missing = [name for name in self.wanted() if name not in parts]
        with ProcessPoolExecutor(self.processes) as pool:
            work = [pool.submit(measure, name, self._words(name)) for name in missing if name not in ALONE]
            for number, result in enumerate(as_completed(work)):
                part = result.result()
                tell(part.name, number / len(missing))
                parts[part.name] = part
                _write(self.figures, commit, parts)
        for name in missing:
            if name in ALONE:
                tell(name, 1 - 1 / len(missing))
                parts[name] = measure(name, self._words(name))
                _write(self.figures, commit, parts)
        write_pages(self.figures)
        yield from parts.values()

    def tables(self, rows: Sequence[Part]) -> Iterator[str]:
        """What was run, and for how long."""
        yield table(["part", "command", "min"], [[part.name, f"`{part.command}`", part.seconds / 60] for part in rows])

    def wanted(self) -> list[str]:
        """Names of the parts to run, in order."""
        unknown = [name for name in self.only if name not in PARTS]
        if unknown:
            raise InputError(f"unknown part '{unknown[0]}': expected some of {', '.join(PARTS)}")
        needs_simulator = [name for name, words in PARTS.items() if "{simulator}" in words]
        if self.simulator is None and set(self.only) & set(needs_simulator):
            raise InputError(f"part '{needs_simulator[0]}' needs --simulator PROGRAM")
        left_out = needs_simulator if self.simulator is None else []
        return [name for name in self.only or PARTS if name not in left_out]

    def _words(self, name: str) -> list[str]:
        places = {key: getattr(self, key) for key in ("data", "motions", "folder", "simulator")}
        return [word.format(**places) for word in PARTS[name].split()]


def measure(name: str, words: Sequence[str]) -> Part:
    """Run one part's study."""
    from tests.studies.__main__ import PROGRAM, study_of

    study = parse(study_of(words[0]), f"{PROGRAM} {words[0]}", list(words[1:]))
    begin = perf_counter()
    tables = markdown(study, run(study, no_news)).rstrip("\n").split("\n")
    options = {field.name: plain(getattr(study, field.name)) for field in fields(study)}
    options = {key: value for key, value in options.items() if isinstance(value, int | float | list) or key == "camera"}
    places = {"data": "DATA", "motions": "DATA/cmu_bvh", "folder": "FOLDER", "simulator": "PROGRAM"}
    command = f"{PROGRAM} {PARTS[name].format(**places)}"
    return Part(name, command, options, date.today().isoformat(), perf_counter() - begin, tuple(tables))


def write_pages(figures: Path = FIGURES, pages: Sequence[Path] = PAGES) -> None:
    """Write the tables of a file of figures into the blocks of pages."""
    for page in pages:
        text = page.read_text(encoding="utf-8")
        written = filled(text, figures)
        if written != text:
            with atomic_open(page, "w", overwrite=True) as file:
                file.write(written)


def filled(text: str, figures: Path = FIGURES) -> str:
    """A page's text with the blocks as a file of figures has them."""
    content = json.loads(figures.read_text(encoding="utf-8"))
    parts = {part["name"]: Part(**part) for part in content["parts"]}

    def block(match: re.Match[str]) -> str:
        name = match[2]
        if name == "source":
            lines = [f"Measured at commit `{content['commit']}` on {content['machine']}."]
        elif name == "summary":
            lines = [summary(parts)]
        elif name in parts:
            part = parts[name]
            commit = f", commit `{part.commit}`" if part.commit else ""
            lines = [f"`{part.command}`, {part.date}{commit}:", "", *part.tables]
        else:
            lines = [f"Not measured at this commit; run `python -m tests.studies publish … --only {name}`."]
        return "\n".join([match[1], *lines, "", match[3]])

    return BLOCK.sub(block, text)


def summary(parts: Mapping[str, Part]) -> str:
    """README's table, from the tables of the parts; a row whose part was not measured is left out."""
    lines = [
        [data, sentence.format(*_numbers(parts[name].tables, row, columns)), peer]
        for data, name, row, columns, sentence, peer in SUMMARY
        if name in parts
    ]
    return table(["data", "vip_factors", "paper or peer"], lines)


def _numbers(tables: Sequence[str], row: str, columns: Sequence[str]) -> list[str]:
    """Numbers in the cells of the first row that begins with a name, in a table that has all the columns."""
    head: list[str] = []
    for line in tables:
        cells = [cell.strip() for cell in line.strip("|").split("|")] if line.startswith("|") else []
        if not cells or not head:
            head = cells
        elif cells[0] == row and set(columns) <= set(head):
            return [number for column in columns for number in re.findall(r"[-\d.]+", cells[head.index(column)])]
    raise InputError(f"no table with a row '{row}' and columns {', '.join(columns)}")


def _parts(path: Path, commit: str) -> Iterator[Part]:
    """Parts of a file of figures that were measured at a commit."""
    if path.exists():
        content = json.loads(path.read_text(encoding="utf-8"))
        if content["commit"] == commit:
            yield from (Part(**part) for part in content["parts"] if not part.get("commit"))


def _write(path: Path, commit: str, parts: Mapping[str, Part]) -> None:
    machine = f"{platform.system()} {platform.machine()}, Python {platform.python_version()}, {os.cpu_count()} cores"
    ordered = [asdict(parts[name]) for name in PARTS if name in parts]
    content = {"commit": commit, "machine": machine, "parts": ordered}
    with atomic_open(path, "w", overwrite=True) as file:
        file.write(json.dumps(content, indent=1, ensure_ascii=False) + "\n")
