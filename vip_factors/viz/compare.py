"""Where bodies are drawn: an estimate beside the truth, the floor, and wearers set apart."""

from collections.abc import Sequence
from dataclasses import replace
from enum import StrEnum

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import joint_index
from vip_factors.errors import InputError
from vip_factors.geometry.poses import align_yaw
from vip_factors.geometry.rotations import Array

SIDE_BY_SIDE_M = 1.2  # between pelvises: walkers do not touch, and both stay in one view


class Compare(StrEnum):
    """Where to draw an estimate for which the truth is known. Its own world differs by a turn about the vertical.

    ``ROOT``: turned once, and its pelvis put on the true path in every frame: only the pose differs.
    ``WORLD``: turned and shifted once: drift of the root path shows.
    ``SIDE``: as ``ROOT``, stepped aside.
    """

    ROOT = "root"
    WORLD = "world"
    SIDE = "side"


def check_frames(motion: Motion) -> Motion:
    """The estimated motion.

    Raises:
        InputError: if it has no frames.
    """
    if not len(motion):
        raise InputError(f"the estimate of '{motion.name}' has no frames to draw: was its file cut off?")
    return motion


def onto_truth(estimate: Motion, truth: Motion, compare: Compare) -> Motion:
    """The estimate drawn in the truth's world (both at the same frames)."""
    p_estimate, p_truth = estimate.state.p_world_joint, truth.state.p_world_joint
    if compare is Compare.WORLD:
        gauge = align_yaw(p_estimate.reshape(-1, 3), p_truth.reshape(-1, 3))
        root = gauge.apply(estimate.p_world_pelvis)
    else:
        relative = [(p - p[:, :1]).reshape(-1, 3) for p in (p_estimate, p_truth)]
        gauge = align_yaw(*relative)
        root = truth.p_world_pelvis + (_aside(truth) if compare is Compare.SIDE else 0.0)
    R_parent_child = estimate.R_parent_child.copy()
    R_parent_child[:, 0] = gauge.R_target_source @ R_parent_child[:, 0]
    return replace(estimate, R_parent_child=R_parent_child, p_world_pelvis=root)


def _aside(motion: Motion) -> Array:
    """A horizontal step across the direction in which the path extends least."""
    path = motion.p_world_pelvis[:, :2]
    across = np.linalg.eigh(np.cov(path.T))[1][:, 0] if len(path) > 1 else np.array([0.0, 1.0])
    return SIDE_BY_SIDE_M * np.append(across, 0.0)


def floor_height(motion: Motion) -> float:
    """Height in metres of the floor: where the lower foot usually is, less the ball's height above its sole."""
    feet = motion.state.p_world_joint[:, [joint_index("left_foot"), joint_index("right_foot")], 2]
    # The median of the lower foot: a jump or a single bad frame must not move the floor.
    return float(np.median(feet.min(axis=1))) - 0.012 * 1.72


APART_M = 1.4  # between pelvises at least: arms held out may touch, bodies do not
APART = "The wearers are set apart: without a camera, where they stood beside each other is unknown."
APART_TITLE = "wearers set apart: their places are unknown"


def set_apart(motions: Sequence[Motion]) -> list[Array]:
    """How far ``(3,)`` metres to move each motion so that at no moment two pelvises are too near each other.

    All start from the first one's place, along the world's y, and stand on its floor.
    """
    shifts: list[Array] = []
    paths: list[tuple[Array, Array]] = []
    step_m = 0.2  # by which a wearer is moved on until nobody is in the way
    for motion in motions:
        shift = motions[0].p_world_pelvis[0] - motion.p_world_pelvis[0]
        shift[1] += APART_M * len(shifts)
        shift[2] = floor_height(motions[0]) - floor_height(motion)
        while any(_nearest(motion.time, motion.p_world_pelvis + shift, *other) < APART_M - 1e-9 for other in paths):
            shift = shift + np.array([0.0, step_m, 0.0])
        shifts.append(shift)
        paths.append((motion.time, motion.p_world_pelvis + shift))
    return shifts


def moved(motion: Motion, shift: Array) -> Motion:
    """The motion elsewhere."""
    return replace(motion, p_world_pelvis=motion.p_world_pelvis + shift)


def _nearest(time: Array, path: Array, other_time: Array, other: Array) -> float:
    """Least horizontal distance in metres of two paths at the same times."""
    at = [np.interp(time, other_time, other[:, axis]) for axis in range(2)]
    return float(np.hypot(path[:, 0] - at[0], path[:, 1] - at[1]).min())
