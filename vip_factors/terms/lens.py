"""Lens: the logarithm of the focal length over the supposed one, with a Gaussian prior.

The residual is ``z / σ``. Both focal lengths are ``exp(z)`` times the supposed ones; the principal point and the
distortion stay as they are.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.terms.equations import DenseEquations, JacobianBlock, Term, prior_equations
from vip_factors.terms.evaluation import CameraEvaluation


def equations(at: CameraEvaluation) -> Iterator[DenseEquations]:
    """One factor on the focal length, where it is a variable."""
    sigma = at.problem.focal_sigma
    if sigma:
        root = np.full((1, 1), 1 / sigma)
        yield from prior_equations(JacobianBlock(at.owner, "zoom", root[None, None]), root * at.state.zoom)


LENS_PRIOR = Term.prior("lens prior", equations)
