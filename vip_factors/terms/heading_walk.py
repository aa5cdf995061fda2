"""Heading walk: the heading of a filter without a magnetometer drifts as a random walk.

The walk has a step every few seconds, with the variance of that time. The residual is the step, radians; its
derivatives are −1 and 1.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.factor_settings import SQUARE
from vip_factors.geometry.rotations import Array
from vip_factors.problem.wearer import WearerProblem
from vip_factors.terms.equations import Term, WalkEquations
from vip_factors.terms.evaluation import WearerEvaluation


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


def equations(wearer: WearerEvaluation) -> Iterator[WalkEquations]:
    """One factor for each sensor and step."""
    if wearer.problem.free_headings and wearer.problem.headings_drift:
        root = 1 / step_sigmas(wearer.problem)
        residual = root * np.diff(wearer.state.heading_path, axis=0)
        yield WalkEquations(0, residual[..., None], 1.0, SQUARE, wearer.owner, "headings", root)


HEADING_WALK = Term.prior("heading walk", equations)
