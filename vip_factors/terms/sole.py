"""Sole: how far the ground is below the skin of the foot. People wear shoes, and a skeleton is barefoot.

What touches the ground are points of the skeleton's foot, moved by ``h`` down the foot's own axis; keypoints stay on
the skeleton. A thickness is never negative: the variable is ``x = ln(h / h₀)``, ``r = x``; both feet have one.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from vip_factors.ranges import NotNegative
from vip_factors.terms.equations import DenseEquations, JacobianBlock, Term, prior_equations
from vip_factors.terms.evaluation import WearerEvaluation


@dataclass(frozen=True)
class SoleSettings:
    """How thick soles are: log-normal, its mean 18 mm and its standard deviation 12 mm."""

    # m, the median. Bare feet and socks have 0–5 mm, canvas shoes 10–20, trainers 25–35 under the heel and a centimetre
    # less under the ball; ergonomists add 25 mm for men's shoes (Pheasant & Haslegrave, Bodyspace), captured motions
    # have their feet 6–15 mm over the floor, and one measured walker's ankles stood 36 mm higher than a table's.
    thickness: NotNegative = 0.015
    spread: float = 0.6  # of its logarithm: two thirds of all people are within 8–27 mm, nearly all within 5–50

    def of(self, log_ratio: float) -> float:
        """Metres, of a value ``x`` of the variable."""
        return float(self.thickness * np.exp(log_ratio))


def equations(at: WearerEvaluation) -> Iterator[DenseEquations]:
    """One factor on the logarithm of the thickness."""
    if at.problem.free_sole:
        settings = at.problem.settings.sole
        block = JacobianBlock(at.owner, "sole", np.ones((1, 1, 1, 1)) / settings.spread)
        yield from prior_equations(block, np.full((1, 1), at.state.sole / settings.spread))


SOLE_PRIOR = Term.prior("sole prior", equations)
