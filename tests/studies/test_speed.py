"""Speed is measured and told; the recording of hours is one: in time, without leaps where it turns."""

from pathlib import Path

import numpy as np
import pytest

from tests.studies import speed as speed_module
from tests.studies.long import Long, LongRun
from tests.studies.speed import Speed
from tests.studies.study import markdown, run
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import angle_between
from vip_factors.io.mcap_recording import read_recording


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


def test_a_clip_is_played_forwards_and_backwards(tmp_path: Path) -> None:
    path = tmp_path / "long.mcap"
    Long(hours=20 / 3600, sensors="sip6", clip_s=8.0).write(path)
    recording = read_recording(path)
    assert recording.truth is None
    assert recording.initial_pose == "t-pose"
    assert recording.interval[1] == pytest.approx(20.0, abs=0.1)
    for stream in recording.imus.values():
        assert len(stream) > 0.95 * 60 * 20
        assert np.diff(stream.time).min() > 0.2 / 60
        R = stream.R_inertial_sensor
        assert R is not None
        assert np.rad2deg(angle_between(R[:-1], R[1:])).max() < 20.0
        ends = [np.argmin(np.abs(stream.time - one)) for one in (5.0, 11.0)]  # of the first lap, and of the second
        assert np.rad2deg(angle_between(R[ends[0]], R[ends[1]])) < 20.0


def test_what_cannot_be_made_is_refused() -> None:
    with pytest.raises(InputError, match="clip"):
        Long(clip_s=1.0)
    with pytest.raises(InputError, match="hours"):
        Long(hours=0.0)


def test_the_table_is_per_hour() -> None:
    one = LongRun(108000, 600.0, 550.0, 200_000_000, 10**9, 10**8, 2 * 10**8)
    assert "| 108000 | 1000 | 200 | 600 | 1200 | 1100 | 100 | 200 |" in markdown(Long(hours=0.5), [one])
