"""Pauses of a recording: nothing is carried over them, and headings that are others after them are found and told."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from vip_factors.geometry.rotations import angle_between, rotation_z, wrap_angle
from vip_factors.pipeline import smooth
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.frames import resample
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene
from vip_factors.sensors.sources import SceneInMemory, one_stream
from vip_factors.settings import CalibrationSettings, Settings, SolveSettings
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.recording import simulate_recording
from vip_factors.simulate.settings import SimulateSettings
from vip_factors.stages.inertial import find_start
from vip_factors.stages.pauses import headings_after_pauses, pauses_of, with_pauses

SETTINGS = Settings(
    frame_rate=15.0, covariance=False, calibration=CalibrationSettings(passes=1), solve=SolveSettings(max_iterations=12)
)
JUMPS = np.deg2rad([70.0, -120.0, 35.0, 150.0, -60.0, 100.0, -40.0, 170.0, 80.0, -90.0])


@pytest.fixture(scope="module")
def walk() -> Recording:
    motion = gestures(22.0)
    settings = SimulateSettings(packet_loss=0.0, gap_s=0.0, heading_drift_deg=0.0)
    return simulate_recording(motion, preset("tnt10", motion.skeleton), settings, seed=3)


def paused(recording: Recording, jumps: Mapping[str, float]) -> Recording:
    """From 10 to 14 s nothing is measured, which the clock takes for 2 s; after it headings are larger by radians."""
    imus = {}
    for name, one in recording.imus.items():
        assert one.R_inertial_sensor is not None
        after = one.cut(14.0, np.inf)
        R = rotation_z(-jumps.get(name, 0.0)) @ one.R_inertial_sensor[one.time >= 14.0]
        imus[name] = one_stream([one.cut(-np.inf, 10.0), replace(after, time=after.time - 2.0, R_inertial_sensor=R)])
    return replace(recording, imus=imus, truth=None)


def stream(*spans: tuple[float, float]) -> ImuStream:
    time = np.concatenate([np.arange(start, end, 0.1) for start, end in spans])
    return ImuStream("s", time, np.zeros((len(time), 3)))


def test_pauses_lie_between_stretches_of_some_seconds() -> None:
    (one,) = pauses_of({"s": stream((0, 10), (12, 20), (20.5, 30))})
    assert (one.start, one.end) == (pytest.approx(9.9), pytest.approx(12.0))
    assert not pauses_of({"s": stream((0, 1), (3, 30))})  # a pose that was held before
    both = pauses_of({"a": stream((0, 10), (12, 30)), "b": stream((0, 11), (15, 30)), "c": stream((0, 30))})
    assert [(round(one.start, 1), round(one.end, 1), one.silent) for one in both] == [(9.9, 15.0, {"a", "b"})]


def test_nothing_follows_a_silence_of_all_sensors(walk: Recording) -> None:
    frames = resample(paused(walk, {}), 15.0)
    (end,) = np.flatnonzero(~frames.follows) + 1
    assert frames.time[end] == pytest.approx(12.0, abs=0.1)
    assert frames.orientation_valid[end].any()
    assert not frames.orientation_valid[end - 1].any()
    silence = frames.window(slice(int(end) - 3, int(end) + 3))  # too short to be one, had it not been known
    np.testing.assert_array_equal(np.flatnonzero(~silence.follows), [2])
    one = dict(walk.imus) | {"pelvis": paused(walk, {}).imus["pelvis"]}
    assert resample(replace(walk, imus=one), 15.0).follows.all()


def found_jumps(recording: Recording) -> np.ndarray:
    """Degrees ``(P, S)`` by which headings are found to step over pauses."""
    source, about = with_pauses(SceneInMemory(Scene("walk", (recording,))), SETTINGS)
    assert [finding.kind for finding in about] == ["pauses"]
    (recording,) = source.between().wearers
    start, _ = find_start(recording, resample(recording, 15.0), SETTINGS, lambda fraction: None)
    pauses, headings = headings_after_pauses(recording, recording.placed, start, SETTINGS)
    assert len(headings) == len(pauses) + 1
    return np.rad2deg(np.diff(headings, axis=0))


def test_headings_that_go_on_are_kept(walk: Recording) -> None:
    assert not len(found_jumps(paused(walk, {})))


def test_one_sensor_that_begins_anew_is_told_from_the_others(walk: Recording) -> None:
    (jumps,) = found_jumps(paused(walk, {walk.placed[4]: np.deg2rad(90.0)}))
    assert np.flatnonzero(jumps).tolist() == [4]
    assert jumps[4] == pytest.approx(90.0, abs=20.0)


def test_headings_after_a_pause_are_found_anew(walk: Recording) -> None:
    true = dict(zip(walk.placed, JUMPS, strict=False))
    whole = smooth(paused(walk, true), replace(SETTINGS, calibration_rate=7.5))
    assert {"pauses", "headings after pauses"} <= {finding.kind for finding in whole.findings}
    estimate = whole.wearer()
    before, after = np.array(
        [calibration.heading_at(np.array([5.0, 16.0])) for calibration in estimate.calibration.values()]
    ).T
    off = after - before - [true[name] for name in estimate.calibration]
    off = wrap_angle(off - np.angle(np.exp(1j * off).sum()))
    assert np.rad2deg(np.abs(off)).max() < 12.0
    assert walk.truth is not None
    time = estimate.motion.time
    R_true, _ = walk.truth.motion.poses_at(time + 2.0 * (time > 11))
    joints = np.rad2deg(angle_between(estimate.motion.R_parent_child, R_true))[:, 1:]
    before_pause, after_pause = np.mean(joints[time < 10]), np.mean(joints[time > 12.2])
    assert after_pause < min(7.5, before_pause + 1.0)  # as well known as before the pause
