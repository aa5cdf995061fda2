"""Errors of the path through the world, and how steady the motion is."""

from collections.abc import Callable

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.evaluate.joints import EVERYTHING, FEET, Compared
from vip_factors.evaluate.metrics import CM, MM
from vip_factors.geometry.poses import align_rigid, align_similarity, align_yaw
from vip_factors.geometry.rotations import Array

CHUNK = 100  # frames, as WHAM and its successors take
STILL_M = 0.01  # per frame: a true foot slower than this stands
PATH_MIN_M = 0.1  # a root that moves less has no path to take a percentage of


def root_translation_error(estimate: Motion, truth: Motion) -> tuple[float, float]:
    """Mean error of the root after a rigid alignment of the whole path: in cm, and in % of the true path length.

    The percentage is NaN for a root that stays within 10 cm of path.
    """
    points, reference = estimate.state.p_world_joint[:, 0], truth.state.p_world_joint[:, 0]
    error = np.linalg.norm(align_rigid(points, reference).apply(points) - reference, axis=-1).mean()
    length = np.linalg.norm(np.diff(reference, axis=0), axis=-1).sum()
    return float(CM * error), float(100 * error / length) if length > PATH_MIN_M else float("nan")


def yaw_aligned_position_error(estimate: Motion, truth: Motion, compared: Compared = EVERYTHING) -> float:
    """Mean position error in cm over 24 joints after one yaw and one translation for all frames.

    Exactly the gauge of an inertial reconstruction is removed: what is left is pose, drift and tilt.
    """
    points, reference = (
        motion.state.p_world_joint[:, compared.positions()].reshape(-1, 3) for motion in (estimate, truth)
    )
    moved = align_yaw(points, reference).apply(points)
    return float(CM * np.linalg.norm(moved - reference, axis=-1).mean())


def w_mpjpe(estimate: Motion, truth: Motion, compared: Compared = EVERYTHING) -> float:
    """World MPJPE in mm: chunks of 100 frames, similarity fitted on each one's first two frames; 24 joints."""
    return _chunked(estimate, truth, compared, lambda points: points[:2])


def wa_mpjpe(estimate: Motion, truth: Motion, compared: Compared = EVERYTHING) -> float:
    """World-aligned MPJPE in mm: chunks of 100 frames, similarity fitted on the whole chunk; 24 joints."""
    return _chunked(estimate, truth, compared, lambda points: points)


def _chunked(estimate: Motion, truth: Motion, compared: Compared, fitted: Callable[[Array], Array]) -> float:
    points, reference = (motion.state.p_world_joint[:, compared.positions()] for motion in (estimate, truth))
    errors = []
    for first in range(0, len(points), CHUNK):
        chunk, target = points[first : first + CHUNK], reference[first : first + CHUNK]
        alignment = align_similarity(fitted(chunk).reshape(-1, 3), fitted(target).reshape(-1, 3))
        moved = alignment.apply(chunk.reshape(-1, 3)).reshape(target.shape)
        errors.append(np.linalg.norm(moved - target, axis=-1))
    return float(MM * np.concatenate(errors).mean())


def jitter(motion: Motion) -> float:
    """Mean norm of the third derivative of the 24 joint positions in m/s³: third difference × fps³.

    NaN for fewer than four frames.
    """
    if len(motion) < 4:
        return float("nan")
    jerk = np.diff(motion.state.p_world_joint, n=3, axis=0) * motion.rate**3
    return float(np.linalg.norm(jerk, axis=-1).mean())


def foot_sliding(estimate: Motion, truth: Motion, compared: Compared = EVERYTHING) -> float:
    """Mean displacement per frame of the estimated foot joints, in mm, while the true ones move less than 1 cm.

    It depends on the frame rate, as published. NaN if the true feet never stand, or are not known.
    """
    feet = compared.positions(FEET)
    moved, reference = (
        np.linalg.norm(np.diff(motion.state.p_world_joint[:, feet], axis=0), axis=-1) for motion in (estimate, truth)
    )
    still = reference < STILL_M
    return float(MM * moved[still].mean()) if np.any(still) else float("nan")
