"""Clinical angles of gait: flexion of knees and hips, which needs no world frame, and how the trunk leans."""

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import joint_index
from vip_factors.geometry.rotations import Array, transpose


def knee_flexion_deg(R_world_thigh: Array, R_world_shank: Array) -> Array:
    """Knee flexion ``(...)`` in degrees, of thigh and shank orientations ``(..., 3, 3)``; 0 is a straight leg.

    Grood & Suntay (1983), J. Biomech. Eng. 105: flexion is about the thigh's mediolateral axis (our x, to the left
    on both sides), internal rotation about the shank's long axis (our y), adduction about the floating axis between.
    So ``R_thigh_shank = Rx(flexion) Rz(adduction) Ry(rotation)``, and flexion takes the shank back (+x).
    """
    R_thigh_shank = transpose(R_world_thigh) @ R_world_shank
    return np.rad2deg(np.arctan2(R_thigh_shank[..., 2, 1], R_thigh_shank[..., 1, 1]))


def knee_flexion_of(motion: Motion, side: str) -> Array:
    """Knee flexion ``(T,)`` in degrees of the ``"left"`` or ``"right"`` knee of a motion."""
    R_world_bone = motion.state.R_world_bone
    return knee_flexion_deg(R_world_bone[:, joint_index(f"{side}_hip")], R_world_bone[:, joint_index(f"{side}_knee")])


def hip_flexion_deg(R_world_pelvis: Array, R_world_thigh: Array) -> Array:
    """Hip flexion ``(...)`` in degrees, of pelvis and thigh orientations ``(..., 3, 3)``; forward is positive.

    The convention of :func:`knee_flexion_deg`, but flexion takes the thigh forward, which is a turn about −x.
    """
    return -knee_flexion_deg(R_world_pelvis, R_world_thigh)


def hip_flexion_of(motion: Motion, side: str) -> Array:
    """Hip flexion ``(T,)`` in degrees of the ``"left"`` or ``"right"`` hip of a motion."""
    R_world_bone = motion.state.R_world_bone
    return hip_flexion_deg(R_world_bone[:, joint_index("pelvis")], R_world_bone[:, joint_index(f"{side}_hip")])


def bend_deg(p_above: Array, p_joint: Array, p_below: Array) -> Array:
    """How far ``(...)`` degrees a knee or an elbow is from straight, of joint centres ``(..., 3)``; never negative.

    No axes of bones are needed, which no two skeletons share.
    """
    above, below = p_joint - p_above, p_below - p_joint
    cosine = np.sum(above * below, axis=-1) / np.linalg.norm(above, axis=-1) / np.linalg.norm(below, axis=-1)
    return np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0)))


def inclination_deg(up: Array, left: Array) -> Array:
    """How far ``(T,)`` degrees an axis of the trunk leans forward, seen from where the person's left is.

    Args:
        up: ``(T, 3)`` along the axis, in a world with z up; from the middle of the hips to that of the shoulders, say,
            which all skeletons have, or a bone's own axis, about whose zero no two skeletons agree.
        left: ``(T, 3)`` from the right hip to the left one.
    """
    forward = np.stack([left[..., 1], -left[..., 0]], axis=-1)
    forward /= np.linalg.norm(forward, axis=-1, keepdims=True)
    return np.rad2deg(np.arctan2(np.sum(up[..., :2] * forward, axis=-1), up[..., 2]))


def rmse(estimate: Array, truth: Array) -> float:
    """Root mean square difference, NaN samples left out."""
    return float(np.sqrt(np.nanmean((np.asarray(estimate) - np.asarray(truth)) ** 2)))


def rmse_without_offset(estimate: Array, truth: Array) -> float:
    """Root mean square difference once its mean is removed: two laboratories' zero angles seldom agree."""
    difference = np.asarray(estimate) - np.asarray(truth)
    return float(np.sqrt(np.nanmean((difference - np.nanmean(difference)) ** 2)))
