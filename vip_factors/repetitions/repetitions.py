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
from vip_factors.estimate import WearerEstimate
from vip_factors.geometry.rotations import Array
from vip_factors.repetitions.repetition import (
    UNKNOWN,
    Kind,
    Measured,
    Repetition,
    Side,
    Signals,
    WearerRepetitions,
    signals_of,
)
from vip_factors.sensors.imu_stream import runs

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


def repetitions_of(wearer: WearerEstimate) -> WearerRepetitions:
    """Detect the repetitions of one wearer, with standard deviations if the estimate has a covariance.

    Raises:
        InputError: if it has no frames.
    """
    name = wearer.motion.name or wearer.name
    if not len(wearer.motion):
        raise InputError(f"estimate of '{name}' has no frames: expected a motion to look for repetitions in")
    signals = signals_of(wearer)
    fewest = 3  # frames: with fewer nothing is higher than what is beside it
    if len(wearer.motion) < fewest:
        return WearerRepetitions(name, signals, ())
    lows = _lows(-signals.reach, 0.25 * LEAST_DEPTH * signals.legs, signals.motion.rate)
    jumps = [_jump(signals, flight, lows) for flight in _flights(signals)]
    deep = [low for low in lows if low.depth >= LEAST_DEPTH * signals.legs]
    dips = [dip for low in deep if (dip := _dip(signals, low)) is not None]
    free = [dip for dip in dips if not any(jump.start <= dip.turn <= jump.end for jump in jumps)]
    sets = [_sets([dip for dip in free if dip.kind == kind]) for kind in ("squat", "lunge")]
    curls = _sets(list(_curls(signals)))
    repetitions = sorted([*jumps, *sets[0], *sets[1], *curls], key=lambda repetition: repetition.start)
    return WearerRepetitions(name, signals, tuple(repetitions))


