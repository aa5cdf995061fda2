"""Mutate, read, and keep what neither succeeded nor was refused in a sentence."""

import os
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

import numpy as np

from tests.studies.fuzz.bytes_and_text import mutated_bytes
from tests.studies.fuzz.case import Case, Files, mutations_of
from tests.studies.fuzz.corpus_estimates import estimate_cases
from tests.studies.fuzz.corpus_filmed import filmed_cases
from tests.studies.fuzz.corpus_logs import log_cases
from tests.studies.fuzz.corpus_models import model_cases
from tests.studies.fuzz.corpus_scenes import scene_cases, solved_cases
from tests.studies.fuzz.corpus_small import small_cases
from tests.studies.fuzz.outcome import Verdict, outcome, outcome_apart
from tests.studies.study import Study, Tell, bullets, no_news, table
from vip_factors.errors import InputError

SECOND_MUTATION = 0.4  # of two in one file: most faults need one, some the second


@dataclass(frozen=True)
class Failure:
    """An input that a reader neither read nor refused.

    Attributes:
        number: of the mutation, with which it is made again.
        case: name of the format.
        kind: type of the exception.
        place: innermost line of this package that it came from.
        text: of the exception.
        files: that were read.
        damaged: name of the damaged one.
        trace: as Python prints it.
        command: with which a person repeats it; ``{}`` stands for the folder of the files.
    """

    number: int
    case: str
    kind: str
    place: str
    text: str
    files: Files
    damaged: str
    trace: str
    command: str


@dataclass
class FuzzResult:
    """Counts by format, and the failures: the first of each kind and place."""

    read: Counter[str] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)
    failed: Counter[str] = field(default_factory=Counter)
    failures: dict[tuple[str, str], Failure] = field(default_factory=dict)


@dataclass(frozen=True)
class Counts:
    """What became of the mutations of one format."""

    format: str
    read: int
    refused: int
    failed: int


@dataclass(frozen=True)
class Fault:
    """The first input of its kind and place that was neither read nor refused; its files are in a folder."""

    format: str
    number: int
    kind: str
    place: str
    text: str
    folder: Path


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

    def rows(self, tell: Tell) -> Iterator[Fault | Counts]:
        tell("making files", 0.0)
        cases, result = chosen_cases(all_cases(), self.formats), FuzzResult()
        for one in fuzzed(cases, self.mutations, self.seed, self.first, tell, result):
            folder = save_failure(one, self.out)
            yield Fault(one.case, one.number, one.kind, one.place, one.text[:500], folder)
        for case in cases:
            counts = (found[case.name] for found in (result.read, result.refused, result.failed))
            yield Counts(case.name, *counts)

    def tables(self, rows: Sequence[Fault | Counts]) -> Iterator[str]:
        counts = [(one.format, one.read, one.refused, one.failed) for one in rows if isinstance(one, Counts)]
        lines = [*counts, ("all", *np.sum([one[1:] for one in counts] or [(0, 0, 0)], axis=0))]
        yield table(["format", "mutations", "read", "refused", "failed"], [[k, sum(v), *v] for k, *v in lines])
        yield bullets("Neither read nor refused:", (
            f"{one.format} {one.number}: {one.kind} at {one.place}: {one.text[:100]!r}, {one.folder}"
            for one in rows if isinstance(one, Fault)
        ))  # fmt: skip


def all_cases() -> list[Case]:
    """One of each format that the commands read.

    Left out on purpose: BlazePose's two models (nothing here can write a small one; a wheel of them is damaged, and
    refused by its sum), WebSocket's handshake and frames (the library's; what its messages hold is in), Rerun files
    (written, never read), the published data sets that studies read, SMPL pickles with chumpy inside, and messages
    between the package's own processes.
    """
    logs = log_cases()
    log = next(one.files for one in logs if one.name == "xsens-txt")
    return [
        *logs, *scene_cases(), *small_cases(), *model_cases(), *filmed_cases(log), *estimate_cases(), *solved_cases()
    ]  # fmt: skip


