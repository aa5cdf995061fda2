"""How far a foot came from one rest to the next, by inertial sensors on the foot or on the shank.

Specific force is integrated twice; orientation tells which way is up. At rest the foot does not move, so what the first
integral is off by at the end was picked up on the way.

Of a foot's own sensor it is taken back in proportion to the square of the acceleration, as if an accelerometer erred by
a share of what it measures: most of it comes in at the landing, whose blows are clipped and fall between samples.

A slow sensor misses most of the landing: at 30 to 40 Hz lengths by a foot are off by 15 to 20 cm even with its true
orientation. A shank swings more smoothly, and is followed no further than shortly before the landing; what remains of
the stride is as the motion has it. Left over at the end of a stride are there the blow, which differs from stride to
stride, and what tilt and accelerometer are off by, which does not: the middle of all strides is taken back evenly.
"""

import itertools

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.errors import RecordingError
from vip_factors.gait.events import EVENT_S, FootEvents, angular_rate, foot_bones
from vip_factors.geometry.quaternions import interpolate_points
from vip_factors.geometry.rotations import Array, rotation_z
from vip_factors.sensors.calibration import SensorCalibration
from vip_factors.sensors.imu_stream import ImuStream, with_orientation

LEAST_RATE_HZ = 60.0  # of samples of a foot: at 30 to 47 Hz lengths were off by decimetres, toe-offs by 20 to 40 ms
GRAVITY = np.array([0.0, 0.0, 9.81])


def travel_of_foot(stream: ImuStream, rest: Array) -> Array:
    """Lengths ``(N-1,)`` in metres between each rest and the next, along the floor; NaN where the samples do not tell.

    Args:
        stream: of a sensor on the foot.
        rest: ``(N,)`` seconds.
    """
    lengths = np.full(max(len(rest) - 1, 0), np.nan)
    turned = _oriented(stream) if stream.rate >= LEAST_RATE_HZ else None
    if turned is None:
        return lengths
    acceleration = _acceleration(turned)
    for k, (first, last) in enumerate(itertools.pairwise(_samples(turned, rest))):
        if _is_whole(turned.time[first : last + 1]):
            lengths[k] = _travelled(turned.time[first : last + 1], acceleration[first : last + 1])
    return lengths


def stretch_by_shank(
    motion: Motion, side: str, stream: ImuStream, calibration: SensorCalibration, p_bone_sensor: Array, feet: FootEvents
) -> Array:
    """By how much strides are longer than in a motion, as factors ``(N-1,)``; NaN where the samples do not tell.

    Args:
        motion: of the wearer.
        side: ``left`` or ``right``.
        stream: of a sensor on the shank.
        calibration: its heading and mounting.
        p_bone_sensor: ``(3,)`` metres, where it sits.
        feet: events of that side's foot.
    """
    from scipy.integrate import cumulative_trapezoid  # late: it takes long to import

    factors = np.full(max(len(feet) - 1, 0), np.nan)
    turned = _oriented(stream)
    if turned is None:
        return factors
    time, ankle = turned.time, foot_bones(side)[0]
    R_world_inertial = rotation_z(np.broadcast_to(calibration.heading_at(time), time.shape))
    p_sensor_ankle = calibration.R_bone_sensor.T @ (motion.skeleton.p_parent_joint[ankle] - p_bone_sensor)
    turning = interpolate_points(*angular_rate(turned), time)
    swept = _rotated(R_world_inertial, _rotated(turned.R_inertial_sensor, np.cross(turning, p_sensor_ankle)))
    acceleration = _rotated(R_world_inertial, _acceleration(turned))
    p = interpolate_points(motion.time, motion.state.p_world_joint[:, ankle], time)
    before = EVENT_S + 1 / turned.rate  # a strike may be later than it was found, and lies between samples
    found = list[Array]()
    for k, (first, last) in enumerate(itertools.pairwise(_samples(turned, feet.rest))):
        landing = int(np.searchsorted(time, feet.strike[k + 1] - before, side="right")) - 1
        way = (p[last] - p[first])[:2]
        gained = float(np.linalg.norm(way))
        if landing - first < 2 or gained == 0.0 or not _is_whole(time[first : last + 1]):
            continue
        velocity = cumulative_trapezoid(acceleration[first : last + 1], time[first : last + 1], axis=0, initial=0)
        velocity += swept[first : last + 1] - swept[first]  # of the ankle, which rests
        swing = np.trapezoid(velocity[: landing - first + 1], time[first : landing + 1], axis=0)
        further = (swing - (p[landing] - p[first]))[:2] @ way / gained
        left_over = velocity[-1, :2] @ way / gained / (time[last] - time[first])
        found.append(np.array([k, further / gained, left_over, (time[landing] - time[first]) ** 2 / 2 / gained]))
    if found:
        which, further_share, all_left_over, taken_share = np.stack(found, axis=1)
        factors[which.astype(int)] = 1 + further_share - np.median(all_left_over) * taken_share
    return factors


def _oriented(stream: ImuStream) -> ImuStream | None:
    """With specific force and orientation, or None."""
    if stream.specific_force is None:
        return None
    try:
        return with_orientation(stream)
    except RecordingError:  # its samples do not allow an orientation
        return None


def _acceleration(stream: ImuStream) -> Array:
    """Of the sensor ``(N, 3)`` m/s², in its inertial frame."""
    return _rotated(stream.R_inertial_sensor, stream.specific_force) - GRAVITY


def _rotated(R: Array | None, v: Array | None) -> Array:
    assert R is not None
    assert v is not None
    return (R @ v[..., None])[..., 0]


def _samples(stream: ImuStream, at: Array) -> np.ndarray:
    """The first from each of some times on."""
    return np.clip(np.searchsorted(stream.time, at), 0, len(stream) - 1)


def _is_whole(time: Array) -> bool:
    longest_s = 3.0  # between two rests: errors grow with the square of it
    widest_gap_s = 0.05  # of lost samples in between
    return len(time) >= 3 and time[-1] - time[0] <= longest_s and bool(np.max(np.diff(time)) <= widest_gap_s)


def _travelled(time: Array, acceleration: Array) -> float:
    """Length in metres along the floor, from rest to rest."""
    from scipy.integrate import cumulative_trapezoid  # late: it takes long to import

    velocity = cumulative_trapezoid(acceleration, time, axis=0, initial=0)
    u = np.asarray(cumulative_trapezoid(np.asarray(np.sum(acceleration**2, axis=1)), time, initial=0))
    u /= max(float(u[-1]), 1e-9)
    return float(np.linalg.norm(np.trapezoid(velocity - u[:, None] * velocity[-1], time, axis=0)[:2]))
