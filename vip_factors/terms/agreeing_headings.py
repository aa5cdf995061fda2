"""Agreeing headings: sensors of one suit that were started together have inertial frames that nearly coincide.

Nobody knows where their common north is, only that it is common. So each heading is held to the mean of all, and the
mean to nothing.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from vip_factors.geometry.rotations import Array, wrap_angle
from vip_factors.terms.equations import AT_THE_FIRST_KNOT, DenseEquations, JacobianBlock, Term, prior_equations
from vip_factors.terms.evaluation import WearerEvaluation
from vip_factors.terms.robust import Loss, RobustLoss


@dataclass(frozen=True)
class AgreeingHeadingsSettings:
    """How well the inertial frames of a wearer's sensors agree about the vertical."""

    # Degrees, standard deviation about their mean; none: nothing is known. Thirteen sensors of one make lay within −10°
    # to +4° of each other, one of them at −33°; sensors that each found a north of their own may lie anyhow.
    sigma_deg: float | None = None
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.CAUCHY, 2.0))  # one that was started elsewhere

    @property
    def sigma(self) -> float | None:
        """Standard deviation in radians."""
        return None if self.sigma_deg is None else float(np.deg2rad(self.sigma_deg))


def agreeing_headings_residual(headings: Array) -> Array:
    """Headings ``(S,)`` less their circular mean ``c = atan2(Σ sin γ, Σ cos γ)``, in [−π, π), radians."""
    return wrap_angle(headings - _mean(headings))


def agreeing_headings_jacobian(headings: Array) -> Array:
    """Derivative ``(S, S)``: ``∂(γ_i − c)/∂γ_j = δ_ij − cos(γ_j − c) / Σ_k cos(γ_k − c)``, that of the arctangent."""
    share = np.cos(headings - _mean(headings))
    return np.eye(len(headings)) - share / share.sum()


def _mean(headings: Array) -> float:
    return float(np.arctan2(np.sin(headings).sum(), np.cos(headings).sum()))


def equations(at: WearerEvaluation) -> Iterator[DenseEquations]:
    """One factor for each sensor, on the headings of all."""
    settings: AgreeingHeadingsSettings = at.problem.settings.agreeing_headings
    if settings.sigma is not None and at.problem.free_headings:
        residual = agreeing_headings_residual(at.state.headings) / settings.sigma
        by_all = (agreeing_headings_jacobian(at.state.headings) / settings.sigma)[None, :, None]
        block = JacobianBlock(at.owner, "headings", by_all, ahead=AT_THE_FIRST_KNOT)
        yield from prior_equations(block, residual[:, None], settings.loss)


AGREEING_HEADINGS = Term.prior("agreeing headings", equations)
