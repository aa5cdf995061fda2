"""Agreeing headings: sensors of one suit that were started together have inertial frames that nearly coincide.

Nobody knows where their common north is, only that it is common. So each heading γ is held to the circular mean of all,
``c = atan2(Σ sin γ, Σ cos γ)``, and the mean to nothing: ``r_i = γ_i − c`` in [−π, π), with the derivative of the
arctangent ``∂r_i/∂γ_j = δ_ij − cos(γ_j − c) / Σ_k cos(γ_k − c)``.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.geometry.rotations import wrap_angle
from vip_factors.terms.equations import DenseEquations, JacobianBlock, Term, prior_equations
from vip_factors.terms.evaluation import WearerEvaluation


def equations(at: WearerEvaluation) -> Iterator[DenseEquations]:
    """One factor for each sensor, on the headings of all."""
    settings = at.problem.settings.agreeing_headings
    if settings.sigma_deg is not None and at.problem.free_headings:
        sigma, headings = np.deg2rad(settings.sigma_deg), at.state.headings
        mean = np.arctan2(np.sin(headings).sum(), np.cos(headings).sum())
        share = np.cos(headings - mean)
        by_all = (np.eye(len(headings)) - share / share.sum()) / sigma
        block = JacobianBlock(at.owner, "headings", by_all[None, :, None])
        yield from prior_equations(block, wrap_angle(headings - mean)[:, None] / sigma, settings.loss)


AGREEING_HEADINGS = Term.prior("agreeing headings", equations)
