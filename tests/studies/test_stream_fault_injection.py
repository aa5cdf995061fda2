"""Faults of streams do what they say, and nothing else."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tests.studies.stream_fault_injection import (
    OfSensors,
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
from vip_factors.geometry.rotations import exp, rotation_z
from vip_factors.sensors.live import ImuSample, LiveSample, VideoFrame

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
