"""Video clock: priors on the offset and the drift of the video's clock relative to the sensors'.

The image at the sensors' time ``t`` was taken ``Δ(t) = o + d (t − m)`` seconds later, with the offset ``o`` at the
recording's middle ``m`` and the drift ``d``. A keypoint with velocity ``v`` px/s appears at ``z − v Δ(t)``, so a
reprojection's residual has the derivatives ``v`` and ``v (t − m)``. The priors' residuals are ``o``, s, and ``d``, s/s.
"""

from collections.abc import Iterator
from functools import partial

import numpy as np

from vip_factors.terms.equations import DenseEquations, JacobianBlock, Term, prior_equations
from vip_factors.terms.evaluation import CameraEvaluation


def equations(camera: CameraEvaluation, block: str, sigma: str) -> Iterator[DenseEquations]:
    """One factor on the offset of the video's clock, or on its drift; ``sigma`` is the name of its setting."""
    if camera.problem.free_clock:
        root = np.full((1, 1), 1 / getattr(camera.problem.settings.clock, sigma))
        yield from prior_equations(
            JacobianBlock(camera.owner, block, root[None, None]), root * getattr(camera.state, block)
        )


CLOCK_PRIOR = Term.prior("clock prior", partial(equations, block="clock", sigma="offset_sigma"))
CLOCK_DRIFT_PRIOR = Term.prior("clock drift prior", partial(equations, block="clock_drift", sigma="drift_sigma"))
