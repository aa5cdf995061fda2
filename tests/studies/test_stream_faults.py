"""Errors of streams over time, the table; the tracker itself is tested elsewhere."""

import math
from dataclasses import replace

import numpy as np
import pytest
from live_answers import answers, live_scene, truth_of

from tests.studies.faults import chosen_faults
from tests.studies.stream_faults import Errors, FaultTrial, StreamFaults
from tests.studies.stream_run import ErrorOverTime, bad_seconds, error_over_time, run_stream, seconds_until_good
from tests.studies.study import markdown
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import rotation_z
from vip_factors.live.settings import LiveSettings
from vip_factors.sensors.live import live_samples, stream_head
from vip_factors.sensors.scene import Scene


def over(values: list[float]) -> ErrorOverTime:
    return ErrorOverTime(10.0, np.array(values), np.zeros(len(values)))


def test_it_is_good_again_with_the_first_good_second() -> None:
    usual = over([20.0] * 50)
    assert seconds_until_good(over([20.0] * 50), usual, 1.0) == 0.0
    assert seconds_until_good(over([20.0] * 10 + [80.0] * 15 + [23.0] * 25), usual, 1.0) == 1.5
    assert seconds_until_good(over([20.0] * 10 + [math.nan] * 15 + [23.0] * 25), usual, 1.0) == 1.5
    assert math.isnan(seconds_until_good(over([20.0] * 10 + [25.0] * 40), usual, 1.0))
    assert bad_seconds(over([20.0] * 10 + [80.0] * 15 + [20.0] * 25), usual, 1.0) == pytest.approx(1.5)
    assert bad_seconds(usual, usual, 1.0) == 0.0


def test_errors_forgive_the_gauge_but_not_a_drift() -> None:
    scene = live_scene(1.0, 1)
    truth = truth_of(scene, 0)
    R = rotation_z(0.7)
    poses = []
    for one in answers(scene):
        pose = one.wearers[0].newest
        joints = pose.R_parent_child.copy()
        joints[0] = R @ joints[0]
        drift = np.array([0.1, 0.0, 0.0]) if pose.time > 0.75 else np.zeros(3)
        poses.append(replace(pose, R_parent_child=joints, p_world_pelvis=R @ pose.p_world_pelvis + 2.0 + drift))
    rows = error_over_time(poses, truth.skeleton, truth, 60.0, 0.5)
    np.testing.assert_allclose(rows[:, 0], 0, atol=1e-6)
    np.testing.assert_allclose(rows[:45, 1], 0, atol=1e-6)
    np.testing.assert_allclose(rows[47:, 1], 10, atol=1e-6)
    some = error_over_time(poses[:10] + poses[20:], truth.skeleton, truth, 60.0, 0.5)
    assert np.flatnonzero(np.isnan(some[:, 0])).tolist() == list(range(10, 20))


@pytest.fixture(scope="module")
def scene() -> Scene:
    return StreamFaults(seconds=9.5, fault_s=3.0).scene("fixed")


def test_every_fault_is_a_stream(scene: Scene) -> None:
    before = list(live_samples(scene))
    for fault in chosen_faults(scene, 3.0, ()):
        after = list(fault.change(before))
        assert after[:2000] == before[:2000]
        assert len(after) > 0.5 * len(before)
    with pytest.raises(InputError, match="expected some of"):
        chosen_faults(scene, 3.0, ("coffee",))
    few = {name: imu for name, imu in scene.wearers[0].imus.items() if name != "pelvis"}
    with pytest.raises(InputError, match="no sensor 'pelvis'"):
        chosen_faults(replace(scene, wearers=(replace(scene.wearers[0], imus=few),)), 3.0, ())
    with pytest.raises(InputError, match="at least 6 s more"):
        StreamFaults(seconds=8.0, fault_s=3.0)
    with pytest.raises(InputError, match="or neither"):
        StreamFaults(clips=("07_02",))


def test_a_queue_that_runs_over_is_told_and_order_is_kept(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    taken: list[float] = []

    class Slow:
        def __init__(self, setup: Scene, settings: LiveSettings) -> None:
            self._left = iter(answers(live_scene(1.0, 1)))

        def push(self, sample: object) -> list[object]:
            taken.append(sample.time)  # type: ignore[attr-defined]
            new = next(self._left, None) if len(taken) % 13 == 0 else None
            return [] if new is None else [new]

        def note_loss(self) -> None:
            pass

        def finish(self) -> list[object]:
            return []

    monkeypatch.setattr("tests.studies.stream_run.FixedLagTracker", Slow)
    fault = replace(chosen_faults(scene, 3.0, ("updates of",))[0], begin=0.0, overload_s=0.2)
    run = run_stream(live_samples(scene), stream_head(scene), LiveSettings(), fault)
    assert "does not keep up" in run.told[0][1]
    assert taken == sorted(taken)
    assert len(taken) < len(list(live_samples(scene)))
    assert len(run.answers) == len(run.arrival) == 61
    assert run.arrival[-1] > 10


def test_the_table_says_what_was_measured() -> None:
    usual, bad = Errors(20.0, 21.0, 22.0), Errors(20.0, 50.0, float("nan"))
    trial = FaultTrial(
        "pelvis dead", "fixed", "gestures", bad, bad, usual, usual, (30.0, 10.0), 12, 0.31, 1.5, float("nan"), 2.5, 3.5,
        ((1.0, 2.0, 3.0, 4.0),), 0.5, ((8.0, "it is dead"), (9.0, "it is dead")),
    )  # fmt: skip
    failed = replace(trial, fault="other", failure="ValueError: x", findings=())
    table = markdown(StreamFaults(), [trial, failed])
    row = next(line for line in table.splitlines() if line.startswith("| pelvis"))
    assert row.split(" | ")[1:8] == ["20.0", "50.0 (21.0)", "n/a (22.0)", "20.0", "50.0 (21.0)", "n/a (22.0)", "1.5"]
    assert "not to the end" in row
    assert "failed: ValueError: x" in table
    assert "8.0 s: it is dead (2 times)" in table
    assert "0.50 s behind" in table
