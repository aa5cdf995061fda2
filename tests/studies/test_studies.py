"""The runner: every study says what it can be told, rows are kept as they are made, and files are learned."""

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import pytest

from tests.studies.__main__ import STUDIES, main, study_of
from tests.studies.study import Study, columns, plain, run, table
from vip_factors.body.joint_priors import load_pose_prior
from vip_factors.errors import InputError
from vip_factors.estimate import Estimate, WearerEstimate
from vip_factors.io.export.animation import write_bvh
from vip_factors.io.settings import ExportSettings
from vip_factors.simulate.gestures import gestures


@dataclass(frozen=True)
class Count:
    number: int
    share: float


@dataclass(frozen=True, kw_only=True)
class Counting(Study):
    until: int = 3

    def rows(self, tell: object) -> Iterator[Count]:
        yield from (Count(number, number / 0.0 if number > 2 else np.float64(0.25)) for number in range(self.until))

    def tables(self, rows: Sequence[Count]) -> Iterator[str]:
        yield columns(rows, {"number": lambda one: one.number, "share": lambda one: one.share})


@dataclass(frozen=True, kw_only=True)
class Interrupted(Counting):
    """Stops after two rows."""

    def rows(self, tell: object) -> Iterator[Count]:
        yield from super().rows(tell)
        raise KeyboardInterrupt


@pytest.mark.parametrize("name", STUDIES)
def test_every_study_says_what_it_can_be_told(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([name, "--help"]) == 0
    assert "--json" in capsys.readouterr().out


def test_names_are_told_and_unknown_ones_are_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    assert set(STUDIES) <= set(capsys.readouterr().out.split())
    assert main(["sup"]) == 2
    assert "unknown study 'sup'" in capsys.readouterr().err


def test_rows_of_a_study_that_fails_are_in_its_file(tmp_path: Path) -> None:
    file = tmp_path / "counts.json"
    with pytest.raises(ZeroDivisionError):
        run(Counting(until=4, json=file))
    assert json.loads(file.read_text())["rows"] == [{"number": number, "share": 0.25} for number in range(3)]
    with pytest.raises(InputError, match="exists"):
        run(Counting(json=file))
    assert len(run(Counting(until=1, json=file, overwrite=True))) == 1


def test_a_study_that_is_interrupted_tells_what_it_has(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(STUDIES, "interrupted", "test_studies:Interrupted")
    assert main(["interrupted", "--until", "2", "--json", str(tmp_path / "a.json")]) == 130
    told = capsys.readouterr()
    assert "| 1 | 0.2 |" in told.out
    assert "interrupted after 2 rows" in told.err
    assert len(json.loads((tmp_path / "a.json").read_text())["rows"]) == 2


def test_tables_and_json_say_what_is_not_defined() -> None:
    assert table(["a", "b"], [["x", float("nan")], ["y", (1.0, 2.0)]]).splitlines()[1:] == [
        "| --- | ---: |", "| x | n/a |", "| y | 1.0 / 2.0 |",
    ]  # fmt: skip
    assert plain({"a": (np.float64("nan"), np.arange(2)), "b": Path("x")}) == {"a": [None, [0, 1]], "b": "x"}


def test_a_pose_prior_is_learned_from_a_folder_of_motions(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "motions").mkdir()
    estimate = Estimate("a", "IT", (WearerEstimate("a", "IT", gestures(4.0), {}),))
    write_bvh(estimate, tmp_path / "motions" / "01_01.bvh", ExportSettings())
    out = tmp_path / "prior.npz"
    assert main(["train-prior", "--motions", str(tmp_path / "motions"), "--out", str(out), "--rate", "60"]) == 0
    assert load_pose_prior(out).mean.shape == (69,)
    assert "trained by" in capsys.readouterr().out
    assert main(["train-prior", "--motions", str(tmp_path / "no"), "--out", str(tmp_path / "p.npz")]) == 2
    assert "expected a folder" in capsys.readouterr().err


ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("page", [*(ROOT / "docs").rglob("*.md"), ROOT / "CONTRIBUTING.md"], ids=str)
def test_studies_of_the_documentation_are_there(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert "vip-factors benchmark" not in text
    for words in map(str.split, re.findall(r"`python -m tests\.studies ([a-z][^`]*)`", text)):
        known = {one.name.replace("_", "-") for one in fields(study_of(words[0]))}
        assert {word.removeprefix("--") for word in words if word.startswith("--")} <= known, f"{page.name}: {words}"
