"""Camera orientation: the attitude estimate of the IMU on the camera against the camera's pose.

With ``E = Exp(r)`` the error: a step ``ω`` of the camera is ``R Exp(ω) R_ci S = Exp(R ω) E``, on the error's left, so
``∂r/∂ω = J_l⁻¹(r) R``; the mounting likewise with ``R R_ci``; the heading turns on the right, ``E Rz(−dγ)``:
``−J_r⁻¹(r) e_z``.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from vip_factors.geometry.rotations import (
    Array,
    inverse_right_jacobian,
    log,
    rotation_z,
    transpose,
)
from vip_factors.problem.state import CameraPoses
from vip_factors.terms.equations import DenseEquations, JacobianBlock, Term
from vip_factors.terms.evaluation import CameraEvaluation
from vip_factors.terms.robust import Loss, RobustLoss


@dataclass(frozen=True)
class CameraOrientationSettings:
    """How far the camera's orientation is from its sensor's."""

    sigma_deg: float = 1.5  # a rigid mount: what remains are the errors of the attitude filter (data sheets: 0.5–2.5)
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.HUBER, 2.0))  # magnets in doors and cars

    @property
    def sigma(self) -> float:
        """Standard deviation in radians, of each row."""
        return float(np.deg2rad(self.sigma_deg))


def camera_orientation_residual(
    camera: CameraPoses, R_camera_imu: Array, heading: float, R_inertial_imu: Array
) -> Array:
    """``Log(R_world_camera R_camera_imu (Rz(γ) R_inertial_imu)ᵀ)``, ``(T, 3)`` rad, world axes (thesis eq. 4.22)."""
    return log(camera.R_world_camera @ R_camera_imu @ transpose(rotation_z(heading) @ R_inertial_imu))


def camera_orientation_jacobians(
    camera: CameraPoses, R_camera_imu: Array, residual: Array
) -> tuple[Array, Array, Array]:
    """By the camera's tangent ``(T, 3, 6)``, by the heading ``(T, 3)``, by the mounting ``(T, 3, 3)``."""
    right = inverse_right_jacobian(residual)
    left = transpose(right)
    by_rotation = left @ camera.R_world_camera
    by_pose = np.concatenate([by_rotation, np.zeros_like(by_rotation)], axis=2)
    return by_pose, -right[:, :, 2], by_rotation @ R_camera_imu


def equations(at: CameraEvaluation, first: slice) -> Iterator[DenseEquations]:
    """One factor a frame."""
    imu = at.problem.imu
    if imu is None:
        return
    settings: CameraOrientationSettings = at.problem.settings.orientation
    sigma = settings.sigma / float(np.sqrt(at.problem.orientation_weight(at.step)))
    poses, mounting = at.poses(first), at.state.R_camera_imu
    error = camera_orientation_residual(poses, mounting, at.state.heading, imu.R_inertial_sensor[first, 0])

    def blocks() -> tuple[JacobianBlock, ...]:
        by_pose, by_heading, by_mounting = (J / sigma for J in camera_orientation_jacobians(poses, mounting, error))
        return (
            JacobianBlock(at.owner, "poses", by_pose[:, None]),
            JacobianBlock(at.owner, "heading", by_heading[:, None, :, None]),
            JacobianBlock(at.owner, "R_camera_imu", by_mounting[:, None]),
        )

    yield DenseEquations(first.start, error[:, None] / sigma, imu.orientation_valid[first], settings.loss, blocks)


CAMERA_ORIENTATION = Term("camera orientation", 0, equations)
