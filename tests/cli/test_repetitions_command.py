"""``vip-factors repetitions``: a table to read, tables for programs and a picture; and a section of the report."""

import csv
import json
from collections.abc import Callable
from pathlib import Path

import pytest
from exercises import exercises
from simulated_walk import walk

from vip_factors.estimate import Estimate, WearerEstimate
from vip_factors.io.mcap_estimate import write_estimate
from vip_factors.report.page import report_page
from vip_factors.report.report_data import report_data

KINDS = ("squat", "squat", "jump")


@pytest.fixture(scope="module")
def made() -> Estimate:
    return Estimate.of_one(WearerEstimate("exercises", "SIP", exercises(KINDS), {}))


def test_files_of_an_estimate(run: Callable, made: Estimate, tmp_path: Path) -> None:
    write_estimate(made, tmp_path / "gym.estimate.mcap")
    told = run("repetitions", tmp_path / "gym.estimate.mcap")
    assert told.code == 0
    assert told.out.startswith("exercises: 2 squats, 1 jump\n")
    folder = tmp_path / "gym.estimate.repetitions"
    with (folder / "repetitions.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["kind"] for row in rows] == list(KINDS)
    assert float(rows[2]["flight_height_m"]) == pytest.approx(0.3, abs=0.03)
    assert rows[0]["flight_height_m"] == rows[0]["depth_sd_m"] == ""
    whole = json.loads((folder / "repetitions.json").read_text(encoding="utf-8"))
    assert whole["exercises"][0]["depth_m"]["sigma"] is None
    assert (folder / "repetitions.png").stat().st_size > 10_000
    assert run("repetitions", tmp_path / "gym.estimate.mcap").code == 2
    assert run("repetitions", tmp_path / "gym.estimate.mcap", "--overwrite").code == 0
    assert run("repetitions", tmp_path / "gym.estimate.mcap", "-o", tmp_path / "gym.estimate.mcap").code == 2


def test_the_report_has_a_section_only_of_those_who_exercise(made: Estimate) -> None:
    text = report_page(report_data(made))
    assert "<p>2 squats, 1 jump.</p>" in text
    assert text.count("<td>squat</td>") == 2
    standing = Estimate.of_one(WearerEstimate("a", "SIP", walk(0.5), {}))
    assert 'id="repetitions"' not in report_page(report_data(standing))
