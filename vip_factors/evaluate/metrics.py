"""Errors of a pose, frame by frame and joint by joint; the published numbers are means of these.

All functions take an estimate and the truth at the same frames, each with its own skeleton (see
:func:`~vip_factors.evaluate.frames.common_frames`). Joints of which the truth knows nothing are left out of every mean.
"""

from dataclasses import replace

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.errors import InputError
from vip_factors.evaluate.joints import EVERYTHING, GLOBAL_JOINTS, ORIENTATION_JOINTS, POSITION_JOINTS, Compared
from vip_factors.geometry.poses import Alignment, align_rigid, align_similarity
from vip_factors.geometry.rotations import Array, angle_between

MM, CM = 1e3, 1e2
LEAST_JOINTS = 3  # fewer fix no alignment


def align_frames(estimate: Motion, truth: Motion, scale: bool = False, compared: Compared = EVERYTHING) -> Alignment:
    """Rigid motion (or similarity) of every frame that takes the estimate's 14 joints onto the truth's."""
    _same_frames(estimate, truth)
    joints = compared.positions(POSITION_JOINTS)
    if len(joints) < LEAST_JOINTS:
        raise InputError(f"the truth knows {len(joints)} of the compared joints: expected at least {LEAST_JOINTS}")
    align = align_similarity if scale else align_rigid
    return align(estimate.state.p_world_joint[:, joints], truth.state.p_world_joint[:, joints])


def position_error(estimate: Motion, truth: Motion, alignment: Alignment | None = None) -> Array:
    """Distance of every joint from its true place, ``(T, 24)`` metres, after an alignment if given."""
    _same_frames(estimate, truth)
    points = estimate.state.p_world_joint
    if alignment is not None:
        points = alignment.apply(points)
    return np.linalg.norm(points - truth.state.p_world_joint, axis=-1)


def orientation_error(estimate: Motion, truth: Motion, alignment: Alignment | None = None) -> Array:
    """Geodesic angle of every bone from its true world orientation, ``(T, 24)`` rad, after an alignment if given."""
    _same_frames(estimate, truth)
    R = estimate.state.R_world_bone
    if alignment is not None:
        R = alignment.R_target_source[:, None] @ R
    return angle_between(R, truth.state.R_world_bone)


def local_orientation_error(estimate: Motion, truth: Motion) -> Array:
    """Geodesic angle of every joint rotation (bone in its parent), ``(T, 24)`` rad; joint 0 is the pelvis's."""
    _same_frames(estimate, truth)
    return angle_between(estimate.R_parent_child, truth.R_parent_child)


def mpjpe(estimate: Motion, truth: Motion, compared: Compared = EVERYTHING) -> float:
    """Mean per-joint position error in mm: 14 joints, rigid alignment of every frame (thesis eq. 2.72)."""
    error = position_error(estimate, truth, align_frames(estimate, truth, compared=compared))
    return float(MM * error[:, compared.positions(POSITION_JOINTS)].mean())


def mpjpe_true_body(estimate: Motion, truth: Motion, compared: Compared = EVERYTHING) -> float:
    """As :func:`mpjpe`, in mm, of the estimate's joint rotations on the true skeleton: what the pose alone is off."""
    return mpjpe(replace(estimate, skeleton=truth.skeleton), truth, compared)


def pa_mpjpe(estimate: Motion, truth: Motion, compared: Compared = EVERYTHING) -> float:
    """As :func:`mpjpe` with scale, in mm."""
    error = position_error(estimate, truth, align_frames(estimate, truth, True, compared))
    return float(MM * error[:, compared.positions(POSITION_JOINTS)].mean())


def mpjae(estimate: Motion, truth: Motion, compared: Compared = EVERYTHING) -> float:
    """Mean angular error in degrees: world orientation of 9 bones after the alignment of :func:`mpjpe` (eq. 2.73)."""
    error = orientation_error(estimate, truth, align_frames(estimate, truth, compared=compared))
    return float(np.rad2deg(error[:, compared.orientations(ORIENTATION_JOINTS)].mean()))


def local_mpjae(estimate: Motion, truth: Motion, compared: Compared = EVERYTHING) -> float:
    """Mean angular error in degrees of the same 9 joints, each relative to its parent."""
    return float(
        np.rad2deg(local_orientation_error(estimate, truth)[:, compared.orientations(ORIENTATION_JOINTS)].mean())
    )


def root_relative_mpjpe(estimate: Motion, truth: Motion, compared: Compared = EVERYTHING) -> float:
    """Mean position error in mm over 24 joints, the pelvis subtracted, nothing turned (3DPW)."""
    _same_frames(estimate, truth)
    points, reference = estimate.state.p_world_joint, truth.state.p_world_joint
    difference = (points - points[:, :1]) - (reference - reference[:, :1])
    return float(MM * np.linalg.norm(difference, axis=-1)[:, compared.positions()].mean())


def global_position_error(estimate: Motion, truth: Motion, compared: Compared = EVERYTHING) -> float:
    """Mean position error in cm over 16 joints, nothing aligned (Kaichi et al.)."""
    return float(CM * position_error(estimate, truth)[:, compared.positions(GLOBAL_JOINTS)].mean())


def _same_frames(estimate: Motion, truth: Motion) -> None:
    if len(estimate) != len(truth) or abs(estimate.rate - truth.rate) > 1e-6 * truth.rate:
        raise InputError(
            f"estimate has {len(estimate)} frames at {estimate.rate:g} Hz, truth {len(truth)} at {truth.rate:g} Hz: "
            "expected the same frames; see common_frames"
        )
