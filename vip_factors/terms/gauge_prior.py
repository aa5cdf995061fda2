"""Gauge prior: IMUs do not determine the position of the scene; the start is fixed by convention.

The residual is the root's position minus the chosen one, metres; its derivative is the identity.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.terms.equations import DenseEquations, JacobianBlock, Term, prior_equations
from vip_factors.terms.evaluation import WearerEvaluation


def equations(wearer: WearerEvaluation, stretch: slice) -> Iterator[DenseEquations]:
    """One factor on the root in the first frame of each uninterrupted part of the recording."""
    problem = wearer.problem
    if not (problem.use_acceleration and problem.is_gauge):
        return
    settings = problem.settings.gauge_prior
    block = JacobianBlock(wearer.owner, "root", np.eye(3)[None, None] / settings.position_sigma)
    for frame, p_world in problem.placed_starts:
        if stretch.start <= frame < stretch.stop:
            residual = (wearer.state.p_world_pelvis[frame] - p_world) / settings.position_sigma
            yield from prior_equations(block, residual[None], first_frame=frame)


GAUGE_PRIOR = Term("gauge prior", 0, equations, every_frame=False)
