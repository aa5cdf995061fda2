"""Damaged files of every format are read or refused; and a reader that does neither is found out."""

import os
import signal
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from random import Random

import pytest

from tests.studies.__main__ import main
from tests.studies.fuzz.corpus import all_cases
from tests.studies.fuzz.outcome import Hang, Verdict, limited_time
from tests.studies.fuzz.run import Case, Damage, Failure, chosen_cases
from vip_factors.errors import InputError

MUTATIONS, QUICK, OFTEN = 400, 20, 4  # of each case that is damaged less often one


def damage(
    cases: list[Case], numbers: range, out: Path = Path("failures")
) -> tuple[dict[Verdict, Counter[str]], list[Failure]]:
    run = Damage(cases, out)
    return run.counts, [one for one in run.run(numbers) if isinstance(one, Failure)]


@pytest.fixture(scope="module")
def cases() -> list[Case]:
    return [one for one in all_cases() if one.seldom <= QUICK]  # the command takes the others too


def test_damaged_files_of_every_format_are_read_or_refused(cases: list[Case], tmp_path: Path) -> None:
    slow = [one for one in cases if one.seldom > OFTEN]
    runs = [damage([one for one in cases if one not in slow], range(MUTATIONS), tmp_path)]
    runs += [damage([one], range(1), tmp_path) for one in slow]
    failures = [one for _, found in runs for one in found]
    assert not failures, [(one.format, one.number, one.kind, one.place, one.text[:100]) for one in failures]
    read, refused = (sum((counts[each] for counts, _ in runs), Counter()) for each in (Verdict.READ, Verdict.REFUSED))
    assert sum((read + refused).values()) == MUTATIONS + len(slow)
    assert set(read + refused) == {one.name for one in cases}
    assert min(sum(read.values()), sum(refused.values())) > MUTATIONS / 10


@pytest.mark.slow
def test_files_of_every_format_are_read(tmp_path: Path) -> None:
    for case in all_cases():
        damage([Case(case.name, case.make, case.read, "", tuple(sorted(case.files)[1:]))], range(1), tmp_path)


def test_a_mutation_is_the_same_again(cases: list[Case]) -> None:
    for case in cases:
        assert case.damaged(Random("0/7")) == case.damaged(Random("0/7"))
    assert len({cases[0].damaged(Random(str(number))) for number in range(20)}) > 10


def planted(read: Callable[[Path], object], content: bytes = b"x", apart: bool = False) -> Case:
    files = {"a.txt": content, "b.txt": b"kept"}
    return Case("planted", lambda: files, read, "read {}/a.txt", sound=("b.txt",), apart=apart)


def picky(folder: Path) -> None:
    content = (folder / "a.txt").read_bytes()
    if b"nan" in content:
        raise KeyError("planted")
    if b"7" not in content:
        raise InputError("a.txt: expected a 7")


def test_a_planted_failure_is_found_once_and_saved(tmp_path: Path) -> None:
    case = planted(picky, b"x = 7\n")
    counts, (failure,) = damage([case], range(300), tmp_path / "failures")
    assert failure.kind == "KeyError"
    assert counts[Verdict.FAILED]["planted"] > 1
    assert counts[Verdict.REFUSED]["planted"] > 0
    (folder,) = (tmp_path / "failures").iterdir()
    assert folder == failure.folder
    assert b"nan" in (folder / "a.txt").read_bytes()
    assert (folder / "b.txt").read_bytes() == b"kept"
    note = (folder / "failure.txt").read_text()
    assert f"read {folder}/a.txt" in note
    assert f"mutation {failure.number} of planted" in note
    again, _ = damage([case], range(failure.number, failure.number + 1), tmp_path / "again")
    assert again[Verdict.FAILED]["planted"] == 1


def endless(folder: Path) -> None:
    if (folder / "a.txt").read_bytes() != b"x":
        while True:
            pass


def greedy(folder: Path) -> None:
    if (folder / "a.txt").read_bytes() != b"x":
        bytes(3 * 2**30)


def swallowing(folder: Path) -> None:
    try:
        greedy(folder)
    except MemoryError as error:
        raise InputError("a.txt is large") from error


def test_what_takes_too_long_or_too_much_is_a_failure(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("tests.studies.fuzz.outcome.limited_time", lambda: limited_time(0.05))
    for reader, kind in ((endless, Hang), (greedy, MemoryError), (swallowing, MemoryError)):
        _, failures = damage([planted(reader)], range(5), tmp_path)
        assert {one.kind for one in failures} == {kind.__name__}


def broken(folder: Path) -> None:
    content = (folder / "a.txt").read_bytes()
    if b"x" not in content:
        os.kill(os.getpid(), signal.SIGSEGV)
    if len(content) > 2:
        raise InputError("a.txt is long")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are not made in this way here")
def test_a_crash_in_a_process_of_its_own_is_a_failure_and_ends_nothing_else(tmp_path: Path) -> None:
    counts, failures = damage([planted(broken, b"xy", apart=True)], range(25), tmp_path)
    assert [one.kind for one in failures] == ["SIGSEGV"]
    assert counts[Verdict.REFUSED]["planted"] > 0
    assert sum(one["planted"] for one in counts.values()) == 25


def test_the_command_takes_formats_by_name(
    cases: list[Case], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert [one.name for one in chosen_cases(cases, ["mvnx", "bvh"])] == ["mvnx", "bvh"]
    with pytest.raises(InputError, match=r"unknown format 'mvn': known are .*mvnx"):
        chosen_cases(cases, ["mvn"])
    out = ["--out", str(tmp_path / "failures"), "--json", str(tmp_path / "a.json")]
    assert main(["fuzz", "--mutations", "20", "--formats", "coco", "camera-toml", *out]) == 0
    assert "camera-toml" in capsys.readouterr().out
    assert not (tmp_path / "failures").exists()
    assert main(["fuzz", "--mutations", "0", *out]) == 2
