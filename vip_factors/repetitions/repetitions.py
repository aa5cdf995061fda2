"""Repetitions in a motion: dips of the pelvis are squats and lunges, free falls are jumps, bends of elbows are curls.

A dip is a low of the pelvis over the lower foot. It begins and ends where the pelvis is at rest or as high as before;
the time within a tenth of the lowest is the hold, what lies before and after the ways down and up. A curl is the same
of the elbow's flexion while the upper arm hangs. Both count where at least two alike follow each other: a single bow is
no exercise. A jump counts by itself: the centre of mass falls freely while both feet are off the floor.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.body.model_errors import shape_factor
from vip_factors.body.skeleton import SIDES
from vip_factors.errors import InputError
from vip_factors.estimate import Estimate, WearerEstimate
from vip_factors.geometry.rotations import Array
from vip_factors.repetitions.repetition import UNKNOWN, Kind, Measured, Repetition, Side, WearerRepetitions
from vip_factors.repetitions.signals import Signals, signals_of

GRAVITY = 9.81  # m/s²
LEAST_DEPTH = 0.12  # lengths of a leg: who walks sinks by 0.09 at most, shallow squats are 0.18 and deeper


@dataclass(frozen=True)
class _Low:
    """A low of the reach or a bend: its depth, its width at half of that, and its frames, which may lie between two."""

    depth: float
    width: float
    start: float
    held: float
    turn: int
    left: float
    end: float


def all_repetitions(estimate: Estimate) -> tuple[WearerRepetitions, ...]:
    """Of every wearer, with standard deviations if the estimate has a covariance.

    Raises:
        InputError: if one has no frames.
    """
    return tuple(repetitions_of(one) for one in estimate.wearers)


def repetitions_of(wearer: WearerEstimate) -> WearerRepetitions:
    """Of one wearer; see :func:`all_repetitions`."""
    name = wearer.motion.name or wearer.name
    if not len(wearer.motion):
        raise InputError(f"estimate of '{name}' has no frames: expected a motion to look for repetitions in")
    signals = signals_of(wearer)
    fewest = 3  # frames: with fewer nothing is higher than what is beside it
    if len(wearer.motion) < fewest:
        return WearerRepetitions(name, signals, ())
    lows = _lows(-signals.reach, 0.25 * LEAST_DEPTH * signals.legs, signals.motion.rate)
    jumps = [_jump(signals, one, lows) for one in _flights(signals)]
    deep = [one for one in lows if one.depth >= LEAST_DEPTH * signals.legs]
    dips = [dip for one in deep if (dip := _dip(signals, one)) is not None]
    free = [one for one in dips if not any(jump.start <= one.turn <= jump.end for jump in jumps)]
    sets = [_sets([one for one in free if one.kind == kind]) for kind in ("squat", "lunge")]
    curls = _sets(list(_curls(signals)))
    found = sorted([*jumps, *sets[0], *sets[1], *curls], key=lambda one: one.start)
    return WearerRepetitions(name, signals, tuple(found))


def _lows(values: Array, least: float, rate: float) -> list[_Low]:
    """Highs of ``values`` ``(T,)`` that stand out by ``least`` at least."""
    from scipy.signal import find_peaks, peak_widths  # late: it takes long to load

    peaks, properties = find_peaks(values, prominence=least)
    depths = properties["prominences"]
    prominence = (depths, properties["left_bases"], properties["right_bases"])
    shares = (0.98, 0.5, 0.1)  # of a low's depth below its rim: it begins and ends; half; it is held
    (starts, ends), (down, up), (held, left) = (peak_widths(values, peaks, share, prominence)[2:] for share in shares)
    speed = np.abs(np.gradient(values, 1 / rate))
    lows = list[_Low]()
    for depth, start, half, hold, turn, leave, back, end in zip(
        depths, starts, down, held, peaks.tolist(), left, up, ends, strict=True
    ):
        if lows and lows[-1].turn >= start and turn <= lows[-1].end:
            continue  # as deep as the one before to the last digit: one that is held
        begin = _moves_from(speed, int(half), int(np.ceil(start)), -1)
        lows.append(
            _Low(depth, back - half, begin, hold, turn, leave, _moves_from(speed, int(np.ceil(back)), int(end), 1))
        )
    return lows


def _moves_from(speed: Array, half: int, rim: int, step: int) -> float:
    """The frame at which a way begins or ends: the last at speed, from where it is half done towards the rim.

    Who stands sways, and goes down slowly long before a squat.
    """
    way = np.arange(half, rim + step, step)
    if not len(way):
        return float(rim)
    moving = 0.05  # of a way's greatest speed: what is slower is not on the way yet
    slow = np.flatnonzero(speed[way] < moving * speed[way].max())
    return float(way[slow[0]] if len(slow) else rim)


def _dip(signals: Signals, low: _Low) -> Repetition | None:
    """A squat or a lunge, if a low of the pelvis is one."""
    knees = [signals.flexion(side, "knee")[low.turn] for side in SIDES]
    hips = [signals.flexion(side, "hip")[low.turn] for side in SIDES]
    level = abs(signals.height("left_foot")[low.turn] - signals.height("right_foot")[low.turn]) / signals.legs
    apart = signals.apart[low.turn] / signals.legs
    lunge_apart = 0.4  # lengths of a leg between the ankles, fore and aft: squats 0.2 at most, lunges 0.6 and more
    feet_level = 0.25  # lengths of a leg between the balls of both feet on the floor: soles roll, and estimates err
    least_knee_deg = 45.0  # of a walker's two knees one is below 35; of squats both are above 60
    least_hip_deg = 30.0  # who sinks without bending the hips leans back, kneels or lies down
    # Beyond half of the depth: quick squats 0.69 s and more; before and after jumps, and boxers 0.57 at most. The
    # geometric mean of both; with any one recording left out, the limit that the others give still tells it.
    least_dip_s = 0.63
    is_lunge = abs(apart) >= lunge_apart
    bent = min(knees) >= least_knee_deg and (max(hips) if is_lunge else min(hips)) >= least_hip_deg
    if not bent or level > feet_level or low.width < least_dip_s * signals.motion.rate:
        return None
    side: Side = "both" if not is_lunge else "left" if apart > 0 else "right"
    sunk = _repetition(signals, "lunge" if is_lunge else "squat", side, low, "knee")
    return replace(sunk, depth_m=_depth(signals, low))


def _repetition(signals: Signals, kind: Kind, side: Side, low: _Low, joint: str) -> Repetition:
    """What is told of any low."""
    frames = np.arange(len(signals.time))
    start, held, left, end = (
        float(np.interp(at, frames, signals.time)) for at in (low.start, low.held, low.left, low.end)
    )
    sides = SIDES if side == "both" or joint == "knee" else (side,)
    names = [f"{one}_{angle}" for angle in PRINCIPAL[joint] for one in sides]
    margin = 0.2 * signals.motion.rate  # joints begin to bend before the pelvis sinks to be seen
    window = slice(max(0, int(low.start - margin)), int(np.ceil(low.end + margin)) + 1)
    ranges = {name: _range(signals, name, window) for name in names}
    bends = [f"{one}_{joint}_flexion" for one in sides]
    depth = np.mean([signals.angles.of(name)[low.turn] for name in bends])
    sigma = np.linalg.norm([signals.sigma(name)[low.turn] for name in bends]) / len(bends)
    differ = Measured()
    if side == "both":
        left_range, right_range = (ranges[name] for name in bends)
        differ = Measured(left_range.value - right_range.value, float(np.hypot(left_range.sigma, right_range.sigma)))
    return Repetition(
        kind, side, start, float(signals.time[low.turn]), end, held - start, left - held, end - left, Measured(),
        Measured(float(depth), float(sigma)), ranges, differ,
    )  # fmt: skip


PRINCIPAL = {"knee": ("hip_flexion", "knee_flexion", "ankle_dorsiflexion"), "elbow": ("elbow_flexion",)}


def _range(signals: Signals, name: str, window: slice) -> Measured:
    """Of an angle between its least and most; what of its error is constant is in both."""
    values, sigmas = signals.angles.of(name)[window], signals.sigma(name)[window]
    ends = [int(np.argmin(values)), int(np.argmax(values))]
    joint = name.rpartition("_")[0]
    return Measured(float(np.ptp(values)), shape_factor(joint) * float(np.linalg.norm(sigmas[ends])))


def _depth(signals: Signals, low: _Low) -> Measured:
    """That the pelvis sinks, with what the knees' errors do to a leg of two straight bones."""
    thigh, shank = (signals.motion.skeleton.bone_length(f"left_{one}") for one in ("knee", "ankle"))
    knee = np.deg2rad([signals.flexion(side, "knee")[low.turn] for side in SIDES])
    long = np.sqrt(thigh**2 + shank**2 + 2 * thigh * shank * np.cos(knee))
    slope = thigh * shank * np.sin(knee) / long  # metres by which a leg is shorter for a radian of its knee
    sigmas = np.deg2rad([signals.sigma(f"{side}_knee_flexion")[low.turn] for side in SIDES])
    return Measured(low.depth, shape_factor("knee") * float(np.linalg.norm(slope * sigmas)) / 2)


