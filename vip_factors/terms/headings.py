"""Headings of sensors: their priors, their agreement within a suit, and their drift."""

from collections.abc import Iterator

import numpy as np

from vip_factors.factor_settings import SQUARE
from vip_factors.geometry.rotations import Array, wrap_angle
from vip_factors.problem.wearer import WearerProblem
from vip_factors.terms.equations import (
    DenseEquations,
    JacobianBlock,
    Term,
    WalkEquations,
    prior_equations,
    scalar_prior,
)
from vip_factors.terms.evaluation import CameraEvaluation, WearerEvaluation

GAUGE_SIGMA = float(np.deg2rad(0.1))  # of the reference sensor, whose heading defines the world frame


def walk_sigma(problem: WearerProblem, seconds: Array) -> Array:
    """Standard deviation of each sensor's heading change over some seconds, radians, ``(..., S)``."""
    settings = problem.settings.heading_walk
    unknown = np.full(len(problem.sensors), settings.unknown_drift_deg)
    drift = problem.heading_drift_deg if len(problem.heading_drift_deg) else unknown
    return np.deg2rad(drift) * np.sqrt(np.asarray(seconds) / 60)


def step_sigmas(problem: WearerProblem) -> Array:
    """Standard deviations ``(K − 1, S)`` of the headings' steps, radians."""
    sigmas = walk_sigma(problem, np.diff(problem.heading_times)[:, None])
    sigmas[problem.restart_steps] = np.pi  # any heading
    return sigmas


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


def prior_factors(wearer: WearerEvaluation) -> Iterator[DenseEquations]:
    """Heading prior: one factor for each sensor, on its first heading if it drifts.

    The residual is the heading minus that of the rough placement and the initial pose, wrapped into [−π, π), radians;
    its derivative is one.
    """
    if wearer.problem.free_headings:
        sigmas = heading_sigmas(wearer.problem)
        residual = wrap_angle(wearer.state.headings - wearer.problem.prior_headings) / sigmas
        jacobian = (1 / sigmas)[None, :, None, None]
        block = JacobianBlock(wearer.owner, "headings", jacobian, is_per_factor=True)
        yield from prior_equations(block, residual[:, None])


def camera_prior_factors(camera: CameraEvaluation) -> Iterator[DenseEquations]:
    """Heading prior of the sensor on a camera."""
    if camera.problem.imu is not None:
        sigma = float(np.deg2rad(camera.problem.settings.heading_sigma_deg))
        offset = float(wrap_angle(camera.state.heading - camera.problem.prior_heading))
        yield from scalar_prior(camera.owner, "heading", offset, sigma)


def agreement_factors(wearer: WearerEvaluation) -> Iterator[DenseEquations]:
    """Agreeing headings: one factor for each sensor of a suit, on the headings of all.

    Sensors that start together have inertial frames that nearly coincide; their common north is unknown. The residual
    of each heading γ is its difference from the circular mean of all, ``c = atan2(Σ sin γ, Σ cos γ)``: ``r_i = γ_i −
    c`` in [−π, π), with ``∂r_i/∂γ_j = δ_ij − cos(γ_j − c) / Σ_k cos(γ_k − c)``. The mean itself is free.
    """
    settings = wearer.problem.settings.agreeing_headings
    if settings.sigma_deg is not None and wearer.problem.free_headings:
        sigma, headings = np.deg2rad(settings.sigma_deg), wearer.state.headings
        mean = np.arctan2(np.sin(headings).sum(), np.cos(headings).sum())
        share = np.cos(headings - mean)
        by_all = (np.eye(len(headings)) - share / share.sum()) / sigma
        block = JacobianBlock(wearer.owner, "headings", by_all[None, :, None])
        yield from prior_equations(block, wrap_angle(headings - mean)[:, None] / sigma, settings.loss)


def walk_factors(wearer: WearerEvaluation) -> Iterator[WalkEquations]:
    """Heading walk: one factor for each sensor and step of its heading.

    The heading of a filter without a magnetometer drifts as a random walk, which has a step every few seconds, with the
    variance of that time. The residual is the step, radians; its derivatives are −1 and 1.
    """
    if wearer.problem.free_headings and wearer.problem.headings_drift:
        root = 1 / step_sigmas(wearer.problem)
        residual = root * np.diff(wearer.state.heading_path, axis=0)
        yield WalkEquations(0, residual[..., None], 1.0, SQUARE, wearer.owner, "headings", root)


HEADING_PRIOR = Term.prior("heading prior", prior_factors)
CAMERA_HEADING_PRIOR = Term.prior("camera heading prior", camera_prior_factors)
AGREEING_HEADINGS = Term.prior("agreeing headings", agreement_factors)
HEADING_WALK = Term.prior("heading walk", walk_factors)
