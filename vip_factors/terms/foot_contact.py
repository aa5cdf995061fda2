"""Foot contact: a foot that bears the body does not move. It is what keeps an inertial root path from running away.

The residual is the velocity of a contact point between two frames, m/s: linear in the two positions, with derivatives
``−1/step`` and ``1/step``, each times the identity.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.terms.equations import DifferenceEquations, Term, differenced
from vip_factors.terms.evaluation import WearerEvaluation


def equations(at: WearerEvaluation, first: slice) -> Iterator[DifferenceEquations]:
    """One factor for each contact point, from a frame to the next."""
    problem = at.problem
    if not (problem.use_acceleration and problem.contacts):
        return
    settings = problem.settings.foot_contact
    body, step = at.body.at(slice(first.start, first.stop + 1)), problem.frames.step
    p, c = at.contact_points.on(body), np.array([-1.0, 1.0]) / (step * settings.sigma)
    yield DifferenceEquations(
        first.start, (p[1:] - p[:-1]) / step / settings.sigma,
        problem.contact_confidence[first] * problem.frames.follows[first, None], settings.loss, at.owner,
        problem.contact_points.bones, at.arms(p, first), c, lambda: differenced(at.contact_blocks(body), c),
    )  # fmt: skip


FOOT_CONTACT = Term("foot contact", 1, equations)
