"""Joint limits: a hinge that acts only beyond a joint's range of motion.

The residual is how far each coordinate of ``x = Log(R)`` lies outside, radians, zero inside (thesis eq. 3.15). There it
moves as the coordinate: with a step on the right ``∂x/∂δ = J_r⁻¹(x)``, of which the rows count that are beyond.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.terms.equations import JointEquations, Term
from vip_factors.terms.evaluation import WearerEvaluation


def equations(at: WearerEvaluation, first: slice) -> Iterator[JointEquations]:
    """One factor for each joint but the root, or for each of its axes."""
    settings = at.problem.settings.joint_limit
    x, sigma = at.joint_vectors(first), np.deg2rad(settings.sigma_deg)
    outside = at.problem.limits.violation(x.reshape(len(x), -1))
    residual = outside.reshape(len(x), -1, 1 if settings.per_axis else 3) / sigma
    outside_range = (outside != 0).reshape(*x.shape, 1)
    yield JointEquations(
        first.start, residual, 1.0, settings.loss, at.owner,
        lambda: (outside_range * at.joint_jacobians(first) / sigma,), acts=bool(outside_range.any()),
    )  # fmt: skip


JOINT_LIMIT = Term("joint limit", 0, equations)
