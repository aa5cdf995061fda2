"""Samples of a stream: their validation, orientations at an instant and accelerations over a window."""

import math
from dataclasses import replace

import numpy as np

from vip_factors.geometry.rotations import Array, exp, log, transpose
from vip_factors.sensors.imu_stream import (
    FORCE_LIMIT,
    GAP_FACTOR,
    LATEST_S,
    RATE_LIMIT,
    ROTATION_TOLERANCE,
    AttitudeFilter,
)
from vip_factors.sensors.live import ImuSample, VideoFrame
from vip_factors.sensors.scene import Camera


class SampleError(ValueError):
    """A sample that cannot be used, with the reason."""


def checked_imu(sample: ImuSample, attitude: AttitudeFilter) -> tuple[float, list[float]]:
    """Time and values of an IMU sample.

    Values are R_inertial_sensor row by row, then the specific force in the inertial frame (m/s², NaN if not measured).
    An orientation that is not measured is estimated from specific force and angular rate by ``attitude``.

    Raises:
        SampleError: with the reason.
    """
    time = _checked_time(sample.time)
    R = _checked_orientation(sample, time, attitude)
    if sample.specific_force is None:
        return time, [*R, math.nan, math.nan, math.nan]
    x, y, z = force = _numbers(sample.specific_force, (3,), "a specific force is not three finite numbers").tolist()
    peak = max(map(abs, force))
    if peak > FORCE_LIMIT:
        expected = f"expected at most {FORCE_LIMIT:g}; check the unit (m/s², not mg)"
        raise SampleError(f"a specific force of {peak:.3g} m/s²: {expected}")
    a, b, c, d, e, f, g, h, i = R
    return time, [*R, a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z]


def _checked_orientation(sample: ImuSample, time: float, attitude: AttitudeFilter) -> list[float]:
    if sample.R_inertial_sensor is not None:
        R = _numbers(sample.R_inertial_sensor, (3, 3), "an orientation is not a (3, 3) matrix of finite numbers")
        values: list[float] = R.ravel().tolist()
        if not _is_rotation(values):
            raise SampleError("an orientation is not a rotation matrix")
        return values
    if sample.angular_rate is None or sample.specific_force is None:
        what = "they carry neither an orientation nor the angular rate and specific force to estimate it from"
        raise SampleError(what)
    rate = _numbers(sample.angular_rate, (3,), "an angular rate is not three finite numbers")
    force = _numbers(sample.specific_force, (3,), "a specific force is not three finite numbers")
    fastest = float(np.abs(rate).max())
    if fastest > RATE_LIMIT:
        expected = f"expected at most {RATE_LIMIT:g}; check the unit (rad/s, not degrees per second)"
        raise SampleError(f"an angular rate of {fastest:.3g} rad/s: {expected}")
    oriented = attitude.orientation(time, force, rate)
    if oriented is None:
        raise SampleError("they came after newer ones")
    return oriented.ravel().tolist()


def _is_rotation(R: list[float]) -> bool:
    """Whether RᵀR is the identity within the tolerance of :class:`ImuStream`, and R no reflection.

    Plain numbers: for a single sample NumPy takes ten times as long, a sixth of a stream's time with 13 sensors.
    """
    a, b, c, d, e, f, g, h, i = R
    return (
        abs(a * a + d * d + g * g - 1) <= ROTATION_TOLERANCE
        and abs(b * b + e * e + h * h - 1) <= ROTATION_TOLERANCE
        and abs(c * c + f * f + i * i - 1) <= ROTATION_TOLERANCE
        and abs(a * b + d * e + g * h) <= ROTATION_TOLERANCE
        and abs(a * c + d * f + g * i) <= ROTATION_TOLERANCE
        and abs(b * c + e * f + h * i) <= ROTATION_TOLERANCE
        and a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g) > 0
    )


def checked_video(frame: VideoFrame, camera: Camera) -> VideoFrame:
    """A video frame with arrays of floats.

    Raises:
        SampleError: with the reason.
    """
    pixel_limit = 1e5  # wider than any image
    most_people = 1000  # in one video frame
    time = _checked_time(frame.time)
    try:
        pixels, confidence = np.asarray(frame.pixels, dtype=float), np.asarray(frame.confidence, dtype=float)
    except (TypeError, ValueError):
        raise SampleError("pixels or confidence are not numbers") from None
    N, K = len(pixels) if pixels.ndim else 0, len(camera.keypoints)
    if pixels.shape != (N, K, 2) or confidence.shape != (N, K):
        raise SampleError(
            f"pixels {pixels.shape} and confidence {confidence.shape}: expected (N, {K}, 2) and (N, {K}) of keypoint "
            f"set {camera.keypoints.name}"
        )
    if most_people < N:
        raise SampleError(f"{N} people in one frame: expected at most {most_people}")
    if not np.all(np.isfinite(confidence)):
        raise SampleError("a confidence is not finite")
    if not np.all(np.abs(pixels[confidence > 0]) <= pixel_limit):  # refuses NaN as well
        raise SampleError(f"a keypoint with confidence has pixels that are not finite, or beyond {pixel_limit:g}")
    return replace(frame, time=time, pixels=pixels, confidence=np.clip(confidence, 0.0, 1.0))


