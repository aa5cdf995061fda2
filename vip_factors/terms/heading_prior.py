"""Heading prior: a sensor's heading from the rough placement and the initial pose.

The residual is the heading minus its prior, wrapped into [−π, π), radians; its derivative is one.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.geometry.rotations import Array, wrap_angle
from vip_factors.problem.wearer import WearerProblem
from vip_factors.terms.equations import DenseEquations, JacobianBlock, Term, prior_equations
from vip_factors.terms.evaluation import CameraEvaluation, WearerEvaluation
from vip_factors.terms.heading_walk import walk_sigma

GAUGE_SIGMA = float(np.deg2rad(0.1))  # of the reference sensor, whose heading defines the world frame


def heading_sigmas(problem: WearerProblem) -> Array:
    """Standard deviations ``(S,)`` of the prior, radians: small for the gauge sensor, bounded below for others.

    The prior of a drifting heading stems from its mean over the recording, relative to the gauge sensor's. The mean of
    a random walk differs from its start by a third of the walk's final variance; here two headings walk.
    """
    settings = problem.settings.heading_prior
    sigmas = np.maximum(problem.heading_sigma, np.deg2rad(settings.least_sigma_deg))
    if problem.headings_drift:
        total = walk_sigma(problem, problem.heading_times[-1] - problem.heading_times[0])
        sigmas = np.hypot(sigmas, np.sqrt(2 / 3) * total)
    if problem.is_gauge:
        sigmas[problem.gauge_sensor] = GAUGE_SIGMA
    return sigmas


def equations(wearer: WearerEvaluation) -> Iterator[DenseEquations]:
    """One factor for each sensor, on its first heading if it drifts."""
    if wearer.problem.free_headings:
        sigmas = heading_sigmas(wearer.problem)
        residual = wrap_angle(wearer.state.headings - wearer.problem.prior_headings) / sigmas
        jacobian = (1 / sigmas)[None, :, None, None]
        block = JacobianBlock(wearer.owner, "headings", jacobian, is_per_factor=True)
        yield from prior_equations(block, residual[:, None])


def camera_equations(camera: CameraEvaluation) -> Iterator[DenseEquations]:
    """One factor on the heading of the camera's sensor."""
    if camera.problem.imu is not None:
        sigma = np.deg2rad(camera.problem.settings.heading_sigma_deg)
        residual = wrap_angle(camera.state.heading - camera.problem.prior_heading).reshape(1, 1) / sigma
        yield from prior_equations(JacobianBlock(camera.owner, "heading", np.ones((1, 1, 1, 1)) / sigma), residual)


HEADING_PRIOR = Term.prior("heading prior", equations)
CAMERA_HEADING_PRIOR = Term.prior("camera heading prior", camera_equations)
