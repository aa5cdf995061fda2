"""Speed is measured and told."""

import pytest

from tests.studies.speed import Speed
from tests.studies.study import markdown, run


@pytest.mark.slow
def test_quick_runs_time_every_stage_and_measure_memory() -> None:
    study = Speed(quick=True)
    inertial, filmed = rows = run(study)
    stages = [stage for stage, _, _ in filmed.stages]
    assert stages.count("video-inertial fusion") == 2
    assert stages[0] == "start"
    assert stages[-2].startswith("full rate")
    assert stages[-1] == "how sure, and findings"
    assert any(count for _, _, count in inertial.stages)
    for one in rows:
        assert sum(seconds for _, seconds, _ in one.stages) <= one.seconds + 0.01
        assert abs(one.frames - 200) <= 8
        assert one.peak >= one.before > 10e6
    assert "| video-inertial fusion |" in markdown(study, rows)
