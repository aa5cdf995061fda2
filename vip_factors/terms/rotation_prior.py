"""Rotation prior: mountings near the placement's, joints near those of a declared pose.

With a step on the right of ``R`` the derivative is ``J_r⁻¹(r)``.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.factor_settings import SQUARE
from vip_factors.geometry.rotations import Array, inverse_right_jacobian, log, transpose
from vip_factors.terms.equations import DenseEquations, JacobianBlock, JointEquations, Term, prior_equations
from vip_factors.terms.evaluation import CameraEvaluation, WearerEvaluation


def rotation_prior_residual(R: Array, R_prior: Array) -> Array:
    """``Log(R_priorᵀ R)``, ``(..., 3)`` rad, in the axes of the rotated frame.

    ``R`` is the mounting ``R_bone_sensor`` (the papers' eq. 4.7 with a tolerance) or ``R_parent_child`` of a declared
    initial pose.
    """
    return log(transpose(R_prior) @ R)


def mounting_equations(wearer: WearerEvaluation) -> Iterator[DenseEquations]:
    """One factor for each sensor."""
    if wearer.problem.free_mountings:
        sigma = wearer.problem.mounting_sigma[:, None]
        error = rotation_prior_residual(wearer.state.R_bone_sensor, wearer.problem.prior_R_bone_sensor)
        jacobian = (inverse_right_jacobian(error) / sigma[..., None])[None]
        block = JacobianBlock(wearer.owner, "R_bone_sensor", jacobian, is_per_factor=True)
        yield from prior_equations(block, error / sigma)


def camera_mounting_equations(camera: CameraEvaluation) -> Iterator[DenseEquations]:
    """One factor on the mounting of the camera's IMU."""
    if camera.problem.imu is not None:
        error = rotation_prior_residual(camera.state.R_camera_imu, camera.problem.prior_R_camera_imu)
        jacobian = inverse_right_jacobian(error)[None, None] / camera.problem.mounting_sigma
        block = JacobianBlock(camera.owner, "R_camera_imu", jacobian)
        yield from prior_equations(block, error[None] / camera.problem.mounting_sigma)


def initial_pose_equations(wearer: WearerEvaluation, stretch: slice) -> Iterator[JointEquations]:
    """One factor for each joint but the root in the frames of the declared pose; all frames weigh as one."""
    declared = wearer.problem.initial_pose
    if declared is None or stretch.start >= declared.left:
        return
    settings = wearer.problem.settings.initial_pose
    sigma = declared.pose.sigma[1:] * settings.scale * np.sqrt(declared.frames)  # (23, 3) rad
    frames = slice(stretch.start, min(stretch.stop, declared.left))
    error = rotation_prior_residual(wearer.state.R_parent_child[frames, 1:], declared.pose.R_parent_child[1:])

    def by_joints() -> tuple[Array, ...]:
        return (inverse_right_jacobian(error) / sigma[..., None],)

    yield JointEquations(frames.start, error / sigma, 1.0, SQUARE, wearer.owner, by_joints)


MOUNTING_PRIOR = Term.prior("mounting prior", mounting_equations)
CAMERA_MOUNTING_PRIOR = Term.prior("camera mounting prior", camera_mounting_equations)
INITIAL_POSE = Term("initial pose", 0, initial_pose_equations, every_frame=False)
