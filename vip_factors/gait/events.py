"""When each foot strikes and leaves the ground: from the foot's own sensor, else from how the legs move.

By the sensor: a foot turns its toes down until they leave the ground, up while it swings, and down again from the heel
to the sole. Toe-off lies between the fastest turn down and its end, foot strike between the end of the turn up and the
fastest turn of landing (Mariani et al. 2013, IEEE TBME 60: 3162; Rampp et al. 2015, IEEE TBME 62: 1089). Without a
sensor: the heel is furthest before the pelvis, the ball furthest behind it (Zeni et al. 2008, Gait & Posture 27: 710).
Neither needs the ground to stand still: a treadmill does as well.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import contact_points, joint_index
from vip_factors.geometry.quaternions import interpolate_points
from vip_factors.geometry.rotations import Array, log, transpose
from vip_factors.sensors.imu_stream import ImuStream, low_passed, runs

# What strikes and toe-offs are off by together, one standard deviation, as walks with a reference showed.
EVENT_S = 0.02
# How far from the last zero of the rate to its next extreme a strike is, and from the extreme to zero a toe-off. Of
# three data sets (force plates, hand-checked markers, markers of a shoe) medians are within 35 ms at either end of
# the way, and at these shares within 25 ms in each.
STRIKE_SHARE, OFF_SHARE = 0.25, 0.6
REST_S = 0.06  # over which a foot rests most, between strike and toe-off
# m/s² of specific force off gravity that are as little rest as a turn of 1 rad/s: the noises 0.01 m/s² and 0.1 °/s of
# Skog et al. 2010, IEEE TBME 57: 2657. A foot that slides or lands may turn little.
FORCE_PER_RATE = 0.01 / np.deg2rad(0.1)
LEAST_RATE_HZ = 20.0  # of samples: slower ones do not tell a landing from a swing


@dataclass(frozen=True)
class FootEvents:
    """Swings of a foot, in the order of time, and how it rests after each.

    Attributes:
        off, strike: ``(N,)`` seconds at which it left the ground, and struck it again.
        rest: ``(N,)`` seconds at which it stood most still after the strike, before it left again.
        by_sensor: whether its own sensor measured them, or the motion of the legs.
    """

    off: Array
    strike: Array
    rest: Array
    by_sensor: bool

    def __len__(self) -> int:
        return len(self.strike)


def events_of_sensor(
    stream: ImuStream, R_bone_sensor: Array, shares: tuple[float, float] = (OFF_SHARE, STRIKE_SHARE)
) -> FootEvents | None:
    """By the samples of a sensor on a foot, at their own rate; None if they are too few.

    Args:
        stream: with angular rate, or orientation alone.
        R_bone_sensor: mounting on the foot, whose x is to the wearer's left.
        shares: of the ways of the foot's turn at which toe-offs and strikes lie.
    """
    if len(stream) < 2 or stream.rate < LEAST_RATE_HZ:
        return None
    time, rate = np.arange(stream.time[0], stream.time[-1], 1 / stream.rate), stream.rate
    if len(time) < rate:
        return None
    turning = interpolate_points(*angular_rate(stream), time) @ R_bone_sensor.T
    swing_hz, event_hz = 6.0, 12.0  # of low passes: what a swing is made of, and what its ends are
    swing, toes_up = (low_passed(-turning[:, 0], rate, min(hz, 0.45 * rate)) for hz in (swing_hz, event_hz))
    off, strike = [], []
    # Toes turn up by three quarters of a right angle in a swing of a walk, by less when shuffling.
    least_swing_deg = 20.0
    for start, stop in runs(swing > 0).tolist():
        if np.sum(swing[start:stop]) / rate >= np.deg2rad(least_swing_deg):
            ends = _swing_ends(time, toes_up, start, stop, rate, shares)
            if ends is not None:
                off.append(ends[0])
                strike.append(ends[1])
    restless = np.sum(turning**2, axis=1)
    if stream.specific_force is not None:
        force = np.linalg.norm(interpolate_points(stream.time, stream.specific_force, time), axis=1)
        restless += ((force - 9.81) / FORCE_PER_RATE) ** 2
    return _events(off, strike, time, uniform_filter1d(restless, max(1, round(REST_S * rate))), True)


def angular_rate(stream: ImuStream) -> tuple[Array, Array]:
    """Times and rates in the sensor's axes: of orientation over the steps between its samples.

    Beside an orientation some makers log as a sample's rate its mean since the one before, which is half a step late.
    """
    if stream.R_inertial_sensor is None:
        assert stream.angular_rate is not None
        return stream.time, stream.angular_rate
    R, time = stream.R_inertial_sensor, stream.time
    return (time[1:] + time[:-1]) / 2, log(transpose(R[:-1]) @ R[1:]) / np.diff(time)[:, None]


def _swing_ends(
    time: Array, toes_up: Array, start: int, stop: int, rate: float, shares: tuple[float, float]
) -> tuple[float, float] | None:
    push_s, landing_s, near_s = 0.3, 0.15, 0.12  # longest from fastest push-off to swing, from swing to fastest landing
    near, last_sample = round(near_s * rate), len(time) - 1
    sign = toes_up > 0
    rises = [k for k in range(max(start - near, 0), min(start + near, last_sample)) if not sign[k] and sign[k + 1]]
    falls = [k for k in range(max(stop - near, 0), min(stop + near, last_sample)) if sign[k] and not sign[k + 1]]
    if not rises or not falls:
        return None
    rise, fall = min(rises, key=lambda k: abs(k - start)), min(falls, key=lambda k: abs(k - stop))
    push_start = max(rise - round(push_s * rate), 0)
    push = push_start + int(np.argmin(toes_up[push_start : rise + 1]))
    landing = fall + int(np.argmin(toes_up[fall : fall + round(landing_s * rate) + 1]))
    up, down = _zero(time, toes_up, rise), _zero(time, toes_up, fall)
    off = _between(_extreme(time, -toes_up, push), up, shares[0])
    return off, _between(down, _extreme(time, -toes_up, landing), shares[1])


def events_of_motion(motion: Motion, side: str) -> FootEvents:
    """By how far heel and ball are before the pelvis, in the direction it faces, and the foot's own speed."""
    state = motion.state
    (bone, heel), (_, ball) = contact_points(motion.skeleton)[slice(0, 2) if side == "left" else slice(2, 4)]
    forward = state.R_world_bone[:, 0, :2, 2]
    forward = forward / np.maximum(np.linalg.norm(forward, axis=1, keepdims=True), 1e-9)
    pelvis = state.p_world_joint[:, 0]
    heels, balls = (state.point(bone, point) for point in (heel, ball))
    heels_ahead, behind = (np.sum((points - pelvis)[:, :2] * forward, axis=1) for points in (heels, balls))
    strike_late_s = 0.02  # after the heel was furthest before the pelvis: it goes back a little before it lands
    strikes, offs = _peaks(motion.time, heels_ahead) + strike_late_s, _peaks(motion.time, -behind)
    off, strike = list[float](), list[float]()
    for strike_time in strikes:  # each with the last toe-off since the strike before
        offs_between = offs[(offs < strike_time) & (offs > (strike[-1] if strike else -np.inf))]
        if len(offs_between):
            off.append(float(offs_between[-1]))
            strike.append(float(strike_time))
    speed = np.linalg.norm(np.gradient(state.p_world_joint[:, bone], 1 / motion.rate, axis=0), axis=1)
    restless = uniform_filter1d(speed, max(1, round(REST_S * motion.rate)))
    return _events(off, strike, motion.time, restless, False)


