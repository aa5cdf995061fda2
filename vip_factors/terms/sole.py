"""Sole: prior on the thickness ``h`` of the shoes' soles.

Contact points are points of the skeleton's barefoot foot, shifted by ``h`` down the foot's axis; keypoints are not
shifted. The variable is ``x = ln(h / h₀)``, common to both feet, and ``r = x``.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.terms.equations import DenseEquations, JacobianBlock, Term, prior_equations
from vip_factors.terms.evaluation import WearerEvaluation


def equations(wearer: WearerEvaluation) -> Iterator[DenseEquations]:
    """One factor on the logarithm of the thickness."""
    if wearer.problem.free_sole:
        settings = wearer.problem.settings.sole
        block = JacobianBlock(wearer.owner, "sole", np.ones((1, 1, 1, 1)) / settings.spread)
        yield from prior_equations(block, np.full((1, 1), wearer.state.sole / settings.spread))


SOLE_PRIOR = Term.prior("sole prior", equations)
