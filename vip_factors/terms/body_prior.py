"""Body prior: lengths of the body are likely for the subject's stature, sex, mass and measured lengths.

``r = L_b (s − s₀)``, whitened changes of lengths under a Gaussian over bodies; linear. The Gaussian is the subject's
(:class:`~vip_factors.body.lengths.BodyVariation`), ``factors.length_scale`` times as wide as its table's.
"""

from collections.abc import Iterator

from vip_factors.terms.equations import DenseEquations, JacobianBlock, Term, prior_equations
from vip_factors.terms.evaluation import WearerEvaluation


def equations(wearer: WearerEvaluation) -> Iterator[DenseEquations]:
    """One factor on all lengths."""
    variation = wearer.problem.variation
    if variation is not None and wearer.problem.body_moves:
        residual = variation.whitening @ (wearer.state.body - variation.mean)
        yield from prior_equations(JacobianBlock(wearer.owner, "body", variation.whitening[None, None]), residual[None])


BODY_PRIOR = Term.prior("body prior", equations)
