"""Camera orientation: the attitude estimate of the IMU on the camera against the camera's pose."""

from dataclasses import dataclass, field

import gtsam
import numpy as np

from vip_factors.factors.adapter import custom_factor
from vip_factors.factors.camera_pose import CameraPoses
from vip_factors.factors.robust import Loss, RobustLoss
from vip_factors.geometry.rotations import (
    Array,
    inverse_right_jacobian,
    log,
    rotation_z,
    transpose,
)


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


def camera_orientation_factor(
    camera_key: int,
    heading_key: int,
    mounting_key: int,
    R_inertial_imu: Array,
    weight: float,
    settings: CameraOrientationSettings,
) -> gtsam.CustomFactor:
    """The GTSAM factor of one frame; ``weight`` divides the variance.

    Keys in order: the camera's pose, the heading and the mounting of its IMU.
    """

    def evaluate(values: gtsam.Values) -> tuple[Array, list[Array]]:
        camera, heading = CameraPoses.of(values, camera_key), values.atDouble(heading_key)
        mounting = values.atRot3(mounting_key).matrix()
        residual = camera_orientation_residual(camera, mounting, heading, R_inertial_imu)
        by_pose, by_heading, by_mounting = camera_orientation_jacobians(camera, mounting, residual)
        return residual[0], [by_pose[0], by_heading[0][:, None], by_mounting[0]]

    noise = settings.loss.noise_model(np.full(3, settings.sigma / np.sqrt(weight)))
    return custom_factor("camera orientation", noise, [camera_key, heading_key, mounting_key], [6, 1, 3], evaluate)