@dataclass(frozen=True)
class _Flight:
    """Frames, between two, at which feet leave the floor and land, with how sure these are; the highest frame."""

    begin: float
    top: int
    end: float
    sigma: float


def _flights(signals: Signals) -> Iterator[_Flight]:
    """Where the body falls freely for long enough, with both feet off the floor."""
    least_s = 0.23  # of a fall: runs 0.16, a step with a kick 0.21, a jump of 12 cm 0.25
    falls = np.concatenate([[False], signals.fall > 0.5 * GRAVITY, [False]])
    edges = np.flatnonzero(np.diff(falls.astype(int)))
    for start, stop in zip(edges[::2].tolist(), (edges[1::2] - 1).tolist(), strict=True):
        if (stop - start) / signals.motion.rate < least_s:
            continue
        top = start + int(np.argmax(signals.mass_height[start : stop + 1]))
        ends = [_leaves_floor(signals, top, step) for step in (-1, 1)]
        if ends[0] is not None and ends[1] is not None:
            (begin, before), (end, after) = ends[0], ends[1]
            yield _Flight(begin, top, end, float(np.hypot(before, after)))


def _leaves_floor(signals: Signals, top: int, step: int) -> tuple[float, float] | None:
    """The frame, between two, before (``step`` −1) or after (1) the highest of a jump at which the lower foot is as
    high over its lowest there as feet are when toes leave the floor, and how sure that is; None if it never is so low.
    """
    # Metres of the ball's centre when the toes leave the floor: the heel has rolled up. Of 2, 3, 4, 5 and 6 cm the one
    # that flights of known length in recordings of foreign bodies agree with, whichever of the recordings is left out.
    rise, sigma = 0.03, 0.015
    longest_s = 1.2  # before and after a jump's highest moment: the longest flights of people take half of it
    way = signals.sole[top::step][: round(longest_s * signals.motion.rate)]
    height = way - way.min()
    low = np.flatnonzero(height < rise)
    if not len(low) or low[0] == 0:
        return None
    last = int(low[0]) - 1
    speed = height[last] - height[last + 1]
    return top + step * (last + (height[last] - rise) / speed), sigma / speed


