"""Heading walk: a filter without a magnetometer forgets its north, slowly and with no memory of where it was.

The residual is by how much a heading steps, radians; its derivatives are −1 and 1. The random walk goes in steps some
seconds apart, each of the variance that gathers in these.
"""

from collections.abc import Iterator

import numpy as np

from vip_factors.factor_settings import SQUARE
from vip_factors.geometry.rotations import Array
from vip_factors.problem.wearer import WearerProblem
from vip_factors.terms.equations import Term, WalkEquations
from vip_factors.terms.evaluation import WearerEvaluation


def walk_sigma(problem: WearerProblem, seconds: Array) -> Array:
    """Radians by which each sensor's heading walks in so many seconds, ``(..., S)``."""
    settings = problem.settings.heading_walk
    unknown = np.full(len(problem.sensors), settings.unknown_drift_deg)
    drift = problem.heading_drift_deg if len(problem.heading_drift_deg) else unknown
    return np.deg2rad(drift) * np.sqrt(np.asarray(seconds) / 60)


def step_sigmas(problem: WearerProblem) -> Array:
    """``(K − 1, S)`` radians by which headings may change at each step."""
    sigmas = walk_sigma(problem, np.diff(problem.heading_times)[:, None])
    sigmas[problem.restart_steps] = np.pi  # any heading
    return sigmas


def equations(at: WearerEvaluation) -> Iterator[WalkEquations]:
    """One factor for each sensor, of each step."""
    if at.problem.free_headings and at.problem.headings_drift:
        root = 1 / step_sigmas(at.problem)
        residual = root * np.diff(at.state.heading_path, axis=0)
        yield WalkEquations(0, residual[..., None], 1.0, SQUARE, at.owner, "headings", root)


HEADING_WALK = Term.prior("heading walk", equations)