def _checked_time(time: float) -> float:
    try:
        time = float(time)
    except (TypeError, ValueError):
        raise SampleError("a time stamp is not a number") from None
    if not abs(time) <= LATEST_S:
        raise SampleError("a time stamp is not finite" if not math.isfinite(time) else f"a time stamp of {time:.3g} s")
    return time


def _numbers(values: Array, shape: tuple[int, ...], otherwise: str) -> Array:
    """Finite values of a shape; ``otherwise`` is the reason if they are not."""
    try:
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise SampleError(otherwise) from None
    if array.shape != shape or not np.isfinite(array).all():
        raise SampleError(otherwise)
    return array


def triangular_average_of_samples(time: Array, values: Array, half_width: float) -> Array:
    """Average of ``S`` piecewise linear signals under the triangle of the given half-width ``h`` about time zero.

    With the second antiderivative of the window, ``G'' = triangle``, partial integration leaves one term for each piece
    between samples: its slope times the increase of G. So ``f(end) G'(end) − Σ slope · ΔG`` is exact; it equals
    :func:`vip_factors.sensors.frames.triangular_average`. The first and last pieces are extrapolated to the ends of
    the window.

    Args:
        time: ``(S, m)`` seconds from the middle of the window, increasing; the last sample may be repeated.
        values: ``(S, m, D)`` at these times; at least two different times for each sensor.
        half_width: seconds.

    Returns:
        ``(S, D)``.
    """
    h, t = half_width, np.clip(time, -half_width, half_width)
    # Second antiderivative of the triangle of area one over [−h, h]: 0 before it, the time after it.
    G = ((t + h) ** 3 - 2 * np.maximum(t, 0.0) ** 3) / (6 * h * h) + np.maximum(time - h, 0.0)
    step = np.diff(time, axis=1)
    real = step > 0
    slope = np.diff(values, axis=1) / np.where(real, step, 1.0)[..., None]
    average = values[:, -1] - np.einsum("sm,smd->sd", np.diff(G, axis=1), slope)

    slope_after = slope[np.arange(len(time)), real.sum(axis=1) - 1]
    area_before = G[:, 0]  # of the window before the first sample
    area_after = (h - time[:, -1]) - (h - G[:, -1])
    return average - area_before[:, None] * slope[:, 0] + area_after[:, None] * slope_after


RATE_SAMPLES = 128  # of each sensor, for its rate: the median of so many steps is within 2 % at 30 % loss
MOST_SAMPLES = 8192  # of each sensor: eight seconds at 1 kHz; beyond, the oldest half is dropped
SAME_TIME_S = 1e-6  # samples closer than this are one sample sent twice


