"""Damaged files of every format are read or refused; and a reader that does neither is found out."""

import os
import signal
from pathlib import Path
from random import Random

import pytest

from tests.studies.__main__ import main
from tests.studies.fuzz.case import Case
from tests.studies.fuzz.outcome import Hang, limited_time
from tests.studies.fuzz.run import Failure, FuzzResult, all_cases, chosen_cases, fuzzed, mutated, save_failure
from vip_factors.errors import InputError

MUTATIONS, QUICK = 2000, 20


def run_fuzz(cases: list[Case], mutations: int, first: int = 0) -> tuple[FuzzResult, list[Failure]]:
    result = FuzzResult()
    return result, list(fuzzed(cases, mutations, first=first, result=result))


@pytest.fixture(scope="module")
def cases() -> list[Case]:
    return all_cases()


def test_damaged_files_of_every_format_are_read_or_refused(cases: list[Case]) -> None:
    quick = [one for one in cases if one.seldom <= QUICK]  # the command takes the others too
    result, failures = run_fuzz(quick, MUTATIONS)
    assert not failures, [(one.case, one.number, one.kind, one.place, one.text[:100]) for one in failures]
    counts = result.read + result.refused
    assert sum(counts.values()) == MUTATIONS
    assert set(counts) == {one.name for one in quick}
    assert sum(result.read.values()) > MUTATIONS / 10
    assert sum(result.refused.values()) > MUTATIONS / 10


def test_a_mutation_is_the_same_again(cases: list[Case]) -> None:
    for case in cases:
        assert mutated(case, Random("0/7")) == mutated(case, Random("0/7"))
    assert len({mutated(cases[0], Random(str(number))) for number in range(20)}) > 10


def picky(folder: Path) -> None:
    content = (folder / "a.txt").read_bytes()
    if b"nan" in content:
        raise KeyError("planted")
    if b"7" not in content:
        raise InputError("a.txt: expected a 7")


def test_a_planted_failure_is_found_once_and_saved(tmp_path: Path) -> None:
    case = Case("planted", {"a.txt": b"x = 7\n", "b.txt": b"kept"}, picky, "read {}/a.txt", sound=("b.txt",))
    result, (failure,) = run_fuzz([case], 300)
    save_failure(failure, tmp_path / "failures")
    assert failure.kind == "KeyError"
    assert result.failed["planted"] > 1
    assert result.refused["planted"] > 0
    (folder,) = (tmp_path / "failures").iterdir()
    assert b"nan" in (folder / "a.txt").read_bytes()
    assert (folder / "b.txt").read_bytes() == b"kept"
    note = (folder / "failure.txt").read_text()
    assert f"read {folder}/a.txt" in note
    assert f"mutation {failure.number} of planted" in note
    again, _ = run_fuzz([case], 1, first=failure.number)
    assert again.failed["planted"] == 1


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


def test_what_takes_too_long_or_too_much_is_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tests.studies.fuzz.outcome.limited_time", lambda: limited_time(0.05))
    for reader, kind in ((endless, Hang), (greedy, MemoryError), (swallowing, MemoryError)):
        _, failures = run_fuzz([Case("one", {"a.txt": b"x"}, reader, "")], 5)
        assert {one.kind for one in failures} == {kind.__name__}


def broken(folder: Path) -> None:
    content = (folder / "a.txt").read_bytes()
    if b"x" not in content:
        os.kill(os.getpid(), signal.SIGSEGV)
    if len(content) > 2:
        raise InputError("a.txt is long")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are not made in this way here")
def test_a_crash_in_a_process_of_its_own_is_a_failure_and_ends_nothing_else() -> None:
    result, failures = run_fuzz([Case("one", {"a.txt": b"x"}, broken, "", apart=True)], 25)
    assert [one.kind for one in failures] == ["SIGSEGV"]
    assert result.refused["one"] > 0
    assert result.failed["one"] + result.refused["one"] + result.read["one"] == 25


def test_formats_are_chosen_by_name(cases: list[Case]) -> None:
    assert [one.name for one in chosen_cases(cases, ["mvnx", "bvh"])] == ["mvnx", "bvh"]
    with pytest.raises(InputError, match=r"unknown format 'mvn': known are .*mvnx"):
        chosen_cases(cases, ["mvn"])


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = ["--out", str(tmp_path / "failures"), "--json", str(tmp_path / "a.json")]
    assert main(["fuzz", "--mutations", "20", "--formats", "coco", "camera-toml", *out]) == 0
    assert "camera-toml" in capsys.readouterr().out
    assert not (tmp_path / "failures").exists()
    assert main(["fuzz", "--mutations", "0", *out]) == 2
