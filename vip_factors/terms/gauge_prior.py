"""Gauge prior: IMUs alone see neither where the scene is nor how fast it drifts; somebody has to say.

The residual is the root's position less the chosen one, metres; its derivative is the identity.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.terms.equations import DenseEquations, JacobianBlock, Term, prior_equations
from vip_factors.terms.evaluation import WearerEvaluation


def equations(at: WearerEvaluation, first: slice) -> Iterator[DenseEquations]:
    """One factor on the root of the first frame, of each stretch if there are several."""
    problem = at.problem
    if not (problem.use_acceleration and problem.is_gauge):
        return
    settings = problem.settings.gauge_prior
    block = JacobianBlock(at.owner, "root", np.eye(3)[None, None] / settings.position_sigma)
    for frame, p_world in problem.placed_starts:
        if first.start <= frame < first.stop:
            residual = (at.state.p_world_pelvis[frame] - p_world) / settings.position_sigma
            yield from prior_equations(block, residual[None], first=frame)


GAUGE_PRIOR = Term("gauge prior", 0, equations, every_frame=False)
