"""Foot contact: a loaded foot does not move. This bounds the drift of an inertial root path.

The residual is the velocity of a contact point between two frames, m/s: linear in the two positions, with derivatives
``−1/step`` and ``1/step``, each times the identity.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.terms.equations import DifferenceEquations, JacobianBlock, Term, finite_difference
from vip_factors.terms.evaluation import WearerEvaluation


def equations(wearer: WearerEvaluation, stretch: slice) -> Iterator[DifferenceEquations]:
    """One factor for each contact point, from a frame to the next."""
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


FOOT_CONTACT = Term("foot contact", 1, equations)
