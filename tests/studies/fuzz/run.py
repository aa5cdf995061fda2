"""Mutate, read, and keep what neither succeeded nor was refused in a sentence."""

import json
import os
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

from tests.studies.fuzz.bytes_and_text import mutated_bytes
from tests.studies.fuzz.case import Case, Files, mutations_of
from tests.studies.fuzz.outcome import Verdict, outcome, outcome_apart
from vip_factors.errors import InputError

SECOND_MUTATION = 0.4  # of two in one file: most faults need one, some the second

Tell = Callable[[str, float], None]


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


def chosen_cases(cases: Sequence[Case], names: Sequence[str]) -> list[Case]:
    """Those of the formats named; all if none is.

    Raises:
        InputError: for a name that no format has.
    """
    known = [one.name for one in cases]
    for name in names:
        if name not in known:
            raise InputError(f"unknown format '{name}': known are {', '.join(known)}")
    return [one for one in cases if not names or one.name in names]


def run_fuzz(
    cases: Sequence[Case],
    mutations: int,
    seed: int = 0,
    first: int = 0,
    tell: Tell = lambda stage, share: None,
    keep: Callable[[Failure], object] = lambda failure: None,
) -> FuzzResult:
    """Damage the files of the cases, one after the other, and read them.

    Args:
        cases: the formats.
        mutations: how many.
        seed: same seed and number, same mutation of a case.
        first: number of the first mutation.
        tell: gets progress.
        keep: gets each failure that is new, as soon as it is found.
    """
    result = FuzzResult()
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
                keep(failure)
            if number % 50 == 0:
                tell(f"mutations, {len(result.failures)} faults", (number - first) / mutations)
    return result


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


def fuzz_table(result: FuzzResult, cases: Sequence[Case]) -> str:
    """Counts by format, then the failures, one line each."""
    lines = [f"{'format':<18}{'mutations':>10}{'read':>8}{'refused':>9}{'failed':>8}"]
    for name in (*(one.name for one in cases), "all"):
        counts = [
            sum(one.values()) if name == "all" else one[name] for one in (result.read, result.refused, result.failed)
        ]
        lines.append(f"{name:<18}{sum(counts):>10}{counts[0]:>8}{counts[1]:>9}{counts[2]:>8}")
    for failure in result.failures.values():
        first = failure.text.splitlines()[0][:100] if failure.text else ""
        lines.append(f"FAILED {failure.case} {failure.number}: {failure.kind} at {failure.place}: {first}")
    return "\n".join(lines) + "\n"


def fuzz_json(result: FuzzResult) -> str:
    """The same as JSON."""
    failures = [
        {"format": one.case, "number": one.number, "kind": one.kind, "place": one.place, "text": one.text[:500]}
        for one in result.failures.values()
    ]
    counts = {"read": result.read, "refused": result.refused, "failed": result.failed}
    return json.dumps({**counts, "failures": failures}, indent=2)
