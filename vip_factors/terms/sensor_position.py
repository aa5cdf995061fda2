"""Sensor position: position of a sensor on its bone minus the declared one.

``r = s − s₀`` in bone axes, metres; linear. A wrong lever arm would bias the mounting: both have the same effect on the
accelerations of a swinging limb.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.geometry.rotations import Array
from vip_factors.problem.wearer import WearerProblem
from vip_factors.terms.equations import DenseEquations, JacobianBlock, Term, prior_equations
from vip_factors.terms.evaluation import WearerEvaluation


def sensor_position_whitening(problem: WearerProblem) -> Array:
    """Whitening ``(S, 3, 3)`` per metre, with different standard deviations along and across limbs."""
    settings = problem.settings.sensor_place
    whitenings = []
    for bone in problem.sensor_points.bones:
        limb = problem.skeleton.limb(bone)
        if limb is None:
            whitenings.append(np.eye(3) / settings.elsewhere)
            continue
        length = float(np.linalg.norm(limb))
        along = np.outer(limb, limb) / length**2
        whitenings.append(along / (settings.along * length) + (np.eye(3) - along) / settings.across)
    return np.array(whitenings).reshape(-1, 3, 3)


def equations(wearer: WearerEvaluation) -> Iterator[DenseEquations]:
    """One factor for each sensor, in bone axes."""
    if wearer.problem.free_places:
        whitening = sensor_position_whitening(wearer.problem)
        residual = (whitening @ wearer.state.sensor_positions[..., None])[..., 0]
        yield from prior_equations(
            JacobianBlock(wearer.owner, "sensor_positions", whitening[None], is_per_factor=True), residual
        )


SENSOR_POSITION_PRIOR = Term.prior("sensor place prior", equations)
