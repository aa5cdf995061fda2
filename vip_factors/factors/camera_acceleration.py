"""Camera acceleration: the second difference of its IMU's position against what the accelerometer says."""

from dataclasses import dataclass, field

from vip_factors.factors.robust import Loss, RobustLoss


@dataclass(frozen=True)
class CameraAccelerationSettings:
    """How far the camera's acceleration is from its sensor's."""

    sigma: float = 0.5  # m/s², each row: no soft tissue; a tilt error of 1.5° lets 0.25 of gravity through
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.HUBER, 2.0))  # knocks against the phone
