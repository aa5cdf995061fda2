"""One sensor's samples: what is refused and in which words, gaps, and cutting."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vip_factors.errors import RecordingError
from vip_factors.geometry.rotations import angle_between, exp, log, right_jacobian, rotation_z, transpose, yaw_of
from vip_factors.io.importers import xsens
from vip_factors.sensors.imu_stream import AttitudeFilter, ImuStream, with_orientation

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


def test_single_samples_beyond_any_accelerometer_are_not_measured() -> None:
    time, force = np.arange(200) / 100, np.tile([0.0, 9.81, 0.0], (200, 1))
    blow = force.copy()
    blow[[50, 120], 0] = 461.0, -900.0
    stream = ImuStream("s", time, blow)
    np.testing.assert_array_equal(np.flatnonzero(~stream.force_measured_mask), [50, 120])
    np.testing.assert_allclose(stream.specific_force, force)
    np.testing.assert_array_equal(np.flatnonzero(~stream.cut(1.0, 2.0).force_measured_mask), [20])
    with pytest.raises(RecordingError, match="900 m/s² at sample 120: expected at most 400"):
        ImuStream("s", time[:130], blow[:130])


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


RATE = 100.0


def swinging(seconds: float = 20.0, samples_per_second: float = RATE) -> tuple[np.ndarray, ImuStream]:
    """A sensor that swings about changing axes without leaving its place: true orientations and its samples."""
    time = np.arange(round(seconds * samples_per_second)) / samples_per_second
    size, speed, phase = np.array([1.0, 0.8, 0.6]), np.array([1.3, 0.9, 1.7]), np.array([0.0, 1.0, 0.0])
    swing = size * np.sin(speed * time[:, None] + phase)
    R = exp(swing)
    rate = np.einsum("nij,nj->ni", right_jacobian(swing), size * speed * np.cos(speed * time[:, None] + phase))
    force = transpose(R) @ np.array([0.0, 0.0, 9.81])
    return R, ImuStream("s", time, force, None, rate)


def error_but_for_heading(R_true: np.ndarray, R: np.ndarray) -> np.ndarray:
    heading = np.median(yaw_of(R_true @ transpose(R)))
    return np.rad2deg(angle_between(R_true, rotation_z(heading) @ R))


def test_a_swinging_sensor_is_followed() -> None:
    R_true, stream = swinging()
    found = with_orientation(stream)
    assert found.R_inertial_sensor is not None
    assert np.max(error_but_for_heading(R_true, found.R_inertial_sensor)) < 1.0
    np.testing.assert_array_equal(found.time, stream.time)


@pytest.mark.parametrize("samples_per_second", [25.0, 50.0])
def test_orientation_is_of_the_moment_of_the_angular_rate(samples_per_second: float) -> None:
    """Half a step ahead is what comes of turning by the rate at the step's end: 0.7° rms at 50 Hz here."""
    R_true, stream = swinging(samples_per_second=samples_per_second)
    found = with_orientation(stream)
    assert found.R_inertial_sensor is not None
    R_true = rotation_z(-np.median(yaw_of(R_true @ transpose(found.R_inertial_sensor)))) @ R_true
    turn = np.sum(log(transpose(R_true) @ found.R_inertial_sensor) * stream.angular_rate)
    steps_ahead = turn / np.sum(stream.angular_rate**2) * samples_per_second
    assert abs(steps_ahead) < 0.02
    assert np.sqrt(np.mean(error_but_for_heading(R_true, found.R_inertial_sensor) ** 2)) < 5.0 / samples_per_second


def test_z_of_the_inertial_frame_is_up() -> None:
    time = np.arange(300) / RATE
    tilt = exp(np.array([0.7, -0.4, 0.2]))
    force = np.tile(tilt.T @ [0, 0, 9.81], (300, 1))
    found = with_orientation(ImuStream("s", time, force, None, np.zeros((300, 3))))
    assert found.R_inertial_sensor is not None
    assert found.specific_force is not None
    up = np.einsum("nij,nj->ni", found.R_inertial_sensor, found.specific_force)
    np.testing.assert_allclose(up, np.tile([0, 0, 9.81], (300, 1)), atol=1e-3)


def test_lost_packets_and_jitter_change_little() -> None:
    R_true, stream = swinging()
    kept = np.ones(len(stream), bool)
    kept[[100, 500, 501, 900, 901, 902, 1500]] = False
    jitter = np.random.default_rng(0).uniform(-0.001, 0.001, len(stream))
    assert stream.specific_force is not None
    assert stream.angular_rate is not None
    lossy = ImuStream("s", (stream.time + jitter)[kept], stream.specific_force[kept], None, stream.angular_rate[kept])
    found = with_orientation(lossy)
    assert found.R_inertial_sensor is not None
    assert len(found) == len(lossy)
    assert np.max(error_but_for_heading(R_true[kept], found.R_inertial_sensor)) < 3.0


def test_an_orientation_that_exists_stays() -> None:
    R, stream = swinging(2.0)
    fused = ImuStream("s", stream.time, stream.specific_force, R)
    assert with_orientation(fused) is fused


@pytest.mark.parametrize(
    ("stream", "sentence"),
    [
        (ImuStream("s", np.arange(5.0), np.ones((5, 3))), "neither orientation nor angular rate"),
        (ImuStream("s", np.zeros(1), np.ones((1, 3)), None, np.ones((1, 3))), "single sample"),
        (ImuStream("s", np.arange(5.0), np.ones((5, 3)), None, np.full((5, 3), 90.0)), "degrees per second"),
        (
            ImuStream("s", np.array([0, 0.1, 0.2, 2.0]), np.ones((4, 3)), None, np.zeros((4, 3))),
            "lost 1.80 s of samples at t = 0.20 s",
        ),
    ],
)
def test_what_cannot_be_done_is_said(stream: ImuStream, sentence: str) -> None:
    with pytest.raises(RecordingError, match=sentence):
        with_orientation(stream)


@pytest.mark.data
def test_real_sensors_turn_as_their_maker_says(data_folder: Path) -> None:
    """Against the on-board filter of Xsens MTw on pelvis and thigh, 25 s of walking."""
    for name in ("00B40B91", "00B40C45"):
        stream = xsens.MTW.read(data_folder / "xsens_vicon_walk" / "raw_mtw").imus[name]
        assert stream.R_inertial_sensor is not None
        found = with_orientation(replace(stream, R_inertial_sensor=None))
        assert found.R_inertial_sensor is not None
        error = error_but_for_heading(stream.R_inertial_sensor, found.R_inertial_sensor)
        assert np.median(error) < 2.0
        assert np.max(error) < 5.0


def test_an_attitude_turns_as_much_as_the_time_between_samples() -> None:
    """Of a sensor that turns steadily about the vertical, some of whose samples are lost."""
    attitude, kept = AttitudeFilter(), [k for k in range(600) if k % 7 not in (3, 4)]
    found = [attitude.orientation(0.01 * k, np.array([0.0, 0.0, 9.81]), np.array([0.0, 0.0, 1.5])) for k in kept]
    yaws = np.unwrap([yaw_of(R) for R in found if R is not None])
    assert yaws[-1] - yaws[40] == pytest.approx(1.5 * 0.01 * (kept[-1] - kept[40]), rel=0.01)
