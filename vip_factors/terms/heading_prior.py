"""Heading prior: what the rough placement and the initial pose said about one sensor's heading.

The residual is the heading less its prior, wrapped into [−π, π), radians; its derivative is one.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.geometry.rotations import Array, wrap_angle
from vip_factors.problem.wearer import WearerProblem
from vip_factors.terms.equations import DenseEquations, JacobianBlock, Term, prior_equations
from vip_factors.terms.evaluation import CameraEvaluation, WearerEvaluation
from vip_factors.terms.heading_walk import walk_sigma

GAUGE_SIGMA = float(np.deg2rad(0.1))  # of the reference sensor, whose heading defines the world's


def heading_sigmas(problem: WearerProblem) -> Array:
    """``(S,)`` radians, as used: tight for the gauge sensor, not too tight for the others.

    What the motion of a whole recording says of a heading that walks is its mean, against that of the gauge
    sensor: a walk's mean is off its start by a third of the variance that it gathers, and here two walk.
    """
    settings = problem.settings.heading_prior
    sigmas = np.maximum(problem.heading_sigma, np.deg2rad(settings.least_sigma_deg))
    if problem.headings_drift:
        whole = walk_sigma(problem, problem.heading_times[-1] - problem.heading_times[0])
        sigmas = np.hypot(sigmas, np.sqrt(2 / 3) * whole)
    if problem.is_gauge:
        sigmas[problem.gauge_sensor] = GAUGE_SIGMA
    return sigmas


def equations(at: WearerEvaluation) -> Iterator[DenseEquations]:
    """One factor for each sensor: on its first heading, where it drifts."""
    if at.problem.free_headings:
        sigmas = heading_sigmas(at.problem)
        residual = wrap_angle(at.state.headings - at.problem.prior_headings) / sigmas
        jacobian = (1 / sigmas)[None, :, None, None]
        block = JacobianBlock(at.owner, "headings", jacobian, each=True)
        yield from prior_equations(block, residual[:, None])


def camera_equations(at: CameraEvaluation) -> Iterator[DenseEquations]:
    """One factor on the heading of the camera's sensor."""
    if at.problem.imu is not None:
        sigma = np.deg2rad(at.problem.settings.heading_sigma_deg)
        residual = wrap_angle(at.state.heading - at.problem.prior_heading).reshape(1, 1) / sigma
        yield from prior_equations(JacobianBlock(at.owner, "heading", np.ones((1, 1, 1, 1)) / sigma), residual)


HEADING_PRIOR = Term.prior("heading prior", equations)
CAMERA_HEADING_PRIOR = Term.prior("camera heading prior", camera_equations)
