"""Contact of feet with the floor: a loaded foot stands on it and does not move."""

from collections.abc import Iterator

import numpy as np

from vip_factors.geometry.rotations import Array
from vip_factors.terms.equations import BoneEquations, DifferenceEquations, JacobianBlock, Term, finite_difference
from vip_factors.terms.evaluation import WearerEvaluation


def floor_equations(wearer: WearerEvaluation, stretch: slice) -> Iterator[BoneEquations]:
    """Floor contact: one factor for each contact point. This keeps the scene level.

    The residual is the height of a contact point above the floor z = 0, metres; its derivative by the point is
    ``e_zᵀ``.
    """
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


def foot_equations(wearer: WearerEvaluation, stretch: slice) -> Iterator[DifferenceEquations]:
    """Foot contact: one factor for each contact point, from a frame to the next.

    This bounds the drift of an inertial root path. The residual is the velocity of a contact point between two frames,
    m/s: linear in the two positions, with derivatives ``−1/step`` and ``1/step``, each times the identity.
    """
    problem = wearer.problem
    if not (problem.use_acceleration and problem.contacts):
        return
    settings = problem.settings.foot_contact
    body, step = wearer.body.at(slice(stretch.start, stretch.stop + 1)), problem.frames.step
    p, c = wearer.contact_points.on(body), np.array([-1.0, 1.0]) / (step * settings.sigma)
    residual = (p[1:] - p[:-1]) / step / settings.sigma
    confidence = problem.contact_confidence[stretch] * problem.frames.follows[stretch, None]
    bones, arms = problem.contact_points.bones, wearer.arms(p, stretch)

    def blocks() -> tuple[JacobianBlock, ...]:
        return finite_difference(wearer.contact_blocks(body), c)

    yield DifferenceEquations(stretch.start, residual, confidence, settings.loss, wearer.owner, bones, arms, c, blocks)


FLOOR_CONTACT = Term("floor contact", 0, floor_equations)
FOOT_CONTACT = Term("foot contact", 1, foot_equations)
