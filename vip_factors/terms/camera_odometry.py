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


def equations(at: CameraEvaluation, first: slice) -> Iterator[DenseEquations]:
    """One factor for each frame and its next, and on the scale where that is free."""
    odometry = at.problem.odometry
    if odometry is None or not at.is_path:
        return
    settings = at.problem.settings.odometry
    sigmas = np.repeat([np.deg2rad(settings.turn_sigma_deg), settings.shift_sigma], 3) * np.sqrt(at.step)
    poses, next_poses = at.poses(first), at.poses(slice(first.start + 1, first.stop + 1))
    R_camera_next = transpose(poses.R_world_camera) @ next_poses.R_world_camera
    turn = log(transpose(odometry.R_camera_next[first]) @ R_camera_next)
    motion = camera_velocity_residual(poses, next_poses, 1.0)
    shift = float(np.exp(at.state.path_scale)) * odometry.p_camera_next[first]
    residual = np.concatenate([turn, motion[:, 3:] - shift], axis=1)

    def blocks() -> tuple[JacobianBlock, ...]:
        by_pose, by_next = camera_velocity_jacobians(poses, next_poses, motion, 1.0)
        by_next[:, :3, :3] = inverse_right_jacobian(turn)
        by_pose[:, :3, :3] = -by_next[:, :3, :3] @ transpose(R_camera_next)
        by_scale: Array = np.concatenate([np.zeros_like(shift), -shift], axis=1)
        whitened = [(by / sigmas[:, None])[:, None] for by in (by_pose, by_next, by_scale[:, :, None])]
        frames = (JacobianBlock(at.owner, "poses", by, ahead=ahead) for ahead, by in enumerate(whitened[:2]))
        return (*frames, JacobianBlock(at.owner, "path_scale", whitened[2]))

    confidence = odometry.valid[first, None].astype(float)
    yield DenseEquations(first.start, (residual / sigmas)[:, None], confidence, settings.loss, blocks)


def scale_equations(at: CameraEvaluation) -> Iterator[DenseEquations]:
    """One factor on the scale, where it is a variable."""
    if at.problem.odometry is not None and at.problem.odometry.is_scale_free:
        root = np.full((1, 1), 1 / SCALE_SIGMA)
        yield from prior_equations(JacobianBlock(at.owner, "path_scale", root[None, None]), root * at.state.path_scale)


CAMERA_ODOMETRY = Term("camera odometry", 1, equations, every_frame=False)
ODOMETRY_SCALE_PRIOR = Term.prior("odometry scale prior", scale_equations)
