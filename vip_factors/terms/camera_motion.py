"""Motion of a carried camera from frame to frame: it is slow, and as visual odometry measures it."""

from collections.abc import Iterator

import numpy as np

from vip_factors.factor_settings import CameraVelocitySettings
from vip_factors.geometry.rotations import Array, hat, inverse_right_jacobian, log, transpose
from vip_factors.problem.state import CameraPoses
from vip_factors.terms.equations import DenseEquations, JacobianBlock, Term, scalar_prior
from vip_factors.terms.evaluation import CameraEvaluation

SCALE_SIGMA = 2.0  # of the logarithm of the path's spread in metres


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


def velocity_equations(camera: CameraEvaluation, stretch: slice) -> Iterator[DenseEquations]:
    """Camera velocity: one factor for each frame and the next. It bridges frames without detections."""
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


def odometry_equations(camera: CameraEvaluation, stretch: slice) -> Iterator[DenseEquations]:
    """Camera odometry: one factor for each frame and the next, against the path from visual odometry.

    The residual is ``(Log(R_zᵀ R₀ᵀ R₁), R₀ᵀ (p₁ − p₀) − exp(s) p_z)``, rad and m, with the measured relative pose
    ``(R_z, p_z)`` and the logarithm ``s`` of the path's scale, as GTSAM's BetweenFactor measures it up to the choice of
    the logarithm. Errors of odometry add up along the path, so the variance is that of one second times the step.
    """
    odometry = camera.problem.odometry
    if odometry is None or not camera.is_path:
        return
    settings = camera.problem.settings.odometry
    sigmas = np.repeat([np.deg2rad(settings.turn_sigma_deg), settings.shift_sigma], 3) * np.sqrt(camera.step)
    poses, next_poses = camera.poses(stretch), camera.poses(slice(stretch.start + 1, stretch.stop + 1))
    R_camera_next = transpose(poses.R_world_camera) @ next_poses.R_world_camera
    turn = log(transpose(odometry.R_camera_next[stretch]) @ R_camera_next)
    motion = camera_velocity_residual(poses, next_poses, 1.0)
    shift = float(np.exp(camera.state.path_scale)) * odometry.p_camera_next[stretch]
    residual = np.concatenate([turn, motion[:, 3:] - shift], axis=1)

    def blocks() -> tuple[JacobianBlock, ...]:
        by_pose, by_next = camera_velocity_jacobians(poses, next_poses, motion, 1.0)
        by_next[:, :3, :3] = inverse_right_jacobian(turn)
        by_pose[:, :3, :3] = -by_next[:, :3, :3] @ transpose(R_camera_next)
        by_scale: Array = np.concatenate([np.zeros_like(shift), -shift], axis=1)
        whitened = [(by / sigmas[:, None])[:, None] for by in (by_pose, by_next, by_scale[:, :, None])]
        frames = (JacobianBlock(camera.owner, "poses", by, ahead=ahead) for ahead, by in enumerate(whitened[:2]))
        return (*frames, JacobianBlock(camera.owner, "path_scale", whitened[2]))

    confidence = odometry.valid[stretch, None].astype(float)
    yield DenseEquations(stretch.start, (residual / sigmas)[:, None], confidence, settings.loss, blocks)


def scale_equations(camera: CameraEvaluation) -> Iterator[DenseEquations]:
    """One factor on the scale of the odometry, where it is a variable."""
    if camera.problem.odometry is not None and camera.problem.odometry.is_scale_free:
        yield from scalar_prior(camera.owner, "path_scale", camera.state.path_scale, SCALE_SIGMA)


CAMERA_VELOCITY = Term("camera velocity", 1, velocity_equations)
CAMERA_ODOMETRY = Term("camera odometry", 1, odometry_equations, every_frame=False)
ODOMETRY_SCALE_PRIOR = Term.prior("odometry scale prior", scale_equations)
