"""What is wrong with an accelerometer by itself: a wrong scale, and a range that motion exceeds."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vip_factors.geometry.rotations import Array
from vip_factors.ranges import NotNegative, NotNegativeInt
from vip_factors.sensors.imu_stream import ImuStream

GRAVITY = 9.81
STILL_TURN, STILL_CHANGE, STILL_S = 0.3, 0.5, 0.5  # rad/s; m/s² about the mean; s on end
LEAST_RANGE = 15.0  # m/s²: accelerometers of bodies measure 2 g at least, and what rests at 1 g is constant too
SAME = 1e-3  # of the range: a clipped axis repeats one number; converting from its own unit rounds the last digit


@dataclass(frozen=True)
class AccelerometerSettings:
    """What accelerometers are looked over for, and what is done."""

    check: bool = True  # off: they are taken as they are
    # Of gravity, told from here on and corrected: sound ones are off by up to 1.5 %, some by 3 where nobody calibrated.
    scale_error: float = 0.04
    deviations: NotNegative = 4.0  # standard deviations that a scale is off one by
    # m/s that a sensor's vertical speed may differ between start and end: with it gravity is weighed in motion, over
    # the whole recording.
    speed_change: float = 2.0
    # Of gravity, least standard deviation: zero offsets are as much, and no scale.
    least_sigma: float = 0.005
    clipped_samples: int = 2  # on end at either end of the range, which no motion does by itself
    clipped_runs: NotNegativeInt = 2  # of those: once may be chance


@dataclass(frozen=True)
class AccelerometerScale:
    """What gravity measures, of what it is, and the standard deviation of that."""

    scale: float
    sigma: float


def accelerometer_scale(stream: ImuStream, settings: AccelerometerSettings) -> AccelerometerScale | None:
    """From the mean specific force along the vertical: over a long time nobody accelerates.

    Up and down cancel out, so no rest is needed: on a treadmill there may be none. None without orientation.
    """
    if stream.specific_force is None or stream.R_inertial_sensor is None or len(stream) < 2:
        return None
    vertical = np.einsum("nj,nj->n", stream.R_inertial_sensor[:, 2], stream.specific_force)
    step = np.diff(stream.time)
    measured = step < 2 / stream.rate  # lost samples say nothing
    seconds = float(step[measured].sum())
    if seconds <= 0:
        return None
    mean = float(np.sum((step * (vertical[1:] + vertical[:-1]) / 2)[measured]) / seconds)
    return AccelerometerScale(
        mean / GRAVITY, float(np.hypot(settings.speed_change / (seconds * GRAVITY), settings.least_sigma))
    )


def range_ends(stream: ImuStream, settings: AccelerometerSettings) -> tuple[tuple[int, float], ...]:
    """Axes and values at which an accelerometer's range ends: extremes that repeat themselves, time and again."""
    if stream.specific_force is None:
        return ()
    largest = float(np.max(np.abs(stream.specific_force)))
    return tuple(
        (number, end)
        for number, axis in enumerate(stream.specific_force.T)
        for end in sorted({float(axis.max()), float(axis.min())})
        if abs(end) > LEAST_RANGE
        and abs(end) > 0.9 * largest
        and len(_runs(axis, end, settings)) >= settings.clipped_runs
    )


def clipped_samples(
    stream: ImuStream, ends: Sequence[tuple[int, float]], settings: AccelerometerSettings
) -> np.ndarray:
    """Which samples ``(N,)`` stand at one of the ends of the range for as long as no motion does by itself."""
    clipped = np.zeros(len(stream), bool)
    if stream.specific_force is None:
        return clipped
    for number, end in ends:
        for first, last in _runs(stream.specific_force[:, number], end, settings):
            clipped[first:last] = True
    return clipped


def _runs(axis: Array, end: float, settings: AccelerometerSettings) -> list[tuple[int, int]]:
    """First sample and the one after the last of each run at an end of the range."""
    at_end = np.abs(axis - end) < SAME * abs(end)
    edges = np.flatnonzero(np.diff(np.r_[0, at_end.astype(int), 0]))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2) if b - a >= settings.clipped_samples]
