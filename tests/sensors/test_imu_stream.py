"""One sensor's samples: what is refused and in which words, gaps, and cutting."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vip_factors.errors import RecordingError
from vip_factors.geometry.rotations import exp
from vip_factors.sensors.imu_stream import ImuStream

N = 6
TIME = np.arange(N) / 10
FORCE = np.tile([0.0, 0.0, 9.81], (N, 1))
R = exp(np.random.default_rng(0).normal(size=(N, 3)))


def changed(values: np.ndarray, row: int, value: object) -> np.ndarray:
    values = values.copy()
    values[row] = value
    return values


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: ImuStream("s", np.zeros(0), np.zeros((0, 3))), "'s' has no samples"),
        (lambda: ImuStream("s", changed(TIME, 2, np.nan), FORCE), "a time of nan s"),
        (lambda: ImuStream("s", changed(TIME, 3, 0.1), FORCE), r"from 0\.2000 s to 0\.1000 s at sample 3"),
        (lambda: ImuStream("s", changed(TIME, 3, 0.2), FORCE), "expected strictly increasing times"),
        (lambda: ImuStream("s", TIME, FORCE[:4]), r"specific force has shape \(4, 3\): expected \(6, 3\)"),
        (lambda: ImuStream("s", TIME, None, R[:, :2]), r"orientation has shape \(6, 2, 3\)"),
        (lambda: ImuStream("s", TIME, FORCE, None, FORCE[:, :2]), "angular rate has shape"),
        (lambda: ImuStream("s", TIME, changed(FORCE, 4, np.inf)), r"sample 4 \(t = 0\.400 s\) is not finite"),
        (lambda: ImuStream("s", TIME, FORCE * 100), "981 m/s² at sample 0: expected at most 400; check the unit"),
        (lambda: ImuStream("s", TIME, None, changed(R, 5, np.eye(3) * 2)), "of sample 5 is not a rotation matrix"),
        (lambda: ImuStream("s", TIME, None, changed(R, 1, -np.eye(3))), "of sample 1 is not a rotation matrix"),
        (lambda: ImuStream("s", TIME, None, None, FORCE), "measures neither orientation nor specific force"),
        (lambda: ImuStream.from_samples("s", TIME, FORCE * np.nan), "none of its 6 samples is finite"),
        (lambda: ImuStream.from_samples("s", TIME, FORCE[:4]), r"specific force has shape \(4, 3\)"),
    ],
)
def test_bad_input_is_refused_in_a_sentence(make: Callable[[], ImuStream], sentence: str) -> None:
    with pytest.raises(RecordingError, match=sentence):
        make()


def test_samples_that_are_not_finite_become_gaps() -> None:
    stream = ImuStream.from_samples("s", TIME, changed(FORCE, 2, np.nan), changed(R, 3, np.nan))
    np.testing.assert_allclose(stream.time, [0, 0.1, 0.4, 0.5])
    assert stream.R_inertial_sensor is not None
    np.testing.assert_array_equal(stream.R_inertial_sensor, R[[0, 1, 4, 5]])
    np.testing.assert_allclose(stream.gaps, [[0.1, 0.4]])
    assert np.isclose(stream.rate, 10.0)


def test_samples_whose_times_no_clock_shows_become_gaps() -> None:
    stream = ImuStream.from_samples("s", changed(changed(TIME, 2, -1e308), 4, np.inf), FORCE)
    np.testing.assert_allclose(stream.time, TIME[[0, 1, 3, 5]])


@given(st.sets(st.integers(1, 98), max_size=40), st.floats(5, 200))
def test_gaps_are_where_samples_were_lost(lost: set[int], rate: float) -> None:
    kept = np.array([k for k in range(100) if k not in lost])
    stream = ImuStream("s", kept / rate, np.zeros((len(kept), 3)))
    assert np.isclose(stream.rate, rate)
    missing = np.round((stream.gaps[:, 1] - stream.gaps[:, 0]) * rate) - 1
    assert missing.sum() == len(lost)


def test_jitter_makes_no_gaps() -> None:
    jitter = np.random.default_rng(0).uniform(-0.2, 0.2, 200)
    assert len(ImuStream("s", (np.arange(200) + jitter) / 100, np.zeros((200, 3))).gaps) == 0


def test_a_single_sample_has_no_rate_and_no_gaps() -> None:
    stream = ImuStream("s", np.zeros(1), FORCE[:1])
    assert stream.rate == 0.0
    assert stream.gaps.shape == (0, 2)


def test_cutting_keeps_the_clock_and_every_channel() -> None:
    part = ImuStream("s", TIME, FORCE, R, FORCE / 10).cut(0.1, 0.3)
    np.testing.assert_allclose(part.time, [0.1, 0.2, 0.3])
    assert part.specific_force is not None
    assert part.R_inertial_sensor is not None
    assert part.angular_rate is not None
    np.testing.assert_array_equal(part.R_inertial_sensor, R[1:4])
    assert len(part.specific_force) == len(part.angular_rate) == len(part) == 3
    with pytest.raises(RecordingError, match="no samples"):
        part.cut(2.0, 3.0)
