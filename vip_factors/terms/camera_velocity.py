"""Camera velocity: a camera in a hand neither turns nor moves fast. What bridges frames that see nobody."""

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


def camera_velocity_residual(now: CameraPoses, after: CameraPoses, step: float) -> Array:
    """``(Log(R₀ᵀ R₁), R₀ᵀ (p₁ − p₀)) / step`` of successive poses: ``(T, 6)``, rad/s and m/s in the camera's axes."""
    turn = log(transpose(now.R_world_camera) @ after.R_world_camera)
    shift = np.einsum("tji,tj->ti", now.R_world_camera, after.p_world_camera - now.p_world_camera)
    return np.concatenate([turn, shift], axis=1) / step


def camera_velocity_jacobians(
    now: CameraPoses, after: CameraPoses, residual: Array, step: float
) -> tuple[Array, Array]:
    """Derivatives ``(T, 6, 6)`` of :func:`camera_velocity_residual` by the tangent of either pose."""
    T = len(residual)
    turn, shift = residual[:, :3] * step, residual[:, 3:] * step
    by_now, by_after = np.zeros((2, T, 6, 6))
    by_after[:, :3, :3] = inverse_right_jacobian(turn)
    by_now[:, :3, :3] = -transpose(by_after[:, :3, :3])  # the left one is its transpose
    by_now[:, 3:, :3] = hat(shift)
    by_now[:, 3:, 3:] = -np.eye(3)
    by_after[:, 3:, 3:] = transpose(now.R_world_camera) @ after.R_world_camera
    return by_now / step, by_after / step


def equations(at: CameraEvaluation, first: slice) -> Iterator[DenseEquations]:
    """One factor for each frame and its next."""
    if not at.is_path:
        return
    settings = at.problem.settings.velocity
    sigmas = camera_velocity_sigmas(settings)
    now, after = at.poses(first), at.poses(slice(first.start + 1, first.stop + 1))
    residual = camera_velocity_residual(now, after, at.step)

    def blocks() -> tuple[JacobianBlock, ...]:
        jacobians = camera_velocity_jacobians(now, after, residual, at.step)
        whitened = (J[:, None] / sigmas[:, None] for J in jacobians)
        return tuple(JacobianBlock(at.owner, "poses", J, ahead=ahead) for ahead, J in enumerate(whitened))

    yield DenseEquations(first.start, (residual / sigmas)[:, None], 1.0, settings.loss, blocks)


CAMERA_VELOCITY = Term("camera velocity", 1, equations)
