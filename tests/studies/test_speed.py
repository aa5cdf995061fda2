"""Speed is measured and told."""

import pytest

from tests.studies import speed as speed_module
from tests.studies.speed import Speed
from tests.studies.study import markdown, run


@pytest.mark.slow
def test_quick_run_times_every_part_and_measures_memory() -> None:
    study = Speed(quick=True)
    *solves, vip, memory = rows = run(study)
    assert [one.placement for one in solves] == ["sip6", "totalcapture13"]
    for one in solves:
        assert one.iterations == 2
        assert all(seconds > 0 for seconds in one.seconds_per_iteration.values())
    stages = [stage for stage, _, _ in vip.stages]
    assert stages.count("video-inertial fusion") == 2
    assert stages[0] == "start"
    assert stages[-2].startswith("full rate")
    assert stages[-1] == "how sure, and findings"
    assert sum(seconds for _, seconds, _ in vip.stages) <= vip.seconds
    assert abs(vip.frames - 200) <= 8
    assert vip.peak > vip.before
    assert memory.sensors == 13
    assert abs(memory.frames - 200) <= 1
    assert memory.peak >= memory.before > 10e6
    tables = markdown(study, rows)
    assert "| thesis, sip6 | 1000 | 20 | 450 |" in tables
    assert "| video-inertial fusion |" in tables


class Bowl:
    """``x² / 2``, whose step is always twice too long: every one is rejected."""

    def cost(self, state: float) -> dict[str, float]:
        return {"bowl": state**2 / 2}

    def linearise(self, state: float) -> "Bowl":
        return self

    def retract(self, state: float, delta: object) -> float:
        return -1.1 * state


def test_rejected_steps_are_rounds_like_others(monkeypatch: pytest.MonkeyPatch) -> None:
    class Solved:
        def optimize(self) -> None:
            return None

    monkeypatch.setattr(Bowl, "stretches", lambda self, damping: None, raising=False)
    monkeypatch.setattr(speed_module, "eliminate", lambda stretches: Solved())
    rounds = speed_module.timed_rounds(Bowl(), 1.0, 7, 1e-3)  # type: ignore[arg-type]
    assert len(rounds) == 7
    assert all(set(one) == set(speed_module.PARTS) for one in rounds)
