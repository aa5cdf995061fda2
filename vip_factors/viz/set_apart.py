"""Wearers whose places beside each other are unknown: drawn side by side and never within each other."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.geometry.rotations import Array
from vip_factors.viz.compare import floor_height

APART_M = 1.4  # between pelvises at least: arms held out may touch, bodies do not
STEP_M = 0.2  # by which a wearer is moved on until nobody is in the way
APART = "The wearers are set apart: without a camera, where they stood beside each other is unknown."
APART_TITLE = "wearers set apart: their places are unknown"


def set_apart(motions: Sequence[Motion]) -> list[Array]:
    """How far ``(3,)`` metres to move each motion so that at no moment two pelvises are too near each other.

    All start from the first one's place, along the world's y, and stand on its floor.
    """
    shifts: list[Array] = []
    paths: list[tuple[Array, Array]] = []
    for motion in motions:
        shift = motions[0].p_world_pelvis[0] - motion.p_world_pelvis[0]
        shift[1] += APART_M * len(shifts)
        shift[2] = floor_height(motions[0]) - floor_height(motion)
        while any(_nearest(motion.time, motion.p_world_pelvis + shift, *other) < APART_M - 1e-9 for other in paths):
            shift = shift + np.array([0.0, STEP_M, 0.0])
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
