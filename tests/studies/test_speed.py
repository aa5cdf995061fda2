"""Speed is measured, told and drawn."""

from dataclasses import replace
from pathlib import Path

import pytest

from tests.studies.speed import Load, Speed, draw
from tests.studies.study import markdown, run


def test_every_load_differs_from_the_first_in_one_number() -> None:
    base, *others = Speed(vary=("wearers", "sensors", "cameras", "cores"), long=True).loads()
    assert base == Load()
    assert {one.wearers for one in others} == {1, 2, 4}
    assert all(sum(a != b for a, b in zip(vars(one).values(), vars(base).values(), strict=True)) == 1 for one in others)


@pytest.mark.slow
def test_a_quick_run_times_every_stage_and_measures_memory(tmp_path: Path) -> None:
    study = Speed(quick=True)
    (one,) = rows = run(study)
    stages = [stage for stage, _, _ in one.stages]
    assert stages.count("video-inertial fusion") == 2
    assert stages[0] == "start"
    assert stages[-2].startswith("full rate")
    assert stages[-1] == "how sure, and findings"
    assert any(count for _, _, count in one.stages)
    assert sum(seconds for _, seconds, _ in one.stages) <= one.seconds + 0.01
    assert 0 < one.elimination < one.seconds
    assert one.peak >= one.before > 10e6
    assert "| video-inertial fusion |" in markdown(study, rows)
    draw([one, replace(one, load=Load(frames=200, wearers=2))], tmp_path / "speed.svg")
    assert (tmp_path / "speed.svg").stat().st_size > 0
