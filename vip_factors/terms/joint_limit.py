"""Joint limits: a hinge that acts only beyond a joint's range of motion.

Outside, the residual moves as the coordinate: with ``x = Log(R)`` and a step on the right, ``∂x/∂δ = J_r⁻¹(x)``, of
which the rows count that are beyond the range.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from vip_factors.geometry.rotations import Array
from vip_factors.terms.equations import JointEquations, Term
from vip_factors.terms.evaluation import WearerEvaluation
from vip_factors.terms.robust import Loss, RobustLoss


@dataclass(frozen=True)
class JointLimitSettings:
    """How hard the ends of the range are."""

    sigma_deg: float = 3.0  # people differ by more than this in every published table of ranges
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


def equations(at: WearerEvaluation, first: slice) -> Iterator[JointEquations]:
    """One factor for each joint but the root, or for each of its axes."""
    limits = at.problem.limits
    settings: JointLimitSettings = at.problem.settings.joint_limit
    x = at.joint_vectors(first)
    outside = joint_limit_residual(x.reshape(len(x), -1), limits.lower, limits.upper)
    residual = outside.reshape(len(x), -1, 1 if settings.per_axis else 3) / settings.sigma
    outside_range = (outside != 0).reshape(*x.shape, 1)
    yield JointEquations(
        first.start, residual, 1.0, settings.loss, at.owner,
        lambda: (outside_range * at.joint_jacobians(first) / settings.sigma,), acts=bool(outside_range.any()),
    )  # fmt: skip


JOINT_LIMIT = Term("joint limit", 0, equations)
