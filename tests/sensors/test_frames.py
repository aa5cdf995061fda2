"""Streams put onto frames: what a gap leaves out, and frames made coarser."""

import numpy as np
import pytest

from vip_factors.geometry.rotations import exp
from vip_factors.live.sensor_samples import SensorBuffer
from vip_factors.sensors.frames import coarser, resample_streams
from vip_factors.sensors.imu_stream import ImuStream

TIME = np.arange(0.0, 4.0, 0.01)
BEGIN, END = 1.5, 2.5  # seconds of a gap
HELD = TIME[(TIME <= BEGIN) | (TIME >= END)]


def stream(time: np.ndarray) -> ImuStream:
    random = np.random.default_rng(0)
    return ImuStream(
        "a", time, random.standard_normal((len(time), 3)), exp(0.1 * random.standard_normal((len(time), 3)))
    )


def test_frames_of_a_gap_are_not_measured() -> None:
    time = np.arange(0.1, 3.9, 0.1)
    frames = resample_streams([stream(HELD)], time)
    inside, near = ((time > BEGIN + by) & (time < END - by) for by in (0.01, -0.09))
    np.testing.assert_array_equal(frames.orientation_valid[:, 0], ~inside)
    np.testing.assert_array_equal(frames.acceleration_valid[:, 0], ~near)


def test_frames_of_a_gap_are_not_measured_in_a_stream_either() -> None:
    buffer = SensorBuffer(1)
    for time in HELD:
        buffer.insert(0, float(time), [*np.eye(3).ravel(), 0.0, 0.0, 9.81])
    for time, seen, whole in ((1.45, True, True), (2.0, False, False), (2.55, True, False), (2.75, True, True)):
        _, (found,), _, (all_found,) = buffer.measure(time, 0.1)
        assert (bool(found), bool(all_found)) == (seen, whole), time


@pytest.mark.parametrize("factor", [2, 3, 5])
def test_coarser_frames_are_those_of_the_samples(factor: int) -> None:
    time = np.arange(0.1, 3.9, 0.02)
    found, expected = (
        coarser(resample_streams([stream(TIME)], time), factor),
        resample_streams([stream(TIME)], time[::factor]),
    )
    valid = found.acceleration_valid & expected.acceleration_valid
    assert valid.sum() > len(found) - 3
    np.testing.assert_allclose(found.specific_force_inertial[valid], expected.specific_force_inertial[valid], atol=1e-9)
    np.testing.assert_allclose(found.R_inertial_sensor, expected.R_inertial_sensor)
