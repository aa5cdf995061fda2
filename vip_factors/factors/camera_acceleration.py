"""Camera acceleration: the second difference of its IMU's position against what the accelerometer says."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import gtsam
import numpy as np

from vip_factors.factors.acceleration import acceleration_by_heading, acceleration_residual
from vip_factors.factors.adapter import custom_factor
from vip_factors.factors.camera_pose import CameraPoses
from vip_factors.factors.robust import Loss, RobustLoss
from vip_factors.geometry.rotations import Array


@dataclass(frozen=True)
class CameraAccelerationSettings:
    """How far the camera's acceleration is from its sensor's."""

    sigma: float = 0.5  # m/s², each row: no soft tissue; a tilt error of 1.5° lets 0.25 of gravity through
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.HUBER, 2.0))  # knocks against the phone


def camera_acceleration_factor(
    camera_keys: Sequence[int],
    heading_key: int,
    p_camera_imu: Array,
    specific_force_inertial: Array,
    step: float,
    settings: CameraAccelerationSettings,
) -> gtsam.CustomFactor:
    """The GTSAM factor over three frames (thesis eqs. 4.27–4.29): residual of 3 rows, m/s², world axes.

    The residual is that of :func:`~vip_factors.factors.acceleration.acceleration_residual`, of the IMU's place on the
    camera. Keys in order: the poses before, now and after, and the heading of the camera's IMU.
    """
    weights = np.array([1.0, -2.0, 1.0]) / step**2

    def evaluate(values: gtsam.Values) -> tuple[Array, list[Array]]:
        heading, force = values.atDouble(heading_key), specific_force_inertial[None]
        poses = [CameraPoses.of(values, key) for key in camera_keys]
        before, now, after = (pose.point(p_camera_imu) for pose in poses)
        jacobians = [weight * pose.point_jacobian(p_camera_imu)[0] for weight, pose in zip(weights, poses, strict=True)]
        residual = acceleration_residual(before, now, after, step, heading, force)[0]
        return residual, [*jacobians, acceleration_by_heading(heading, force)[0][:, None]]

    noise = settings.loss.noise_model(np.full(3, settings.sigma))
    return custom_factor("camera acceleration", noise, [*camera_keys, heading_key], [6, 6, 6, 1], evaluate)
