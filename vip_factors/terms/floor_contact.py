"""Floor contact: a loaded foot stands on the floor. This keeps the scene level.

The residual is the height of a contact point above the floor z = 0, metres; its derivative by the point is ``e_zᵀ``.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.geometry.rotations import Array
from vip_factors.terms.equations import BoneEquations, JacobianBlock, Term
from vip_factors.terms.evaluation import WearerEvaluation


def equations(wearer: WearerEvaluation, stretch: slice) -> Iterator[BoneEquations]:
    """One factor for each contact point."""
    problem = wearer.problem
    if not (problem.has_floor and problem.contacts):
        return
    settings = problem.settings.floor_contact
    body = wearer.body.at(stretch)
    p = wearer.contact_points.on(body)

    def derivatives() -> tuple[Array, tuple[JacobianBlock, ...]]:
        up = np.broadcast_to(np.array([[0.0, 0.0, 1.0]]) / settings.sigma, (*p.shape[:2], 1, 3))
        return up @ body.point_twists(p), tuple(block.times(up) for block in wearer.contact_blocks(body))

    residual, confidence = p[..., 2:] / settings.sigma, problem.contact_confidence[stretch]
    bones = problem.contact_points.bones
    yield BoneEquations(stretch.start, residual, confidence, settings.loss, wearer.owner, bones, derivatives)


FLOOR_CONTACT = Term("floor contact", 0, equations)
