"""Video clock: how far the video's clock is off the sensors', and how fast it drifts from them; a prior on both.

What the video shows at the sensors' time ``t`` was taken ``Δ(t) = o + d (t − m)`` seconds later, with the offset ``o``
at the recording's middle ``m`` and the drift ``d``. A keypoint that moves by ``v`` pixels a second would have been seen
at ``z − v Δ(t)``, so a reprojection's residual grows by ``v Δ(t)``: its derivatives are ``v`` and ``v (t − m)``. The
prior's residual is ``(o, d)``, in seconds and seconds a second.
"""

from collections.abc import Iterator
from functools import partial

import numpy as np

from vip_factors.terms.equations import DenseEquations, JacobianBlock, Term, prior_equations
from vip_factors.terms.evaluation import CameraEvaluation


def equations(at: CameraEvaluation, block: str, sigma: str) -> Iterator[DenseEquations]:
    """One factor on the offset of the video's clock, or on its drift; ``sigma`` names its setting."""
    if at.problem.free_clock:
        root = np.full((1, 1), 1 / getattr(at.problem.settings.clock, sigma))
        yield from prior_equations(JacobianBlock(at.owner, block, root[None, None]), root * getattr(at.state, block))


CLOCK_PRIOR = Term.prior("clock prior", partial(equations, block="clock", sigma="offset_sigma"))
CLOCK_DRIFT_PRIOR = Term.prior("clock drift prior", partial(equations, block="clock_drift", sigma="drift_sigma"))
