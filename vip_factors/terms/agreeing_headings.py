"""Agreeing headings: sensors of one suit that start together have inertial frames that nearly coincide.

Their common north is unknown. The residual of each heading γ is its difference from the circular mean of all,
``c = atan2(Σ sin γ, Σ cos γ)``: ``r_i = γ_i − c`` in [−π, π), with ``∂r_i/∂γ_j = δ_ij − cos(γ_j − c) / Σ_k cos(γ_k −
c)``. The mean itself is free.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.geometry.rotations import wrap_angle
from vip_factors.terms.equations import DenseEquations, JacobianBlock, Term, prior_equations
from vip_factors.terms.evaluation import WearerEvaluation


def equations(wearer: WearerEvaluation) -> Iterator[DenseEquations]:
    """One factor for each sensor, on the headings of all."""
    settings = wearer.problem.settings.agreeing_headings
    if settings.sigma_deg is not None and wearer.problem.free_headings:
        sigma, headings = np.deg2rad(settings.sigma_deg), wearer.state.headings
        mean = np.arctan2(np.sin(headings).sum(), np.cos(headings).sum())
        share = np.cos(headings - mean)
        by_all = (np.eye(len(headings)) - share / share.sum()) / sigma
        block = JacobianBlock(wearer.owner, "headings", by_all[None, :, None])
        yield from prior_equations(block, wrap_angle(headings - mean)[:, None] / sigma, settings.loss)


AGREEING_HEADINGS = Term.prior("agreeing headings", equations)
