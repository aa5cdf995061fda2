"""Sensor position: where on its bone a sensor sits, against where it was said to.

``r = s − s₀`` in bone axes, metres; linear. A lever arm that is centimetres off errs in every frame alike: taken as
known it pulls the mounting, which has the same effect on the accelerations that a limb's swing causes.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.geometry.rotations import Array
from vip_factors.problem.wearer import WearerProblem
from vip_factors.terms.equations import DenseEquations, JacobianBlock, Term, prior_equations
from vip_factors.terms.evaluation import WearerEvaluation


def sensor_position_whitening(problem: WearerProblem) -> Array:
    """``(S, 3, 3)`` per metre: another sigma along limbs than across."""
    settings = problem.settings.sensor_place
    found = []
    for bone in problem.sensor_points.bones:
        limb = problem.skeleton.limb(bone)
        if limb is None:
            found.append(np.eye(3) / settings.elsewhere)
            continue
        length = float(np.linalg.norm(limb))
        along = np.outer(limb, limb) / length**2
        found.append(along / (settings.along * length) + (np.eye(3) - along) / settings.across)
    return np.array(found).reshape(-1, 3, 3)


def equations(at: WearerEvaluation) -> Iterator[DenseEquations]:
    """One factor for each sensor, in bone axes."""
    if at.problem.free_places:
        whitening = sensor_position_whitening(at.problem)
        residual = (whitening @ at.state.sensor_positions[..., None])[..., 0]
        yield from prior_equations(JacobianBlock(at.owner, "sensor_positions", whitening[None], each=True), residual)


SENSOR_POSITION_PRIOR = Term.prior("sensor place prior", equations)
