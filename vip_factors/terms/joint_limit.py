"""Joint limits: a penalty beyond a joint's range of motion.

The residual is the distance of each coordinate of ``x = Log(R)`` from its range, radians (thesis eq. 3.15). Outside the
range its derivative is the coordinate's row of ``∂x/∂δ = J_r⁻¹(x)``.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.geometry.rotations import Array
from vip_factors.terms.equations import JointEquations, Term
from vip_factors.terms.evaluation import WearerEvaluation


def equations(wearer: WearerEvaluation, stretch: slice) -> Iterator[JointEquations]:
    """One factor for each joint but the root, or for each of its axes."""
    settings = wearer.problem.settings.joint_limit
    x, sigma = wearer.joint_vectors(stretch), np.deg2rad(settings.sigma_deg)
    outside = wearer.problem.limits.violation(x.reshape(len(x), -1))
    residual = outside.reshape(len(x), -1, 1 if settings.per_axis else 3) / sigma
    outside_range = (outside != 0).reshape(*x.shape, 1)

    def by_joints() -> tuple[Array, ...]:
        return (outside_range * wearer.joint_jacobians(stretch) / sigma,)

    acts = bool(outside_range.any())
    yield JointEquations(stretch.start, residual, 1.0, settings.loss, wearer.owner, by_joints, acts=acts)


JOINT_LIMIT = Term("joint limit", 0, equations)
