"""Mutate, read, and keep what neither succeeded nor was refused in a sentence."""

import os
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

import numpy as np

from tests.studies.fuzz.mutations import mutated
from tests.studies.fuzz.outcome import Verdict, outcome, outcome_apart
from tests.studies.study import Study, Tell, bullets, no_news, table
from vip_factors.errors import InputError

SECOND_MUTATION = 0.4  # of two in one file: most faults need one, some the second
Files = Mapping[str, bytes]
"""Content by name, with ``/`` between folders."""


@dataclass(frozen=True)
class Case:
    """One format.

    Attributes:
        name: of the format, as ``--formats`` takes it.
        make: makes whole files, small, all of which are read.
        read: what the commands do with them, short of solving; gets their folder.
        command: with which a person repeats it; ``{}`` stands for the folder.
        sound: names of files that are not damaged.
        seldom: how many times as seldom as others it is damaged, where reading takes long.
        apart: read in a process of its own, as native libraries read it that may crash.
    """

    name: str
    make: Callable[[], Files]
    read: Callable[[Path], object]
    command: str
    sound: tuple[str, ...] = ()
    seldom: int = 1
    apart: bool = False

    @cached_property
    def files(self) -> Files:
        return self.make()

    def damaged(self, random: Random) -> tuple[str, bytes]:
        """Name and content of one of its files, damaged once or twice."""
        name = random.choice(sorted(name for name in self.files if name not in self.sound))
        content = self.files[name]
        for _ in range(2 if random.random() < SECOND_MUTATION else 1):
            content = mutated(name, content, random)
        return name, content


@dataclass(frozen=True)
class Failure:
    """The first input of its kind and place that a reader neither read nor refused; its files are in a folder.

    Attributes:
        format: of the file.
        number: of the mutation, with which it is made again.
        kind: type of the exception.
        place: innermost line of this package that it came from.
        text: of the exception.
        folder: with the files, and a note that says how to repeat it.
    """

    format: str
    number: int
    kind: str
    place: str
    text: str
    folder: Path


@dataclass(frozen=True)
class Counts:
    """What became of the mutations of one format."""

    format: str
    read: int
    refused: int
    failed: int


@dataclass(frozen=True, kw_only=True)
class Fuzz(Study):
    """Damage small files of every format, and live streams, thousands of times, and read them.

    Each must be read or refused in a sentence, within 10 s and 2 GB. What is not is kept, with the command that
    repeats it, one of each kind of exception and place in the code.
    """

    mutations: int = 2000
    """How many."""
    seed: int = 0
    """Same seed, same mutations."""
    first: int = 0
    """Number of the first mutation: to repeat a single one, with --mutations 1."""
    out: Path = Path("failures")
    """Folder for files that failed; it is made when there are any."""
    formats: tuple[str, ...] = ()
    """Formats to damage; all if absent."""

    def __post_init__(self) -> None:
        if self.mutations < 1 or self.first < 0:
            raise InputError(f"--mutations {self.mutations}, --first {self.first}: expected at least 1 and 0")

    def rows(self, tell: Tell) -> Iterator[Failure | Counts]:
        from tests.studies.fuzz.corpus import all_cases

        yield from Damage(chosen_cases(all_cases(), self.formats), self.out, self.seed).run(
            range(self.first, self.first + self.mutations), tell
        )

    def tables(self, rows: Sequence[Failure | Counts]) -> Iterator[str]:
        counts = [(row.format, row.read, row.refused, row.failed) for row in rows if isinstance(row, Counts)]
        lines = [*counts, ("all", *np.sum([count[1:] for count in counts] or [(0, 0, 0)], axis=0))]
        yield table(["format", "mutations", "read", "refused", "failed"], [[k, sum(v), *v] for k, *v in lines])
        yield bullets("Neither read nor refused:", (
            f"{row.format} {row.number}: {row.kind} at {row.place}: {row.text[:100]!r}, {row.folder}"
            for row in rows if isinstance(row, Failure)
        ))  # fmt: skip


def chosen_cases(cases: Sequence[Case], names: Sequence[str]) -> list[Case]:
    """Those of the formats named; all if none is."""
    known = [case.name for case in cases]
    for name in names:
        if name not in known:
            raise InputError(f"unknown format '{name}': known are {', '.join(known)}")
    return [case for case in cases if not names or case.name in names]


@dataclass
class Damage:
    """Damages files of the cases, one after the other, and reads them; failures go to the folder ``out``."""

    cases: Sequence[Case]
    out: Path
    seed: int = 0
    counts: dict[Verdict, Counter[str]] = field(default_factory=lambda: {verdict: Counter() for verdict in Verdict})

    def run(self, numbers: range, tell: Tell = no_news) -> Iterator[Failure | Counts]:
        """Each failure that is new, then the counts of each format."""
        known, ready, rates = set[tuple[str, str]](), dict[str, Path](), [1 / case.seldom for case in self.cases]
        with TemporaryDirectory(prefix="vip-factors-fuzz-") as name, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # thousands
            for number in numbers:
                (case,) = Random(f"{self.seed}/{number}").choices(self.cases, rates)
                if case.name not in ready:  # read once as it is, and what is imported late is, before any limit
                    ready[case.name] = Path(name, case.name)
                    write_files(case.files, ready[case.name])
                    case.read(ready[case.name])
                failure = self._attempt(case, ready[case.name], number, known)
                if failure is not None:
                    yield failure
                if number % 50 == 0:
                    tell(f"mutations, {len(known)} faults", (number - numbers.start) / len(numbers))
        for case in self.cases:
            yield Counts(case.name, *(self.counts[verdict][case.name] for verdict in Verdict))

    def _attempt(self, case: Case, folder: Path, number: int, known: set[tuple[str, str]]) -> Failure | None:
        name, content = case.damaged(Random(f"{self.seed}/{number}/{case.name}"))
        (folder / name).write_bytes(content)
        os.utime(folder / name, ns=(number, number))  # readers that know a file again by its time see another one
        try:
            found = (outcome_apart if case.apart else outcome)(lambda: case.read(folder))
        finally:
            (folder / name).write_bytes(case.files[name])
        self.counts[found.verdict][case.name] += 1
        if found.verdict is not Verdict.FAILED or (found.kind, found.place) in known:
            return None
        known.add((found.kind, found.place))
        kept = self.out / f"{case.name}-{number}-{found.kind}"
        write_files({**case.files, name: content}, kept)
        note = (
            f"{found.kind} at {found.place}: {found.text[:500]}\n\nmutation {number} of {case.name}, in {name}\n\n"
            f"{case.command.replace('{}', str(kept))}\n\n{found.trace}"
        )
        (kept / "failure.txt").write_text(note, encoding="utf-8", errors="backslashreplace")
        return Failure(case.name, number, found.kind, found.place, found.text[:500], kept)


def write_files(files: Files, folder: Path) -> None:
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