def _jump(signals: Signals, flight: _Flight, lows: Sequence[_Low]) -> Repetition:
    """A jump, with the lows before and after it."""
    rate, time = signals.motion.rate, signals.time
    seconds, near = (flight.end - flight.begin) / rate, 0.3 * rate
    height = Measured(GRAVITY * seconds**2 / 8, GRAVITY * seconds / 4 * flight.sigma / rate)
    before = next((one for one in lows[::-1] if one.turn < flight.begin and one.end > flight.begin - near), None)
    after = next((one for one in lows if one.turn > flight.end and one.start < flight.end + near), None)
    low = before or _Low(0.0, 0.0, flight.begin, flight.begin, int(flight.begin), flight.begin, flight.begin)
    whole = replace(low, end=flight.end if after is None else after.end)
    stand = slice(max(0, int(low.start - 0.5 * rate)), max(1, int(low.start)))  # half a second before the jump
    rise = signals.mass_height[flight.top] - np.median(signals.mass_height[stand])
    sigma = np.hypot(signals.height_sigma[flight.top], np.median(signals.height_sigma[stand]))
    found, lowest = _repetition(signals, "jump", "both", whole, "knee"), float(time[low.turn])
    take_off = float(np.interp(flight.begin, np.arange(len(time)), time))
    return replace(
        found, turn=float(time[flight.top]), down_s=lowest - found.start, up_s=take_off - lowest, hold_s=UNKNOWN,
        depth_m=Measured() if before is None else _depth(signals, low), flight_s=float(seconds),
        flight_height_m=height, rise_m=Measured(float(rise), float(sigma)),
    )  # fmt: skip


