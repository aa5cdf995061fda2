"""Strides: from a foot's strike to its next one, with their parameters, and the strides that are no steady walking.

A stride counts where both feet take turns, as they do in a walk: the other foot leaves the ground, strikes it, then
this foot leaves and strikes. Turns, first and last steps, steps on the spot and pauses are strides too, but no part of
means.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import SIDES
from vip_factors.errors import RecordingError
from vip_factors.gait.events import EVENT_S, FootEvents, angular_rate, foot_bones
from vip_factors.geometry.quaternions import interpolate_points
from vip_factors.geometry.rotations import Array, rotation_z, wrap_angle
from vip_factors.sensors.calibration import SensorCalibration
from vip_factors.sensors.imu_stream import ImuStream, with_orientation

LEAST_RATE_HZ = 60.0  # of samples of a foot: at 30 to 47 Hz lengths were off by decimetres, toe-offs by 20 to 40 ms
GRAVITY = np.array([0.0, 0.0, 9.81])


def travel_of_foot(stream: ImuStream, rests: Array) -> Array:
    """Lengths ``(N-1,)`` in metres between each rest and the next, along the floor; NaN where the samples do not tell.

    Args:
        stream: of a sensor on the foot.
        rest: ``(N,)`` seconds.
    """
    from scipy.integrate import cumulative_trapezoid  # late: it takes long to import

    lengths = np.full(max(len(rests) - 1, 0), np.nan)
    turned = _oriented(stream) if stream.rate >= LEAST_RATE_HZ else None
    if turned is None:
        return lengths
    acceleration = _acceleration(turned)
    for k, (start, end) in enumerate(itertools.pairwise(_samples(turned, rests))):
        time, a = turned.time[start : end + 1], acceleration[start : end + 1]
        if _is_whole(time):
            velocity = cumulative_trapezoid(a, time, axis=0, initial=0)
            u = np.asarray(cumulative_trapezoid(np.asarray(np.sum(a**2, axis=1)), time, initial=0))
            u /= max(float(u[-1]), 1e-9)
            path = np.trapezoid(velocity - u[:, None] * velocity[-1], time, axis=0)
            lengths[k] = np.linalg.norm(path[:2])
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
    margin_s = EVENT_S + 1 / turned.rate  # a strike may be later than it was found, and lies between samples
    stretches = list[Array]()
    for k, (start, end) in enumerate(itertools.pairwise(_samples(turned, feet.rest))):
        landing = int(np.searchsorted(time, feet.strike[k + 1] - margin_s, side="right")) - 1
        path = (p[end] - p[start])[:2]
        gained = float(np.linalg.norm(path))
        if landing - start < 2 or gained == 0.0 or not _is_whole(time[start : end + 1]):
            continue
        velocity = cumulative_trapezoid(acceleration[start : end + 1], time[start : end + 1], axis=0, initial=0)
        velocity += swept[start : end + 1] - swept[start]  # of the ankle, which rests
        swing = np.trapezoid(velocity[: landing - start + 1], time[start : landing + 1], axis=0)
        further = (swing - (p[landing] - p[start]))[:2] @ path / gained
        left_over = velocity[-1, :2] @ path / gained / (time[end] - time[start])
        stretches.append(np.array([k, further / gained, left_over, (time[landing] - time[start]) ** 2 / 2 / gained]))
    if stretches:
        which, further_share, all_left_over, taken_share = np.stack(stretches, axis=1)
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
    """Acceleration of the sensor ``(N, 3)`` in its inertial frame, m/s²."""
    return _rotated(stream.R_inertial_sensor, stream.specific_force) - GRAVITY


def _rotated(R: Array | None, v: Array | None) -> Array:
    assert R is not None
    assert v is not None
    return (R @ v[..., None])[..., 0]


def _samples(stream: ImuStream, times: Array) -> np.ndarray:
    """The first from each of some times on."""
    return np.clip(np.searchsorted(stream.time, times), 0, len(stream) - 1)


def _is_whole(time: Array) -> bool:
    longest_s = 3.0  # between two rests: errors grow with the square of it
    widest_gap_s = 0.05  # of lost samples in between
    return len(time) >= 3 and time[-1] - time[0] <= longest_s and bool(np.max(np.diff(time)) <= widest_gap_s)


Unsteady = Literal["start", "stop", "turn", "pause"]
"""Why a stride of a walk is no part of means."""
TURN_DEG = 20.0  # that a foot or the pelvis turns by in a stride: straight on it is some 5, half a turn takes three


@dataclass(frozen=True)
class Quantity:
    """One number of a stride: its name, its unit, what it is in words, and how many decimals mean something."""

    name: str
    unit: str
    words: str
    decimals: int


QUANTITIES = (
    Quantity("time", "s", "stride time", 3),
    Quantity("length", "m", "stride length", 3),
    Quantity("width", "m", "stride width", 3),
    Quantity("speed", "m/s", "speed", 3),
    Quantity("cadence", "steps/min", "cadence", 1),
    Quantity("step_time", "s", "step time", 3),
    Quantity("step_length", "m", "step length", 3),
    Quantity("stance", "s", "stance", 3),
    Quantity("swing", "s", "swing", 3),
    Quantity("double_support", "s", "double support", 3),
    Quantity("stance_percent", "%", "stance, of the cycle", 1),
    Quantity("swing_percent", "%", "swing, of the cycle", 1),
    Quantity("double_support_percent", "%", "double support, of the cycle", 1),
    Quantity("clearance", "m", "toe clearance in mid-swing", 3),
    Quantity("strike_angle", "deg", "foot angle at strike, toes up", 1),
)


@dataclass(frozen=True)
class Stride:
    """One stride of a foot.

    Attributes:
        side: ``left`` or ``right``.
        start, off, end: seconds of its strike, its toe-off, and its next strike.
        values: by the names of :data:`QUANTITIES`; NaN where not known. ``length`` is between where the foot stood
            after either strike, ``width`` how far beside that line the other foot stood, ``step_length`` how far
            before the other foot this one came, ``double_support`` that of both of a cycle, ``clearance`` the height of
            the toes' tips over where they stood, when the foot is fastest (Winter 1992, Phys. Ther. 72: 45), and
            ``strike_angle`` against the same foot at rest.
        turn_deg: by how much the foot or the pelvis turned, whichever did more.
        left_out: why it is no part of means; empty if it is.
        by_sensor: whether the foot's own sensor measured its length.
    """

    side: str
    start: float
    off: float
    end: float
    values: Mapping[str, float]
    turn_deg: float
    left_out: str
    by_sensor: bool = False


def strides_of(motion: Motion, feet: Mapping[str, FootEvents]) -> tuple[Stride, ...]:
    """All strides of both feet, in the order of time, with lengths as the motion has them.

    Args:
        motion: in a world with z up.
        feet: events by side.
    """
    strides = [stride for side in SIDES if side in feet for stride in _of_foot(_Feet(motion, side, feet))]
    times = [stride.values["time"] for stride in strides if not stride.left_out]
    usual = float(np.median(times)) if times else np.inf
    pause = 1.6 * usual  # somebody stood in between
    strides = [
        replace(stride, left_out="pause") if not stride.left_out and stride.values["time"] > pause else stride
        for stride in strides
    ]
    return tuple(sorted(strides, key=lambda stride: stride.start))


def without_starts_and_stops(strides: Sequence[Stride]) -> tuple[Stride, ...]:
    """The strides, those at an end of a walk that are slower than the median left out.

    A walk ends at a turn, a pause or the end of the recording. Steady strides differ in speed by some 3 %.
    """
    slow_share = 0.9  # of the median speed: it takes a walker one to three strides to reach it
    speeds = [stride.values["speed"] for stride in strides if not stride.left_out]
    slow = slow_share * float(np.median(speeds)) if speeds else 0.0
    result = list(strides)
    for side in SIDES:
        side_indices = [k for k, stride in enumerate(strides) if stride.side == side]
        ways: tuple[tuple[Unsteady, list[int]], ...] = (("start", side_indices), ("stop", side_indices[::-1]))
        for reason, order in ways:
            is_end = True
            for k in order:
                is_slow = result[k].values["speed"] < slow
                if is_end and is_slow and not result[k].left_out:
                    result[k] = replace(result[k], left_out=reason)
                is_end = bool(result[k].left_out)
    return tuple(result)


class _Feet:
    """A foot and the other one, where they are at any time."""

    def __init__(self, motion: Motion, side: str, feet: Mapping[str, FootEvents]) -> None:
        other_side = "right" if side == "left" else "left"
        self.side, self.events = side, feet[side]
        self.other = feet.get(other_side, FootEvents(*(np.zeros(0),) * 3, by_sensor=False))
        self._motion, state = motion, motion.state
        self.speed = np.linalg.norm(
            np.gradient(state.p_world_joint[:, foot_bones(side)[0], :2], 1 / motion.rate, axis=0), axis=1
        )
        sole, toes = foot_bones(side)
        tip = motion.skeleton.landmarks.get(f"{side}_toe_tip")
        forward = state.R_world_bone[:, sole, :, 2]
        self._tracks = {
            "ankle": state.p_world_joint[:, sole],
            "other": state.p_world_joint[:, foot_bones(other_side)[0]],
            "toes": state.p_world_joint[:, toes] if tip is None else state.point(tip.bone, tip.p_bone_point),
            "pitch": np.arcsin(np.clip(forward[:, 2:], -1, 1)),
            "yaw": np.unwrap(np.arctan2(forward[:, 1:2], forward[:, :1]), axis=0),
            "facing": np.unwrap(np.arctan2(state.R_world_bone[:, :1, 1, 2], state.R_world_bone[:, :1, 0, 2]), axis=0),
        }

    def at(self, track: str, time: float) -> Array:
        return interpolate_points(self._motion.time, self._tracks[track], np.array([time]))[0]

    def fastest(self, start: float, end: float) -> float:
        """When between two times the foot is."""
        time = self._motion.time
        i, j = np.searchsorted(time, [start, end])
        return float(time[i + np.argmax(self.speed[i:j])]) if j > i else start


def _of_foot(feet: _Feet) -> Iterator[Stride]:
    events, other_foot = feet.events, feet.other
    least_m = 0.2  # that a foot gains: less is shifting about
    longest_s = 2.5  # the slowest walks have strides of two seconds
    for k in range(len(events) - 1):
        start, off, end = float(events.strike[k]), float(events.off[k + 1]), float(events.strike[k + 1])
        other_off, other_strike = _within(other_foot.off, start, end), _within(other_foot.strike, start, end)
        rests = float(events.rest[k]), float(events.rest[k + 1])
        values = _times(start, off, end, other_off, other_strike)
        values |= _lengths(feet, rests, (off, end), other_strike)
        values["speed"] = values["length"] / values["time"]
        turns = (wrap_angle(feet.at(track, rests[1]) - feet.at(track, rests[0]))[0] for track in ("yaw", "facing"))
        turn = float(np.rad2deg(max(map(abs, turns))))
        alternate = start <= other_off <= other_strike <= off
        reason = (
            "feet do not take turns"
            if not alternate
            else "turn"
            if turn > TURN_DEG
            else "no step"
            if not values["length"] >= least_m
            else "pause"
            if values["time"] > longest_s
            else ""
        )
        yield Stride(feet.side, start, off, end, values, turn, reason)


def _within(times: Array, start: float, end: float) -> float:
    """The only one of some times between two; NaN if there is none or another."""
    inside = times[(times >= start) & (times <= end)]
    return float(inside[0]) if len(inside) == 1 else float("nan")


def _times(start: float, off: float, end: float, other_off: float, other_strike: float) -> dict[str, float]:
    time, double_support = end - start, (other_off - start) + (off - other_strike)
    values = {"time": time, "cadence": 120 / time, "step_time": end - other_strike}
    for name, value in (("stance", off - start), ("swing", end - off), ("double_support", double_support)):
        values |= {name: value, f"{name}_percent": 100 * value / time}
    return values


def _lengths(
    feet: _Feet, rests: tuple[float, float], swing: tuple[float, float], other_strike: float
) -> dict[str, float]:
    start, end = (feet.at("ankle", time)[:2] for time in rests)
    path = end - start
    gained = float(np.linalg.norm(path))
    along = path / max(gained, 1e-9)
    # The other foot stands while this one swings: it is looked at in the middle of that.
    offset = feet.at("other", float(np.mean(swing)))[:2] - start
    fast = feet.fastest(*swing)
    share = (fast - rests[0]) / max(rests[1] - rests[0], 1e-9)
    floor = (1 - share) * feet.at("toes", rests[0])[2] + share * feet.at("toes", rests[1])[2]
    pitch = feet.at("pitch", swing[1]) - feet.at("pitch", rests[1])
    return {
        "length": gained,
        "width": float(abs(along[0] * offset[1] - along[1] * offset[0])),
        "step_length": gained - float(along @ offset) if np.isfinite(other_strike) else float("nan"),
        "clearance": float(feet.at("toes", fast)[2] - floor),
        "strike_angle": float(np.rad2deg(pitch[0])),
    }
