"""Joint limits: a hinge that acts only beyond a joint's range of motion."""

from dataclasses import dataclass, field

import gtsam
import numpy as np

from vip_factors.body.joint_limits import JointLimits
from vip_factors.factors.adapter import custom_factor
from vip_factors.factors.chain import FrameKeys
from vip_factors.factors.robust import Loss, RobustLoss
from vip_factors.geometry.rotations import Array, inverse_right_jacobian, log


@dataclass(frozen=True)
class JointLimitSettings:
    """How hard the ends of the range are."""

    sigma_deg: float = 5.0  # people differ by more than this in every published table of ranges
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.CAUCHY, 3.0))  # Kaichi et al. 2020, eqs. 4–5

    @property
    def sigma(self) -> float:
        """Standard deviation in radians, of each row."""
        return float(np.deg2rad(self.sigma_deg))


def joint_limit_residual(x: Array, lower: Array, upper: Array) -> Array:
    """How far each coordinate lies outside its range, in radians: zero inside (thesis eq. 3.15)."""
    return np.minimum(x - lower, 0.0) + np.maximum(x - upper, 0.0)


def joint_limit_factor(
    keys: FrameKeys, joint: int, limits: JointLimits, settings: JointLimitSettings
) -> gtsam.CustomFactor:
    """The GTSAM factor on one joint (1 … 23) of one frame."""
    key = keys.joints[joint]
    rows = slice(3 * (joint - 1), 3 * joint)
    lower, upper = limits.lower[rows], limits.upper[rows]

    def evaluate(values: gtsam.Values) -> tuple[Array, list[Array]]:
        x = log(values.atRot3(key).matrix())
        residual = joint_limit_residual(x, lower, upper)
        return residual, [(residual != 0)[:, None] * inverse_right_jacobian(x)]

    noise = settings.loss.noise_model(np.full(3, settings.sigma))
    return custom_factor("joint limit", noise, [key], [3], evaluate)
