"""Camera acceleration: the second difference of its IMU's position against what the accelerometer says.

Three rows, m/s², world axes (thesis eqs. 4.27–4.29). Residual and derivative by the heading are those of
:mod:`~vip_factors.terms.acceleration`, of the IMU's place ``q`` on the camera: ``p + R q``. By a step ``(ω, v)`` of
a pose it moves by ``R (v − hat(q) ω)``, times the coefficient of that frame
(:meth:`~vip_factors.terms.camera_pose.CameraPoses.point_jacobian`).
"""

from dataclasses import dataclass, field

from vip_factors.terms.robust import Loss, RobustLoss


@dataclass(frozen=True)
class CameraAccelerationSettings:
    """How far the camera's acceleration is from its sensor's."""

    sigma: float = 0.5  # m/s², each row: no soft tissue; a tilt error of 1.5° lets 0.25 of gravity through
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.HUBER, 2.0))  # knocks against the phone
