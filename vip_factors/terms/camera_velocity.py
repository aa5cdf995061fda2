"""Camera velocity: a hand-held camera turns and moves slowly. Bridges frames without detections."""

from collections.abc import Iterator

import numpy as np

from vip_factors.factor_settings import CameraVelocitySettings
from vip_factors.geometry.rotations import Array, hat, inverse_right_jacobian, log, transpose
from vip_factors.problem.state import CameraPoses
from vip_factors.terms.equations import DenseEquations, JacobianBlock, Term
from vip_factors.terms.evaluation import CameraEvaluation


def camera_velocity_sigmas(settings: CameraVelocitySettings) -> Array:
    """``(6,)`` standard deviations: rad/s, then m/s."""
    return np.repeat([np.deg2rad(settings.turn_sigma_deg_s), settings.speed_sigma], 3)


def camera_velocity_residual(poses_0: CameraPoses, poses_1: CameraPoses, step: float) -> Array:
    """``(Log(R₀ᵀ R₁), R₀ᵀ (p₁ − p₀)) / step`` of successive poses: ``(T, 6)``, rad/s and m/s in the camera's axes."""
    turn = log(transpose(poses_0.R_world_camera) @ poses_1.R_world_camera)
    shift = np.einsum("tji,tj->ti", poses_0.R_world_camera, poses_1.p_world_camera - poses_0.p_world_camera)
    return np.concatenate([turn, shift], axis=1) / step


def camera_velocity_jacobians(
    poses_0: CameraPoses, poses_1: CameraPoses, residual: Array, step: float
) -> tuple[Array, Array]:
    """Derivatives ``(T, 6, 6)`` of :func:`camera_velocity_residual` by the tangents of the two poses."""
    T = len(residual)
    turn, shift = residual[:, :3] * step, residual[:, 3:] * step
    by_pose_0, by_pose_1 = np.zeros((2, T, 6, 6))
    by_pose_1[:, :3, :3] = inverse_right_jacobian(turn)
    by_pose_0[:, :3, :3] = -transpose(by_pose_1[:, :3, :3])  # the left Jacobian is the transpose of the right one
    by_pose_0[:, 3:, :3] = hat(shift)
    by_pose_0[:, 3:, 3:] = -np.eye(3)
    by_pose_1[:, 3:, 3:] = transpose(poses_0.R_world_camera) @ poses_1.R_world_camera
    return by_pose_0 / step, by_pose_1 / step


def equations(camera: CameraEvaluation, stretch: slice) -> Iterator[DenseEquations]:
    """One factor for each frame and the next."""
    if not camera.is_path:
        return
    settings = camera.problem.settings.velocity
    sigmas = camera_velocity_sigmas(settings)
    poses_0, poses_1 = camera.poses(stretch), camera.poses(slice(stretch.start + 1, stretch.stop + 1))
    residual = camera_velocity_residual(poses_0, poses_1, camera.step)

    def blocks() -> tuple[JacobianBlock, ...]:
        jacobians = camera_velocity_jacobians(poses_0, poses_1, residual, camera.step)
        whitened = (J[:, None] / sigmas[:, None] for J in jacobians)
        return tuple(JacobianBlock(camera.owner, "poses", J, ahead=ahead) for ahead, J in enumerate(whitened))

    yield DenseEquations(stretch.start, (residual / sigmas)[:, None], 1.0, settings.loss, blocks)


CAMERA_VELOCITY = Term("camera velocity", 1, equations)