def chosen_cases(cases: Sequence[Case], names: Sequence[str]) -> list[Case]:
    """Those of the formats named; all if none is."""
    known = [one.name for one in cases]
    for name in names:
        if name not in known:
            raise InputError(f"unknown format '{name}': known are {', '.join(known)}")
    return [one for one in cases if not names or one.name in names]


def fuzzed(
    cases: Sequence[Case], mutations: int, seed: int = 0, first: int = 0, tell: Tell = no_news,
    result: FuzzResult | None = None,
) -> Iterator[Failure]:  # fmt: skip
    """Damage the files of the cases, one after the other, and read them; yields each failure that is new."""
    result = result or FuzzResult()
    with TemporaryDirectory(prefix="vip-factors-fuzz-") as name, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # thousands
        ready: dict[str, Path] = {}
        for number in range(first, first + mutations):
            case = _drawn(cases, Random(f"{seed}/{number}"))
            if case.name not in ready:
                ready[case.name] = _made_ready(case, Path(name, case.name))
            damaged, content = mutated(case, Random(f"{seed}/{number}/{case.name}"))
            failure = _attempt(case, ready[case.name], damaged, content, number, result)
            if failure is not None and (failure.kind, failure.place) not in result.failures:
                result.failures[failure.kind, failure.place] = failure
                yield failure
            if number % 50 == 0:
                tell(f"mutations, {len(result.failures)} faults", (number - first) / mutations)


def _drawn(cases: Sequence[Case], random: Random) -> Case:
    """One of them; those whose reading takes long are drawn seldom."""
    return random.choices(cases, [1 / one.seldom for one in cases])[0]


def _made_ready(case: Case, folder: Path) -> Path:
    """Its files as they are, read once: that must succeed, and what is imported late is imported before any limit."""
    _write(case.files, folder)
    case.read(folder)
    return folder


def mutated(case: Case, random: Random) -> tuple[str, bytes]:
    """Name and content of a file of the case, damaged once or twice."""
    name = random.choice(case.damageable)
    content, mutations = case.files[name], mutations_of(name)
    for _ in range(2 if random.random() < SECOND_MUTATION else 1):
        try:
            content = random.choice(mutations)(content, random)
        except Exception:  # damaged before, so that it cannot be unpacked any more
            content = mutated_bytes(content, random)
    return name, content


def _attempt(case: Case, folder: Path, damaged: str, content: bytes, number: int, result: FuzzResult) -> Failure | None:
    (folder / damaged).write_bytes(content)
    os.utime(folder / damaged, ns=(number, number))  # readers that know a file again by its time see another one
    try:
        found = (outcome_apart if case.apart else outcome)(lambda: case.read(folder))
    finally:
        (folder / damaged).write_bytes(case.files[damaged])
    counts = {Verdict.READ: result.read, Verdict.REFUSED: result.refused, Verdict.FAILED: result.failed}
    counts[found.verdict][case.name] += 1
    if found.verdict is not Verdict.FAILED:
        return None
    files = {**case.files, damaged: content}
    return Failure(
        number, case.name, found.kind, found.place, found.text, files, damaged, found.trace, case.command
    )  # fmt: skip


def _write(files: Files, folder: Path) -> None:
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)


def save_failure(failure: Failure, out: Path) -> Path:
    """A folder with the files, and a note that says how to repeat it; the folder."""
    folder = out / f"{failure.case}-{failure.number}-{failure.kind}"
    _write(failure.files, folder)
    command = failure.command.replace("{}", str(folder))
    note = (
        f"{failure.kind} at {failure.place}: {failure.text[:500]}\n\nmutation {failure.number} of {failure.case}, in "
        f"{failure.damaged}\n\n{command}\n\n{failure.trace}"
    )
    (folder / "failure.txt").write_text(note, encoding="utf-8", errors="backslashreplace")
    return folder
