"""Whether a live sample can be used at all. Plain numbers: a sample is too small for arrays to pay."""

import math
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.geometry.rotations import Array
from vip_factors.sensors.imu_stream import FORCE_LIMIT, LATEST_S, ROTATION_TOLERANCE
from vip_factors.sensors.live import ImuSample, LiveCamera, VideoFrame

MOST_PEOPLE = 1000  # in one video frame: no detector tells more apart
PIXEL_LIMIT = 1e5  # no image is as wide, nor is a keypoint marked so far outside of one


@dataclass(frozen=True)
class CheckedImu:
    """A usable IMU sample.

    Attributes:
        time: seconds, on the sensor's clock.
        R_inertial_sensor: nine numbers, row by row.
        specific_force_inertial: three numbers, m/s² in the inertial frame; NaN if not measured.
    """

    time: float
    R_inertial_sensor: list[float]
    specific_force_inertial: tuple[float, float, float]


def checked_imu(sample: ImuSample) -> CheckedImu | str:
    """The sample's numbers, or what is wrong with them."""
    time = _checked_time(sample.time)
    if isinstance(time, str):
        return time
    if sample.R_inertial_sensor is None:
        return "they carry no orientation"
    R = _numbers(sample.R_inertial_sensor, (3, 3))
    if R is None:
        return "an orientation is not a (3, 3) matrix of finite numbers"
    if not _is_rotation(R):
        return "an orientation is not a rotation matrix"
    if sample.specific_force is None:
        return CheckedImu(time, R, (math.nan, math.nan, math.nan))
    force = _numbers(sample.specific_force, (3,))
    if force is None:
        return "a specific force is not three finite numbers"
    most = max(map(abs, force))
    if most > FORCE_LIMIT:
        return f"a specific force of {most:.3g} m/s²: expected at most {FORCE_LIMIT:g}; check the unit (m/s², not mg)"
    x, y, z = force
    a, b, c, d, e, f, g, h, i = R
    return CheckedImu(time, R, (a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z))


def checked_video(frame: VideoFrame, camera: LiveCamera) -> VideoFrame | str:
    """The video frame with arrays of floats, or what is wrong with it."""
    time = _checked_time(frame.time)
    if isinstance(time, str):
        return time
    try:
        pixels, confidence = np.asarray(frame.pixels, dtype=float), np.asarray(frame.confidence, dtype=float)
    except (TypeError, ValueError):
        return "pixels or confidence are not numbers"
    N, K = len(pixels) if pixels.ndim else 0, len(camera.keypoints)
    if pixels.shape != (N, K, 2) or confidence.shape != (N, K):
        return (
            f"pixels {pixels.shape} and confidence {confidence.shape}: expected (N, {K}, 2) and (N, {K}) of keypoint "
            f"set {camera.keypoints.name}"
        )
    if N > MOST_PEOPLE:
        return f"{N} people in one frame: expected at most {MOST_PEOPLE}"
    if not np.all(np.isfinite(confidence)):
        return "a confidence is not finite"
    found = pixels[confidence > 0]
    if not np.all(np.abs(found) <= PIXEL_LIMIT):  # NaN is not either
        return f"a keypoint with confidence has pixels that are not finite, or beyond {PIXEL_LIMIT:g}"
    return replace(frame, time=time, pixels=pixels, confidence=np.clip(confidence, 0.0, 1.0))


def _checked_time(time: float) -> float | str:
    try:
        time = float(time)
    except (TypeError, ValueError):
        return "a time stamp is not a number"
    if not abs(time) <= LATEST_S:
        return "a time stamp is not finite" if not math.isfinite(time) else f"a time stamp of {time:.3g} s"
    return time


def _numbers(values: Array, shape: tuple[int, ...]) -> list[float] | None:
    """All of them row by row, or None if they are not finite or of another shape."""
    try:
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        return None
    if array.shape != shape:
        return None
    numbers: list[float] = array.ravel().tolist()
    return numbers if all(map(math.isfinite, numbers)) else None


def _is_rotation(R: list[float]) -> bool:
    """As :class:`~vip_factors.sensors.imu_stream.ImuStream` asks: RᵀR within the tolerance, and no mirror."""
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
