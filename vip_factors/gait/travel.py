"""How far a foot came between two moments at rest, by its own sensor: specific force integrated twice.

Orientation tells which way is up; at rest the foot does not move, so what the first integral is off by at the end was
picked up on the way. It is taken back in proportion to the square of the acceleration, as if an accelerometer erred by
a share of what it measures: most of it comes in at the landing, whose blows are clipped and fall between samples.
"""

import itertools

import numpy as np

from vip_factors.errors import RecordingError
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.imu_stream import ImuStream, with_orientation

LEAST_RATE_HZ = 60.0  # of samples: at 30 to 47 Hz lengths were off by decimetres, and toe-offs by 20 to 40 ms
LONGEST_S = 3.0  # between two rests: errors grow with the square of it
WIDEST_GAP_S = 0.05  # of lost samples in between
GRAVITY = np.array([0.0, 0.0, 9.81])


def travel_of_sensor(stream: ImuStream, rest: Array) -> tuple[Array, Array]:
    """Between each rest and the next, along the floor, of rests at ``(N,)`` seconds.

    Returns:
        Lengths ``(N-1,)`` in metres and their standard deviations; NaN where the samples do not tell.
    """
    lengths = np.full((2, max(len(rest) - 1, 0)), np.nan)
    if stream.specific_force is None or stream.rate < LEAST_RATE_HZ or not lengths.size:
        return lengths[0], lengths[1]
    try:
        stream = with_orientation(stream)
    except RecordingError:  # its samples do not allow an orientation
        return lengths[0], lengths[1]
    assert stream.R_inertial_sensor is not None
    assert stream.specific_force is not None
    acceleration = (stream.R_inertial_sensor @ stream.specific_force[..., None])[..., 0] - GRAVITY
    at = np.clip(np.searchsorted(stream.time, rest), 0, len(stream) - 1)
    left_over = np.full(len(rest) - 1, np.nan)
    for k, (first, last) in enumerate(itertools.pairwise(at)):
        time = stream.time[first : last + 1]
        if len(time) < 3 or time[-1] - time[0] > LONGEST_S or np.max(np.diff(time)) > WIDEST_GAP_S:
            continue
        lengths[0, k], left_over[k], lengths[1, k] = _travelled(time, acceleration[first : last + 1])
    # One stride's remainder says little about how large such remainders are: all of them say it.
    known = left_over[np.isfinite(left_over)]
    return lengths[0], lengths[1] * (np.sqrt(np.mean(known**2)) if len(known) else np.nan)


def _travelled(time: Array, acceleration: Array) -> tuple[float, float, float]:
    """Length, m; what of the velocity was left over at the end, m/s an axis; and by how much of it the length errs, s.

    Errors of velocity that pile up like a random walk in a time ``u`` from 0 to 1, and are tied to zero at both ends,
    have a covariance of ``min(u, u') − u u'``; its double integral is the variance of the length.
    """
    from scipy.integrate import cumulative_trapezoid  # late: it takes long to import

    velocity = cumulative_trapezoid(acceleration, time, axis=0, initial=0)
    u = np.asarray(cumulative_trapezoid(np.asarray(np.sum(acceleration**2, axis=1)), time, initial=0))
    u /= max(float(u[-1]), 1e-9)
    length = float(np.linalg.norm(np.trapezoid(velocity - u[:, None] * velocity[-1], time, axis=0)[:2]))
    variance = 2 * np.trapezoid(u * (time[-1] - time), time) - np.trapezoid(u, time) ** 2
    return length, float(np.linalg.norm(velocity[-1, :2]) / np.sqrt(2)), float(np.sqrt(max(variance, 0.0)))