def _curls(signals: Signals) -> Iterator[Repetition]:
    """Bends of elbows whose upper arms hang; those of both arms at a time are one."""
    found: dict[str, list[_Low]] = {}
    least_curl_deg = 60.0  # half of a curl's range
    for side in SIDES:
        bends = _lows(signals.flexion(side, "elbow"), least_curl_deg, signals.motion.rate)
        found[side] = [one for one in bends if _is_curl(signals, side, one)]
    pairs = {}
    for number, one in enumerate(found["left"]):
        near = [k for k, other in enumerate(found["right"]) if other.start < one.turn < other.end]
        if near and abs(found["right"][near[0]].turn - one.turn) < 0.25 * (one.end - one.start):
            pairs[number] = near[0]
    for number, one in enumerate(found["left"]):
        yield _repetition(signals, "curl", "both" if number in pairs else "left", one, "elbow")
    for number, one in enumerate(found["right"]):
        if number not in pairs.values():
            yield _repetition(signals, "curl", "right", one, "elbow")


def _is_curl(signals: Signals, side: str, low: _Low) -> bool:
    arm = signals.upper_arm(side)[int(low.start) : int(np.ceil(low.end)) + 1]
    hangs = np.rad2deg(np.arccos(np.clip(-arm[:, 1], -1, 1)))
    turns = np.rad2deg(np.arccos(np.clip(arm @ signals.upper_arm(side)[low.turn], -1, 1)))
    most_arm_deg = 45.0  # turned against the chest and away from hanging: pouring and washing 48 and more, curls 20
    least_s = 0.83  # beyond half of its depth: dribbling 0.64 at most, curls 1.07 and more; the geometric mean
    calm = max(turns.max(), hangs.max()) <= most_arm_deg
    return bool(calm and low.width >= least_s * signals.motion.rate)


def _sets(repetitions: Sequence[Repetition]) -> list[Repetition]:
    """Those with one alike beside them."""
    repetitions = sorted(repetitions, key=lambda one: one.start)
    least_share = 0.5  # of a neighbour's depth: people's repetitions differ by a third
    longest_pause_s = 5.0  # 2 within a set; two dips of a dancer or footballer lay 7 apart

    def alike(one: Repetition, other: Repetition) -> bool:
        depths = [_size(one), _size(other)]
        pause = max(one.start, other.start) - min(one.end, other.end)
        return min(depths) >= least_share * max(depths) and pause <= longest_pause_s

    return [
        one for k, one in enumerate(repetitions)
        if (k > 0 and alike(one, repetitions[k - 1])) or (k + 1 < len(repetitions) and alike(one, repetitions[k + 1]))
    ]  # fmt: skip


def _size(one: Repetition) -> float:
    """Of those of a kind, to be compared."""
    if one.kind == "curl":
        return max(each.value for each in one.ranges_deg.values())
    return one.depth_m.value
