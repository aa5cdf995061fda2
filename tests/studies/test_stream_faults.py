"""Faults do what they say, and nothing else; errors of streams over time, the table."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from live_answers import answers, live_scene, truth_of

from tests.studies.faults import (
    OfSensors,
    chosen_faults,
    clock_jumping,
    delayed,
    everything,
    heading_reset,
    lost,
    of_imus,
    of_video,
    repeated,
    turned_on_bone,
)
from tests.studies.stream_faults import Errors, FaultTrial, StreamFaults
from tests.studies.stream_run import ErrorOverTime, bad_seconds, error_over_time, run_stream, seconds_until_good
from tests.studies.study import markdown
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import exp, rotation_z
from vip_factors.live.settings import LiveSettings
from vip_factors.sensors.live import ImuSample, LiveSample, VideoFrame, live_samples, stream_head
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


R = exp(np.array([0.1, -0.7, 0.4]))
FORCE = np.array([1.0, -2.0, 9.0])


def stream(seconds: float = 2.0) -> list[LiveSample]:
    """Two sensors at 60 Hz and a camera at 30 Hz, in the order of time."""
    samples: list[LiveSample] = []
    for number in range(round(seconds * 60)):
        time = number / 60
        samples += [ImuSample("ann", name, time, R, FORCE) for name in ("wrist", "shin")]
        if number % 2 == 0:
            samples.append(VideoFrame("phone", time, np.zeros((0, 18, 2)), np.zeros((0, 18))))
    return samples


def test_a_share_is_lost_within_the_time_only() -> None:
    left = list(lost(stream(), of_imus, 0.5, 1.5, 0.3, seed=1))
    gone = [one for one in stream() if not _has(left, one)]
    assert all(isinstance(one, ImuSample) and 0.5 <= one.time < 1.5 for one in gone)
    assert 0.2 < len(gone) / 120 < 0.4
    assert [_key(one) for one in left] == [_key(one) for one in lost(stream(), of_imus, 0.5, 1.5, 0.3, seed=1)]
    assert all(one.sensor != "shin" for one in lost(stream(), OfSensors(["shin"]), 0.0) if isinstance(one, ImuSample))


@given(st.floats(0, 0.5), st.floats(0, 0.2), st.integers(0, 9))
def test_what_is_late_comes_in_the_order_of_its_arrival(delay: float, jitter: float, seed: int) -> None:
    before = stream(1.0)
    after = list(delayed(before, of_video, delay, 0.2, 0.8, jitter, seed))
    assert sorted(map(_key, after)) == sorted(map(_key, before))
    kept = [_key(one) for one in after if isinstance(one, ImuSample)]
    assert kept == [_key(one) for one in before if isinstance(one, ImuSample)]
    newest = -1.0
    for one in after:
        if isinstance(one, ImuSample):
            newest = max(newest, one.time)
        elif 0.2 <= one.time < 0.8:
            assert newest >= min(one.time + delay, 59 / 60) - 2 / 60


def test_twice_in_a_row() -> None:
    after = list(repeated(stream(), everything, 1.0, 0.0))
    assert after[::2] == after[1::2]
    assert len(after) == 2 * len(stream())


def test_a_strap_slips_and_gravity_slips_with_it() -> None:
    turn = np.array([0.0, 0.6, 0.3])
    for sample in turned_on_bone(stream(), "wrist", turn, 1.0, takes=0.5):
        if not isinstance(sample, ImuSample):
            continue
        assert sample.R_inertial_sensor is not None
        assert sample.specific_force is not None
        np.testing.assert_allclose(sample.R_inertial_sensor @ sample.specific_force, R @ FORCE, atol=1e-12)
        share = np.clip((sample.time - 1.0) / 0.5, 0, 1) if sample.sensor == "wrist" else 0.0
        np.testing.assert_allclose(R.T @ sample.R_inertial_sensor, exp(turn * share), atol=1e-12)


def test_a_heading_is_set_anew() -> None:
    for sample in heading_reset(stream(), "shin", 1.0, 1.0):
        if isinstance(sample, ImuSample):
            moved = sample.sensor == "shin" and sample.time >= 1.0
            assert sample.R_inertial_sensor is not None
            np.testing.assert_allclose(sample.R_inertial_sensor, rotation_z(1.0) @ R if moved else R)
            assert sample.specific_force is FORCE


def test_clocks_jump() -> None:
    times = [one.time for one in clock_jumping(stream(), everything, -5.0, 1.0)]
    assert min(times) == -4.0
    assert max(times) < 1.0


def _key(sample: LiveSample) -> tuple[float, str]:
    return sample.time, sample.sensor if isinstance(sample, ImuSample) else ""


def _has(samples: list[LiveSample], one: LiveSample) -> bool:
    return _key(one) in {_key(other) for other in samples}