class SensorBuffer:
    """Samples of ``S`` sensors in the order of time; :meth:`measure` equals
    :func:`~vip_factors.sensors.frames.resample`.

    Attributes:
        needed_from: seconds; samples before it may be dropped, except for the last one.
    """

    def __init__(self, sensors: int) -> None:
        capacity = 256  # initial number of samples of each sensor: two seconds at 120 Hz
        self.needed_from = -np.inf
        self._count = np.zeros(sensors, int)
        self._inserted = [0] * sensors
        self._period = np.zeros(sensors)
        self._column = np.arange(sensors)[:, None]
        self._time = np.full((sensors, capacity), np.inf)
        self._values = np.tile([*np.eye(3).ravel(), 0.0, 0.0, 0.0], (sensors, capacity, 1))

    def insert(self, sensor: int, time: float, values: list[float]) -> bool:
        """Insert a sample's :func:`checked_imu` values; False if there is a sample of this time already."""
        rate_every = 32  # samples between estimates of the rate
        if self._count[sensor] == self._time.shape[1]:
            self._make_room()
        count = int(self._count[sensor])
        row = self._time[sensor]
        place = count
        if count and time <= row[count - 1] + SAME_TIME_S:
            place = int(row[:count].searchsorted(time))
            for neighbour in (place - 1, place):
                if 0 <= neighbour < count and abs(row[neighbour] - time) <= SAME_TIME_S:
                    return False
            for values_later in (row, self._values[sensor]):
                values_later[place + 1 : count + 1] = values_later[place:count].copy()
        row[place] = time
        self._values[sensor, place] = values
        self._count[sensor] = count + 1
        self._inserted[sensor] += 1
        # Sensors of equal rate take turns, so that no single update pays for all of them.
        if self._inserted[sensor] < rate_every or (self._inserted[sensor] - 5 * sensor) % rate_every == 0:
            recent = row[max(count + 1 - RATE_SAMPLES, 0) : count + 1]
            self._period[sensor] = float(np.median(np.diff(recent))) if len(recent) > 1 else 0.0
        return True

    def measure(self, time: float, step: float) -> tuple[Array, np.ndarray, Array, np.ndarray]:
        """Orientation at ``time`` and acceleration around the instant one ``step`` before it.

        Returns:
            ``R_inertial_sensor`` ``(S, 3, 3)``, identity where invalid, and its validity ``(S,)``; the triangular
            average of half-width ``step`` of the specific force, ``(S, 3)`` in m/s², zero where invalid, and its
            validity ``(S,)``.
        """
        sample, span = self._samples_around(time - 2 * step, time)
        time_left, time_right = span[:, :-1], span[:, 1:]
        gap = time_right - time_left > GAP_FACTOR * self._period[:, None]
        orientation_valid = self._covered(span, gap, time, time)
        acceleration_valid = self._covered(span, gap, time - 2 * step, time) & (self._count > 1)
        R = self._orientation(sample, span, time, orientation_valid)
        force = np.zeros((len(span), 3))
        if np.any(acceleration_valid):
            rows = np.flatnonzero(acceleration_valid)
            values = self._values[rows[:, None], sample[rows], 9:]
            force[rows] = triangular_average_of_samples(span[rows] - (time - step), values, step)
            acceleration_valid &= np.isfinite(force).all(axis=1)  # NaN where a sample had no specific force
            force[~acceleration_valid] = 0.0
        return R, orientation_valid, force, acceleration_valid

    def _samples_around(self, start: float, end: float) -> tuple[np.ndarray, Array]:
        """Samples around an interval: from the last one before it to the first one after it, at least two if possible.

        Returns:
            Indices ``(S, m)``, the last one repeated, and times ``(S, m)``; zero for a sensor without samples.
        """
        time = self._time[:, : int(self._count.max())]
        newest = np.maximum(self._count - 1, 0)
        first_sample = np.maximum(np.minimum((time <= start).sum(axis=1), newest) - 1, 0)
        last_sample = np.minimum(np.maximum((time < end).sum(axis=1), first_sample + 1), newest)
        steps = np.arange(int((last_sample - first_sample).max()) + 1)
        sample = np.minimum(first_sample[:, None] + steps, last_sample[:, None])
        span = self._time[self._column, sample]
        span[self._count == 0] = 0.0
        return sample, span

    def _covered(self, span: Array, gap: np.ndarray, start: float, end: float) -> np.ndarray:
        """Whether samples cover an interval without a gap ``(S,)``, with a tolerance of half a period."""
        slack = 0.5 * self._period
        edge = slack[:, None]
        inside = (self._count > 0) & (start >= span[:, 0] - slack) & (end <= span[:, -1] + slack)
        torn = gap & (end > span[:, :-1] + edge) & (start < span[:, 1:] - edge)
        return inside & ~torn.any(axis=1)

    def _orientation(self, sample: np.ndarray, span: Array, time: float, orientation_valid: np.ndarray) -> Array:
        """Interpolate between the samples on either side, ``(S, 3, 3)``; beyond the ends the nearest one holds."""
        last_index = span.shape[1] - 1
        right_index = np.minimum(np.maximum((span <= time).sum(axis=1), 1), last_index)
        left_index = np.maximum(right_index - 1, 0)
        rows = self._column[:, 0]
        step = span[rows, right_index] - span[rows, left_index]
        fraction = np.clip((time - span[rows, left_index]) / np.where(step > 0, step, 1.0), 0.0, 1.0)
        ends = (sample[rows, left_index], sample[rows, right_index])
        R_left, R_right = (self._values[rows, end, :9].reshape(-1, 3, 3) for end in ends)
        R = R_left @ exp(fraction[:, None] * log(transpose(R_left) @ R_right))
        R[~orientation_valid] = np.eye(3)
        return R

    def _make_room(self) -> None:
        """Drop samples that are not needed; if these are few, grow the buffer."""
        size = self._time.shape[1]
        for sensor, count in enumerate(self._count):
            needed = int((self._time[sensor, :count] <= self.needed_from).sum()) - 1
            self._drop_before(sensor, max(min(needed, count - RATE_SAMPLES), 0))
        if self._count.max() <= size // 2:
            return
        if size < MOST_SAMPLES:
            grown = np.full((len(self._time), size), np.inf)
            self._time = np.concatenate([self._time, grown], axis=1)
            self._values = np.concatenate([self._values, np.zeros_like(self._values)], axis=1)
            return
        for sensor, count in enumerate(self._count):
            self._drop_before(sensor, max(int(count) - size // 2, 0))

    def _drop_before(self, sensor: int, oldest: int) -> None:
        count = int(self._count[sensor])
        count_kept = count - oldest
        for values in (self._time[sensor], self._values[sensor]):
            values[:count_kept] = values[oldest:count].copy()
        self._time[sensor, count_kept:] = np.inf
        self._count[sensor] = count_kept
