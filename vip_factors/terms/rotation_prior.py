"""Rotation prior: one rotation near a given one: mountings near the placement's, joints near those of a declared pose.

A step on the right stands at the right end of ``R_priorᵀ R``: the derivative is ``J_r⁻¹(r)``.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.factor_settings import SQUARE
from vip_factors.geometry.rotations import Array, inverse_right_jacobian, log, transpose
from vip_factors.terms.equations import DenseEquations, JacobianBlock, JointEquations, Term, prior_equations
from vip_factors.terms.evaluation import CameraEvaluation, WearerEvaluation


def rotation_prior_residual(R: Array, R_prior: Array) -> Array:
    """``Log(R_priorᵀ R)``, ``(..., 3)`` rad, in the axes of the rotated frame.

    For a mounting, ``R_bone_sensor`` against the placement's (the papers' eq. 4.7, made soft); for the initial pose,
    each ``R_parent_child`` against the declared one.
    """
    return log(transpose(R_prior) @ R)


def mounting_equations(at: WearerEvaluation) -> Iterator[DenseEquations]:
    """One factor for each sensor."""
    if at.problem.free_mountings:
        sigma = at.problem.mounting_sigma[:, None]
        error = rotation_prior_residual(at.state.R_bone_sensor, at.problem.prior_R_bone_sensor)
        jacobian = (inverse_right_jacobian(error) / sigma[..., None])[None]
        yield from prior_equations(JacobianBlock(at.owner, "R_bone_sensor", jacobian, each=True), error / sigma)


def camera_mounting_equations(at: CameraEvaluation) -> Iterator[DenseEquations]:
    """One factor on how the camera's sensor sits."""
    if at.problem.imu is not None:
        error = rotation_prior_residual(at.state.R_camera_imu, at.problem.prior_R_camera_imu)
        jacobian = inverse_right_jacobian(error)[None, None] / at.problem.mounting_sigma
        block = JacobianBlock(at.owner, "R_camera_imu", jacobian)
        yield from prior_equations(block, error[None] / at.problem.mounting_sigma)


def initial_pose_equations(at: WearerEvaluation, first: slice) -> Iterator[JointEquations]:
    """One factor for each joint but the root, in the frames of the declared pose; these together weigh as one."""
    declared = at.problem.initial_pose
    if declared is None or first.start >= declared.left:
        return
    settings = at.problem.settings.initial_pose
    sigma = declared.pose.sigma[1:] * settings.scale * np.sqrt(declared.frames)  # (23, 3) rad
    held = slice(first.start, min(first.stop, declared.left))
    error = rotation_prior_residual(at.state.R_parent_child[held, 1:], declared.pose.R_parent_child[1:])
    yield JointEquations(
        held.start, error / sigma, 1.0, SQUARE, at.owner, lambda: (inverse_right_jacobian(error) / sigma[..., None],)
    )


MOUNTING_PRIOR = Term.prior("mounting prior", mounting_equations)
CAMERA_MOUNTING_PRIOR = Term.prior("camera mounting prior", camera_mounting_equations)
INITIAL_POSE = Term("initial pose", 0, initial_pose_equations, every_frame=False)
