"""Steps, as the feet of a motion tell them: a foot that rests, leaves, and rests again further on."""

import itertools
from dataclasses import dataclass

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import joint_index
from vip_factors.geometry.rotations import Array

REST_SPEED = 0.45  # m/s: of a foot's ball on the floor, with the slips of an estimate; a swinging foot does 2 to 4
STANCE_S, SWING_S = 0.2, 0.15  # shorter ones are no part of a step
STEP_M = 0.2  # that a foot gains by a stride at least: less is shifting about
LONGEST_S = 1.6  # from one step to the next: slower is standing in between
FEWEST = 4  # steps without a pause: fewer are no walk


@dataclass(frozen=True)
class Step:
    """The moment in seconds at which a foot comes to rest, its side, and how far it came in metres, by its stride."""

    time: float
    side: str
    stride: float


@dataclass(frozen=True)
class Walk:
    """Figures of the steps taken without a pause between.

    Attributes:
        steps: all of them, in time.
        cadence: steps a minute (median).
        cadence_spread: half the distance between quartiles.
        step_times: seconds that a step onto each side took (median), by side.
        strides: metres (median), by side.
    """

    steps: tuple[Step, ...]
    cadence: float
    cadence_spread: float
    step_times: dict[str, float]
    strides: dict[str, float]


def walk_of(motion: Motion) -> Walk | None:
    """The steps of a motion; None where fewer than :data:`FEWEST` follow each other, alternately left and right."""
    found = sorted((step for side in ("left", "right") for step in _steps(motion, side)), key=lambda one: one.time)
    pairs = [
        (before, after)
        for before, after in itertools.pairwise(found)
        if before.side != after.side and after.time - before.time <= LONGEST_S
    ]
    if len(pairs) < FEWEST - 1:
        return None
    times = np.array([after.time - before.time for before, after in pairs])
    low, middle, high = np.quantile(60 / times, [0.25, 0.5, 0.75])
    of = {side: [after.time - before.time for before, after in pairs if after.side == side] for side in _SIDES}
    strides = {side: [after.stride for _, after in pairs if after.side == side] for side in _SIDES}
    return Walk(
        tuple(found), float(middle), float(high - low) / 2,
        {side: float(np.median(one)) for side, one in of.items() if one},
        {side: float(np.median(one)) for side, one in strides.items() if one},
    )  # fmt: skip


_SIDES = ("left", "right")


def resting(motion: Motion, side: str) -> np.ndarray:
    """``(T,)`` whether a foot's ball rests."""
    p = motion.state.p_world_joint[:, joint_index(f"{side}_foot")]
    if len(p) < 3:
        return np.zeros(len(p), bool)
    speed = np.linalg.norm(np.gradient(p, 1 / motion.rate, axis=0), axis=1)
    width = max(1, round(0.08 * motion.rate))
    return np.asarray(
        np.convolve(np.pad(speed, width // 2, "edge"), np.ones(width) / width, "valid")[: len(p)] < REST_SPEED
    )


def _steps(motion: Motion, side: str) -> list[Step]:
    rests = _long_runs(resting(motion, side), STANCE_S * motion.rate, SWING_S * motion.rate)
    p = motion.state.p_world_joint[:, joint_index(f"{side}_foot"), :2]
    steps = []
    for (start, stop), (again, _) in itertools.pairwise(rests):
        stride = _distance(p, (start + stop) // 2, again)
        if stride >= STEP_M:
            steps.append(Step(float(motion.time[again]), side, stride))
    return steps


def _distance(p: Array, first: int, last: int) -> float:
    return float(np.linalg.norm(p[last] - p[first]))


def _long_runs(there: np.ndarray, least: float, gap: float) -> list[tuple[int, int]]:
    """First and last frame of runs that are long enough, those with short gaps between taken together."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], there, [False]]).astype(int)))
    runs: list[tuple[int, int]] = []
    for start, stop in zip(edges[::2].tolist(), (edges[1::2] - 1).tolist(), strict=True):
        if runs and start - runs[-1][1] <= gap:
            runs[-1] = (runs[-1][0], stop)
        else:
            runs.append((start, stop))
    return [(start, stop) for start, stop in runs if stop - start >= least]
