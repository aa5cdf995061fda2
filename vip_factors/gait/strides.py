"""Strides: from a foot's strike to its next one, with what is told of each, and which of them are no walking.

A stride counts where both feet take turns, as they do in a walk: the other foot leaves the ground, strikes it, then
this foot leaves and strikes. Turns, steps on the spot and pauses are strides too, but no part of means.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.gait.events import SIDES, FootEvents, foot_bones
from vip_factors.geometry.quaternions import interpolate_points
from vip_factors.geometry.rotations import Array, wrap_angle

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
        by_sensor: whether the foot's own sensor told its length.
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
    found = [stride for side in SIDES if side in feet for stride in _of_foot(_Feet(motion, side, feet))]
    times = [one.values["time"] for one in found if not one.left_out]
    usual = float(np.median(times)) if times else np.inf
    return tuple(sorted((_without_pause(one, usual) for one in found), key=lambda one: one.start))


def _without_pause(one: Stride, usual: float) -> Stride:
    pause = 1.6  # times as long as usual: somebody stood in between
    if one.left_out or not one.values["time"] > pause * usual:
        return one
    return Stride(**{**vars(one), "left_out": "pause"})


class _Feet:
    """A foot and the other one, where they are at any time."""

    def __init__(self, motion: Motion, side: str, feet: Mapping[str, FootEvents]) -> None:
        other = "right" if side == "left" else "left"
        self.side, self.events = side, feet[side]
        self.other = feet.get(other, FootEvents(*(np.zeros(0),) * 3, by_sensor=False))
        self._motion, state = motion, motion.state
        self.speed = np.linalg.norm(
            np.gradient(state.p_world_joint[:, foot_bones(side)[0], :2], 1 / motion.rate, axis=0), axis=1
        )
        sole, toes = foot_bones(side)
        tip = motion.skeleton.landmarks.get(f"{side}_toe_tip")
        forward = state.R_world_bone[:, sole, :, 2]
        self._tracks = {
            "ankle": state.p_world_joint[:, sole],
            "other": state.p_world_joint[:, foot_bones(other)[0]],
            "toes": state.p_world_joint[:, toes] if tip is None else state.point(tip.bone, tip.p_bone_point),
            "pitch": np.arcsin(np.clip(forward[:, 2:], -1, 1)),
            "yaw": np.unwrap(np.arctan2(forward[:, 1:2], forward[:, :1]), axis=0),
            "facing": np.unwrap(np.arctan2(state.R_world_bone[:, :1, 1, 2], state.R_world_bone[:, :1, 0, 2]), axis=0),
        }

    def at(self, track: str, time: float) -> Array:
        return interpolate_points(self._motion.time, self._tracks[track], np.array([time]))[0]

    def fastest(self, first: float, last: float) -> float:
        """When between two times the foot is."""
        time = self._motion.time
        i, j = np.searchsorted(time, [first, last])
        return float(time[i + np.argmax(self.speed[i:j])]) if j > i else first


def _of_foot(feet: _Feet) -> Iterator[Stride]:
    own, other = feet.events, feet.other
    least_m = 0.2  # that a foot gains: less is shifting about
    longest_s = 2.5  # the slowest walks have strides of two seconds
    for k in range(len(own) - 1):
        start, off, end = float(own.strike[k]), float(own.off[k + 1]), float(own.strike[k + 1])
        other_off, other_strike = _within(other.off, start, end), _within(other.strike, start, end)
        rests = float(own.rest[k]), float(own.rest[k + 1])
        values = _times(start, off, end, other_off, other_strike)
        values |= _lengths(feet, rests, (off, end), other_strike)
        values["speed"] = values["length"] / values["time"]
        turns = (wrap_angle(feet.at(track, rests[1]) - feet.at(track, rests[0]))[0] for track in ("yaw", "facing"))
        turn = float(np.rad2deg(max(map(abs, turns))))
        alternate = start <= other_off <= other_strike <= off
        reason = (
            "feet do not take turns" if not alternate else "turn" if turn > TURN_DEG else "no step"
            if not values["length"] >= least_m else "pause" if values["time"] > longest_s else ""
        )  # fmt: skip
        yield Stride(feet.side, start, off, end, values, turn, reason)


def _within(times: Array, start: float, end: float) -> float:
    """The only one of some times between two; NaN if there is none or another."""
    inside = times[(times >= start) & (times <= end)]
    return float(inside[0]) if len(inside) == 1 else float("nan")


def _times(start: float, off: float, end: float, other_off: float, other_strike: float) -> dict[str, float]:
    time, both = end - start, (other_off - start) + (off - other_strike)
    found = {"time": time, "cadence": 120 / time, "step_time": end - other_strike}
    for name, value in (("stance", off - start), ("swing", end - off), ("double_support", both)):
        found |= {name: value, f"{name}_percent": 100 * value / time}
    return found


def _lengths(
    feet: _Feet, rests: tuple[float, float], swing: tuple[float, float], other_strike: float
) -> dict[str, float]:
    first, last = (feet.at("ankle", time)[:2] for time in rests)
    way = last - first
    gained = float(np.linalg.norm(way))
    along = way / max(gained, 1e-9)
    # The other foot stands while this one swings: it is looked at in the middle of that.
    beside = feet.at("other", float(np.mean(swing)))[:2] - first
    fast = feet.fastest(*swing)
    share = (fast - rests[0]) / max(rests[1] - rests[0], 1e-9)
    floor = (1 - share) * feet.at("toes", rests[0])[2] + share * feet.at("toes", rests[1])[2]
    pitch = feet.at("pitch", swing[1]) - feet.at("pitch", rests[1])
    return {
        "length": gained,
        "width": float(abs(along[0] * beside[1] - along[1] * beside[0])),
        "step_length": gained - float(along @ beside) if np.isfinite(other_strike) else float("nan"),
        "clearance": float(feet.at("toes", fast)[2] - floor),
        "strike_angle": float(np.rad2deg(pitch[0])),
    }
