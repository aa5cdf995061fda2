"""Sole: how far the ground is below the skin of the foot. People wear shoes, and a skeleton is barefoot.

What touches the ground are points of the skeleton's foot, moved by ``h`` down the foot's own axis; keypoints stay on
the skeleton. A thickness is never negative: the variable is ``x = ln(h / h₀)``, ``r = x``; both feet have one.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.terms.equations import DenseEquations, JacobianBlock, Term, prior_equations
from vip_factors.terms.evaluation import WearerEvaluation


def equations(at: WearerEvaluation) -> Iterator[DenseEquations]:
    """One factor on the logarithm of the thickness."""
    if at.problem.free_sole:
        settings = at.problem.settings.sole
        block = JacobianBlock(at.owner, "sole", np.ones((1, 1, 1, 1)) / settings.spread)
        yield from prior_equations(block, np.full((1, 1), at.state.sole / settings.spread))


SOLE_PRIOR = Term.prior("sole prior", equations)
