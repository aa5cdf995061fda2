"""Joint limits: a hinge that acts only beyond a joint's range of motion."""

from collections.abc import Iterator
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
    # Whether the loss is of each axis by itself, as in their eq. 4; off: of a joint's three, whichever way axes are put
    per_axis: bool = False

    @property
    def sigma(self) -> float:
        """Standard deviation in radians, of each row."""
        return float(np.deg2rad(self.sigma_deg))


def joint_limit_residual(x: Array, lower: Array, upper: Array) -> Array:
    """How far each coordinate lies outside its range, in radians: zero inside (thesis eq. 3.15)."""
    return np.minimum(x - lower, 0.0) + np.maximum(x - upper, 0.0)


def joint_limit_factors(
    keys: FrameKeys, joint: int, limits: JointLimits, settings: JointLimitSettings
) -> Iterator[gtsam.CustomFactor]:
    """The GTSAM factors on one joint (1 … 23) of one frame: one, or one for each axis."""
    for axes in (slice(0, 1), slice(1, 2), slice(2, 3)) if settings.per_axis else (slice(0, 3),):
        yield joint_limit_factor(keys, joint, limits, settings, axes)


def joint_limit_factor(
    keys: FrameKeys, joint: int, limits: JointLimits, settings: JointLimitSettings, axes: slice = slice(0, 3)
) -> gtsam.CustomFactor:
    """The GTSAM factor on one joint (1 … 23) of one frame, or on some of its axes."""
    key = keys.joints[joint]
    rows = slice(3 * (joint - 1), 3 * joint)
    lower, upper = limits.lower[rows][axes], limits.upper[rows][axes]

    def evaluate(values: gtsam.Values) -> tuple[Array, list[Array]]:
        x = log(values.atRot3(key).matrix())
        residual = joint_limit_residual(x[axes], lower, upper)
        return residual, [(residual != 0)[:, None] * inverse_right_jacobian(x)[axes]]

    noise = settings.loss.noise_model(np.full(len(lower), settings.sigma))
    return custom_factor("joint limit", noise, [key], [3], evaluate)