def _peaks(time: Array, values: Array) -> Array:
    if len(values) < 3:
        return np.zeros(0)
    from scipy.signal import find_peaks  # late: it takes long to import

    least_reach_m = 0.15  # that a heel or ball goes forward and back by, against the pelvis, in a step
    peaks, _ = find_peaks(values, prominence=least_reach_m)
    return np.array([_extreme(time, values, int(k)) for k in peaks])


def _events(off: list[float], strike: list[float], time: Array, restless: Array, by_sensor: bool) -> FootEvents:
    rests = []
    # A foot that is not seen to leave, or stands on, rests as long after its strike as in a usual stance: later it may
    # have made a step too small to be an event.
    stances = np.subtract(off[1:], strike[:-1])
    usual_s, longest_s = (float(np.median(stances)), 2 * float(np.median(stances))) if len(stances) else (1.5, 1.5)
    for k, strike_time in enumerate(strike):
        rest_end = off[k + 1] if k + 1 < len(off) and off[k + 1] < strike_time + longest_s else strike_time + usual_s
        start, end = np.searchsorted(time, [strike_time, max(rest_end, strike_time)])
        end = min(end, len(time) - 1)
        rests.append(float(time[start + np.argmin(restless[start : end + 1])]) if start < end else float(time[end]))
    return FootEvents(np.array(off), np.array(strike), np.array(rests), by_sensor)


def foot_bones(side: str) -> tuple[int, int]:
    """Bones of the sole and of the toes."""
    return joint_index(f"{side}_ankle"), joint_index(f"{side}_foot")


def _zero(time: Array, values: Array, k: int) -> float:
    """Between samples ``k`` and the next, linearly."""
    return _between(time[k], time[k + 1], float(values[k] / (values[k] - values[k + 1])))


def _extreme(time: Array, values: Array, k: int) -> float:
    """Vertex of the parabola through a largest value and its neighbours."""
    if not 0 < k < len(values) - 1:
        return float(time[k])
    previous_value, top, next_value = values[k - 1 : k + 2]
    bend = previous_value - 2 * top + next_value
    return float(time[k] + (0.5 * (previous_value - next_value) / bend if bend < 0 else 0.0) * (time[k + 1] - time[k]))


def _between(start: float, end: float, share: float) -> float:
    return float(start + share * (end - start))
