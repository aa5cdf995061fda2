"""Lens: Gaussian prior on the logarithm ``z`` of the focal length over its nominal value.

The residual is ``z / σ``. Both focal lengths are ``exp(z)`` times the nominal ones; principal point and distortion are
constant.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.terms.equations import DenseEquations, JacobianBlock, Term, prior_equations
from vip_factors.terms.evaluation import CameraEvaluation


def equations(camera: CameraEvaluation) -> Iterator[DenseEquations]:
    """One factor on the focal length, if it is a variable."""
    sigma = camera.problem.focal_sigma
    if sigma:
        root = np.full((1, 1), 1 / sigma)
        yield from prior_equations(JacobianBlock(camera.owner, "zoom", root[None, None]), root * camera.state.zoom)


LENS_PRIOR = Term.prior("lens prior", equations)
