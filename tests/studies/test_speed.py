"""The speed benchmark runs, and says what it measured."""

import json

import pytest

from tests.studies import speed as speed_module
from tests.studies.speed import SpeedTrials, run_speed, speed_json, speed_table


@pytest.mark.slow
def test_quick_run_times_every_part_and_measures_memory() -> None:
    speed = run_speed(SpeedTrials.quick())
    assert [one.placement for one in speed.solves] == ["sip6", "totalcapture13"]
    for one in speed.solves:
        assert one.iterations == 2
        assert all(seconds > 0 for seconds in one.seconds_per_iteration.values())
    assert speed.vip is not None
    stages = [stage for stage, _, _ in speed.vip.stages]
    assert stages.count("video-inertial fusion") == 2
    assert stages[0] == "start"
    assert stages[-2].startswith("full rate")
    assert stages[-1] == "how sure, and findings"
    assert sum(seconds for _, seconds, _ in speed.vip.stages) <= speed.vip.seconds
    assert abs(speed.vip.frames - 200) <= 8
    assert speed.vip.peak > speed.vip.before
    (memory,) = speed.memory
    assert memory.sensors == 13
    assert abs(memory.frames - 200) <= 1
    assert memory.peak >= memory.before > 10e6
    table = speed_table(speed)
    assert "450" in table
    assert "floor" in table
    assert "| video-inertial fusion |" in table
    assert json.loads(speed_json(speed))["memory"][0]["frames"] == memory.frames


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