def _lows(values: Array, least: float, rate: float) -> list[_Low]:
    """Highs of ``values`` ``(T,)`` that stand out by ``least`` at least."""
    from scipy.signal import find_peaks, peak_widths  # late: it takes long to load

    peaks, properties = find_peaks(values, prominence=least)
    depths = properties["prominences"]
    prominence = (depths, properties["left_bases"], properties["right_bases"])
    shares = (0.98, 0.5, 0.1)  # of a low's depth below its rim: it begins and ends; half; it is held
    (starts, ends), (down, up), (hold_starts, hold_ends) = (
        peak_widths(values, peaks, share, prominence)[2:] for share in shares
    )
    speed = np.abs(np.gradient(values, 1 / rate))
    lows = list[_Low]()
    for depth, start, half, hold, turn, leave, back, end in zip(
        depths, starts, down, hold_starts, peaks.tolist(), hold_ends, up, ends, strict=True
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
    frames = np.arange(half, rim + step, step)
    if not len(frames):
        return float(rim)
    moving = 0.05  # of a way's greatest speed: what is slower is not on the way yet
    slow = np.flatnonzero(speed[frames] < moving * speed[frames].max())
    return float(frames[slow[0]] if len(slow) else rim)


def _dip(signals: Signals, low: _Low) -> Repetition | None:
    """A squat or a lunge, if a low of the pelvis is one."""
    knees = [signals.flexion(side, "knee")[low.turn] for side in SIDES]
    hips = [signals.flexion(side, "hip")[low.turn] for side in SIDES]
    level = abs(signals.height("left_foot")[low.turn] - signals.height("right_foot")[low.turn]) / signals.legs
    ankle_distance = signals.apart[low.turn] / signals.legs
    lunge_apart = 0.4  # lengths of a leg between the ankles, fore and aft: squats 0.2 at most, lunges 0.6 and more
    feet_level = 0.25  # lengths of a leg between the balls of both feet on the floor: soles roll, and estimates err
    least_knee_deg = 45.0  # of a walker's two knees one is below 35; of squats both are above 60
    least_hip_deg = 30.0  # who sinks without bending the hips leans back, kneels or lies down
    # Beyond half of the depth: quick squats 0.69 s and more; before and after jumps, and boxers 0.57 at most. The
    # geometric mean of both; with any one recording left out, the limit that the others give still tells it.
    least_dip_s = 0.63
    is_lunge = abs(ankle_distance) >= lunge_apart
    bent = min(knees) >= least_knee_deg and (max(hips) if is_lunge else min(hips)) >= least_hip_deg
    if not bent or level > feet_level or low.width < least_dip_s * signals.motion.rate:
        return None
    side: Side = "both" if not is_lunge else "left" if ankle_distance > 0 else "right"
    sunk = _repetition(signals, "lunge" if is_lunge else "squat", side, low, "knee")
    return replace(sunk, depth_m=_depth(signals, low))


def _repetition(signals: Signals, kind: Kind, side: Side, low: _Low, joint: str) -> Repetition:
    """Describe a low of the pelvis or a bend of an elbow as a repetition."""
    frames = np.arange(len(signals.time))
    start, hold_start, hold_end, end = (
        float(np.interp(frame, frames, signals.time)) for frame in (low.start, low.held, low.left, low.end)
    )
    sides = SIDES if side == "both" or joint == "knee" else (side,)
    names = [f"{of_side}_{angle}" for angle in PRINCIPAL[joint] for of_side in sides]
    margin = 0.2 * signals.motion.rate  # joints begin to bend before the pelvis sinks to be seen
    window = slice(max(0, int(low.start - margin)), int(np.ceil(low.end + margin)) + 1)
    ranges = dict[str, Measured]()
    for name in names:  # a constant error of an angle cancels
        values, sigmas = signals.angles.of(name)[window], signals.sigma(name)[window]
        ends, shape = [int(np.argmin(values)), int(np.argmax(values))], shape_factor(name.rpartition("_")[0])
        ranges[name] = Measured(float(np.ptp(values)), shape * float(np.linalg.norm(sigmas[ends])))
    bends = [f"{of_side}_{joint}_flexion" for of_side in sides]
    depth = np.mean([signals.angles.of(name)[low.turn] for name in bends])
    sigma = np.linalg.norm([signals.sigma(name)[low.turn] for name in bends]) / len(bends)
    differ = Measured()
    if side == "both":
        left_range, right_range = (ranges[name] for name in bends)
        differ = Measured(left_range.value - right_range.value, float(np.hypot(left_range.sigma, right_range.sigma)))
    return Repetition(
        kind,
        side,
        start,
        float(signals.time[low.turn]),
        end,
        hold_start - start,
        hold_end - hold_start,
        end - hold_end,
        Measured(),
        Measured(float(depth), float(sigma)),
        ranges,
        differ,
    )


PRINCIPAL = {"knee": ("hip_flexion", "knee_flexion", "ankle_dorsiflexion"), "elbow": ("elbow_flexion",)}


def _depth(signals: Signals, low: _Low) -> Measured:
    """That the pelvis sinks, with what the knees' errors do to a leg of two straight bones."""
    thigh, shank = (signals.motion.skeleton.bone_length(f"left_{joint}") for joint in ("knee", "ankle"))
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
    """Find the phases of free fall that are long enough, with both feet off the floor."""
    least_s = 0.23  # of a fall: runs 0.16, a step with a kick 0.21, a jump of 12 cm 0.25
    for start, end_frame in runs(signals.fall > 0.5 * GRAVITY).tolist():
        stop = end_frame - 1
        if (stop - start) / signals.motion.rate < least_s:
            continue
        top = start + int(np.argmax(signals.mass_height[start : stop + 1]))
        ends = [_leaves_floor(signals, top, step) for step in (-1, 1)]
        if ends[0] is not None and ends[1] is not None:
            (begin, begin_sigma), (end, end_sigma) = ends[0], ends[1]
            yield _Flight(begin, top, end, float(np.hypot(begin_sigma, end_sigma)))


def _leaves_floor(signals: Signals, top: int, step: int) -> tuple[float, float] | None:
    """The frame, between two, before (``step`` −1) or after (1) the highest of a jump at which the lower foot is as
    high over its lowest there as feet are when toes leave the floor, and how sure that is; None if it never is so low.
    """
    # Metres of the ball's centre when the toes leave the floor: the heel has rolled up. Of 2, 3, 4, 5 and 6 cm the one
    # that flights of known length in recordings of foreign bodies agree with, whichever of the recordings is left out.
    rise, sigma = 0.03, 0.015
    longest_s = 1.2  # before and after a jump's highest moment: the longest flights of people take half of it
    heights = signals.sole[top::step][: round(longest_s * signals.motion.rate)]
    height = heights - heights.min()
    low = np.flatnonzero(height < rise)
    if not len(low) or low[0] == 0:
        return None
    last_high = int(low[0]) - 1
    speed = height[last_high] - height[last_high + 1]
    return top + step * (last_high + (height[last_high] - rise) / speed), sigma / speed


def _jump(signals: Signals, flight: _Flight, lows: Sequence[_Low]) -> Repetition:
    """A jump, with the lows before and after it."""
    rate, time = signals.motion.rate, signals.time
    seconds, near = (flight.end - flight.begin) / rate, 0.3 * rate
    height = Measured(GRAVITY * seconds**2 / 8, GRAVITY * seconds / 4 * flight.sigma / rate)
    low_before = next(
        (
            candidate
            for candidate in lows[::-1]
            if candidate.turn < flight.begin and candidate.end > flight.begin - near
        ),
        None,
    )
    low_after = next(
        (candidate for candidate in lows if candidate.turn > flight.end and candidate.start < flight.end + near), None
    )
    low = low_before or _Low(0.0, 0.0, flight.begin, flight.begin, int(flight.begin), flight.begin, flight.begin)
    jump_low = replace(low, end=flight.end if low_after is None else low_after.end)
    stand = slice(max(0, int(low.start - 0.5 * rate)), max(1, int(low.start)))  # half a second before the jump
    rise = signals.mass_height[flight.top] - np.median(signals.mass_height[stand])
    sigma = np.hypot(signals.height_sigma[flight.top], np.median(signals.height_sigma[stand]))
    jump, lowest = _repetition(signals, "jump", "both", jump_low, "knee"), float(time[low.turn])
    take_off = float(np.interp(flight.begin, np.arange(len(time)), time))
    return replace(
        jump,
        turn=float(time[flight.top]),
        down_s=lowest - jump.start,
        up_s=take_off - lowest,
        hold_s=UNKNOWN,
        depth_m=Measured() if low_before is None else _depth(signals, low),
        flight_s=float(seconds),
        flight_height_m=height,
        rise_m=Measured(float(rise), float(sigma)),
    )


def _curls(signals: Signals) -> Iterator[Repetition]:
    """Bends of elbows whose upper arms hang; those of both arms at a time are one."""
    curls: dict[str, list[_Low]] = {}
    least_curl_deg = 60.0  # half of a curl's range
    for side in SIDES:
        bends = _lows(signals.flexion(side, "elbow"), least_curl_deg, signals.motion.rate)
        curls[side] = [bend for bend in bends if _is_curl(signals, side, bend)]
    pairs = {}
    for number, low in enumerate(curls["left"]):
        near = [k for k, right_low in enumerate(curls["right"]) if right_low.start < low.turn < right_low.end]
        if near and abs(curls["right"][near[0]].turn - low.turn) < 0.25 * (low.end - low.start):
            pairs[number] = near[0]
    for number, low in enumerate(curls["left"]):
        yield _repetition(signals, "curl", "both" if number in pairs else "left", low, "elbow")
    for number, low in enumerate(curls["right"]):
        if number not in pairs.values():
            yield _repetition(signals, "curl", "right", low, "elbow")


def _is_curl(signals: Signals, side: str, low: _Low) -> bool:
    arm = signals.upper_arm(side)[int(low.start) : int(np.ceil(low.end)) + 1]
    hangs = np.rad2deg(np.arccos(np.clip(-arm[:, 1], -1, 1)))
    turns = np.rad2deg(np.arccos(np.clip(arm @ signals.upper_arm(side)[low.turn], -1, 1)))
    most_arm_deg = 45.0  # turned against the chest and away from hanging: pouring and washing 48 and more, curls 20
    least_s = 0.83  # beyond half of its depth: dribbling 0.64 at most, curls 1.07 and more; the geometric mean
    calm = max(turns.max(), hangs.max()) <= most_arm_deg
    return bool(calm and low.width >= least_s * signals.motion.rate)


def _sets(repetitions: Sequence[Repetition]) -> list[Repetition]:
    """Select the repetitions that have a similar neighbour."""
    repetitions = sorted(repetitions, key=lambda repetition: repetition.start)
    least_share = 0.5  # of a neighbour's depth: people's repetitions differ by a third
    longest_pause_s = 5.0  # 2 within a set; two dips of a dancer or footballer lay 7 apart

    def alike(repetition: Repetition, neighbour: Repetition) -> bool:
        depths = [_size(repetition), _size(neighbour)]
        pause = max(repetition.start, neighbour.start) - min(repetition.end, neighbour.end)
        return min(depths) >= least_share * max(depths) and pause <= longest_pause_s

    return [
        repetition
        for k, repetition in enumerate(repetitions)
        if (k > 0 and alike(repetition, repetitions[k - 1]))
        or (k + 1 < len(repetitions) and alike(repetition, repetitions[k + 1]))
    ]


def _size(repetition: Repetition) -> float:
    """Size of a repetition, to compare it with others of its kind."""
    if repetition.kind == "curl":
        return max(angle_range.value for angle_range in repetition.ranges_deg.values())
    return repetition.depth_m.value
