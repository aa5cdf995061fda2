"""Camera odometry: the camera's motion between consecutive frames against that of a path from visual odometry.

The residual is ``(Log(R_zᵀ R₀ᵀ R₁), R₀ᵀ (p₁ − p₀) − exp(s) p_z)``, rad and m, with the measured relative pose
``(R_z, p_z)`` and the logarithm ``s`` of the path's scale, as GTSAM's BetweenFactor measures it up to the choice of the
logarithm. Errors of odometry add up along the path, so the variance is that of one second times the step.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.geometry.rotations import Array, inverse_right_jacobian, log, transpose
from vip_factors.terms.camera_velocity import camera_velocity_jacobians, camera_velocity_residual
from vip_factors.terms.equations import DenseEquations, JacobianBlock, Term, prior_equations
from vip_factors.terms.evaluation import CameraEvaluation

SCALE_SIGMA = 2.0  # of the logarithm of the path's spread in metres


def equations(camera: CameraEvaluation, stretch: slice) -> Iterator[DenseEquations]:
    """One factor for each frame and its next, and on the scale where that is free."""
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
    """One factor on the scale, where it is a variable."""
    if camera.problem.odometry is not None and camera.problem.odometry.is_scale_free:
        root = np.full((1, 1), 1 / SCALE_SIGMA)
        yield from prior_equations(
            JacobianBlock(camera.owner, "path_scale", root[None, None]), root * camera.state.path_scale
        )


CAMERA_ODOMETRY = Term("camera odometry", 1, equations, every_frame=False)
ODOMETRY_SCALE_PRIOR = Term.prior("odometry scale prior", scale_equations)
