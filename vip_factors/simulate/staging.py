"""Where people are in a scene: clips laid into one world, lengthened, and told when to start."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vip_factors.body.kinematics import Motion, forward_kinematics
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array, exp, log, rotation_z, transpose, wrap_angle, yaw_of
from vip_factors.simulate.stance import floor_height

BLEND_S = 0.8  # from the end of a clip into its next repetition
LEAST_S = 1.0  # of a clip to be repeated
TURN_RAD_S = np.deg2rad(120.0)  # at most, of a blend: people who turn about; four repetitions lead round and back
WALKS_M = 0.4  # net way of a clip that leads somewhere
STAGE_M = 1.8  # how far from the stage's middle the middles of paths are: people cross, and hide each other
APART_M = 0.6  # of two people's pelves who pass each other without touching
TRIES = 30  # of places, before people come nearer than that


def placed(motion: Motion, yaw: float = 0.0, middle: Sequence[float] = (0.0, 0.0)) -> Motion:
    """The motion turned about the vertical, with the middle of its ground path at ``middle`` (metres)."""
    R = rotation_z(yaw)
    ground = motion.p_world_pelvis[:, :2]
    centre = np.array([*((ground.min(axis=0) + ground.max(axis=0)) / 2), 0.0])
    p = (motion.p_world_pelvis - centre) @ R.T + np.array([*middle, 0.0])
    turned = motion.R_parent_child.copy()
    turned[:, 0] = R @ turned[:, 0]
    return replace(motion, R_parent_child=turned, p_world_pelvis=p)


def lasting(motion: Motion, seconds: float) -> Motion:
    """The motion cut or repeated to a length.

    Each repetition starts where the one before ended, turned so that it leads back towards the first one's middle; a
    blend of 0.8 s (a third of a short clip) joins them (feet slide there, as the price).

    Raises:
        InputError: for a clip that is too short to be repeated.
    """
    frames = round(seconds * motion.rate) + 1
    blend = min(round(BLEND_S * motion.rate), len(motion) // 3)
    if frames <= len(motion):
        return motion.frames(slice(0, frames))
    if len(motion) < LEAST_S * motion.rate:
        raise InputError(
            f"motion '{motion.name}' lasts {len(motion) / motion.rate:g} s: expected at least {LEAST_S:g} s to "
            "repeat it"
        )
    R, p = motion.R_parent_child, motion.p_world_pelvis
    home = (p[:, :2].min(axis=0) + p[:, :2].max(axis=0)) / 2
    while len(p) < frames:
        R_next, p_next = _turned_home(motion, R[-blend:], p[-blend:], home)
        weight = _fade(blend)
        joined_R = R[-blend:] @ exp(weight[:, None, None] * log(transpose(R[-blend:]) @ R_next[:blend]))
        joined_p = p[-blend:] + weight[:, None] * (p_next[:blend] - p[-blend:])
        joined_p[:, 2] += _standing(motion, joined_R, joined_p, (R[-blend:], p[-blend:]), (R_next, p_next), weight)
        R = np.concatenate([R[:-blend], joined_R, R_next[blend:]])
        p = np.concatenate([p[:-blend], joined_p, p_next[blend:]])
    return replace(motion, R_parent_child=R[:frames], p_world_pelvis=p[:frames])


def _fade(count: int) -> Array:
    """Weights from 0 to 1 with vanishing first and second derivatives at both ends."""
    phase = np.arange(count) / max(count, 1)
    return phase**3 * (10 - 15 * phase + 6 * phase**2)


def _turned_home(motion: Motion, R_end: Array, p_end: Array, home: Array) -> tuple[Array, Array]:
    """The clip once more, from the end's middle on; its net way turned towards home, as far as people turn."""
    count = len(p_end)
    start = motion.p_world_pelvis[:count].mean(axis=0)
    way = motion.p_world_pelvis[-count:].mean(axis=0) - start
    back = home - p_end[-1, :2]
    turn = float(yaw_of(R_end[count // 2, 0] @ transpose(motion.R_parent_child[count // 2, 0])))  # straight on
    if np.linalg.norm(way[:2]) > WALKS_M and np.linalg.norm(back) > WALKS_M:
        homeward = np.arctan2(back[1], back[0]) - np.arctan2(way[1], way[0])
        most = TURN_RAD_S * count / motion.rate
        turn += float(np.clip(wrap_angle(homeward - turn), -most, most))
    R_turn = rotation_z(turn)
    shift = np.array([*(p_end.mean(axis=0) - R_turn @ start)[:2], 0.0])
    R = motion.R_parent_child.copy()
    R[:, 0] = R_turn @ R[:, 0]
    return R, motion.p_world_pelvis @ R_turn.T + shift


def _standing(
    motion: Motion, R: Array, p: Array, before: tuple[Array, Array], after: tuple[Array, Array], weight: Array
) -> Array:
    """How far to raise the root of blended frames, so that the feet neither dip nor float."""
    B = len(weight)

    def floor(R: Array, p: Array) -> Array:
        return floor_height(motion.skeleton, forward_kinematics(motion.skeleton, R[:B], p[:B]))

    return floor(*before) * (1 - weight) + floor(*after) * weight - floor(R, p)


def from_time(motion: Motion, seconds: float) -> Motion:
    """The motion from a moment on, starting at time zero: people who do the same thing should not do it in step."""
    return replace(motion.frames(slice(round(seconds * motion.rate), None)), start=0.0)


def staged(
    motions: Sequence[Motion], seed: int = 0, others: Sequence[Motion] = (), reach_m: float = STAGE_M
) -> tuple[Motion, ...]:
    """Motions of several people in one world, turned and placed at random so that they cross but do not collide.

    Args:
        motions: one of each person, all on the clock of the scene.
        seed: of places and turns.
        others: who is in that world already.
        reach_m: how far from the origin the middles of their paths may be; a person alone is in the middle.
    """
    random = np.random.default_rng([seed, 0x57A6E])
    there = list(others)
    for motion in motions:
        tries = TRIES if there else 1
        best, room = None, -1.0
        for _ in range(tries):
            angle, yaw = random.uniform(-np.pi, np.pi, 2)
            radius = reach_m * np.sqrt(random.random()) if there else 0.0
            candidate = placed(motion, yaw, (radius * np.cos(angle), radius * np.sin(angle)))
            free = min((_nearest(candidate, other) for other in there), default=np.inf)
            if free > room:
                best, room = candidate, free
            if free > APART_M:
                break
        assert best is not None
        there.append(best)
    return tuple(there[len(others) :])


def _nearest(one: Motion, other: Motion) -> float:
    """Least distance in metres of two people's pelves, on the ground, at common times."""
    start, end = max(one.start, other.start), min(one.time[-1], other.time[-1])
    time = np.arange(start, end, 0.1)
    if not len(time):
        return np.inf
    apart = [
        np.interp(time, one.time, one.p_world_pelvis[:, axis])
        - np.interp(time, other.time, other.p_world_pelvis[:, axis])
        for axis in (0, 1)
    ]
    return float(np.hypot(*apart).min())
