"""Floor contact: a foot that bears the body stands on the floor. Without it a whole scene may tilt unnoticed.

The residual is the height of a contact point over the floor at z = 0, metres; its derivative by the point ``e_zᵀ``.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.geometry.rotations import Array
from vip_factors.terms.equations import BoneEquations, JacobianBlock, Term
from vip_factors.terms.evaluation import WearerEvaluation


def equations(at: WearerEvaluation, first: slice) -> Iterator[BoneEquations]:
    """One factor for each contact point."""
    problem = at.problem
    if not (problem.has_floor and problem.contacts):
        return
    settings = problem.settings.floor_contact
    body = at.body.at(first)
    p = at.contact_points.on(body)

    def derivatives() -> tuple[Array, tuple[JacobianBlock, ...]]:
        up = np.broadcast_to(np.array([[0.0, 0.0, 1.0]]) / settings.sigma, (*p.shape[:2], 1, 3))
        return up @ body.point_twists(p), tuple(one.times(up) for one in at.contact_blocks(body))

    yield BoneEquations(
        first.start, p[..., 2:] / settings.sigma, problem.contact_confidence[first], settings.loss,
        at.owner, problem.contact_points.bones, derivatives,
    )  # fmt: skip


FLOOR_CONTACT = Term("floor contact", 0, equations)
