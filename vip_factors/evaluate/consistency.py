"""Is the reported covariance honest? Normalised estimation error squared (NEES), over its dimension.

1 is honest, below it the estimator is too modest, above it too sure of itself. Bar-Shalom, Li, Kirubarajan,
"Estimation with Applications to Tracking and Navigation", section 5.4.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from vip_factors.body.kinematics import Motion
from vip_factors.errors import InputError
from vip_factors.estimate import PoseCovariance
from vip_factors.evaluate.calibration import CalibrationError
from vip_factors.geometry.rotations import Array, log, transpose
from vip_factors.sensors.calibration import Calibration


@dataclass(frozen=True)
class Consistency:
    """NEES over dimension: its mean, and the share of errors inside their own 95 % ellipsoid (0.95 is honest)."""

    nees: float
    coverage_95: float


def nees(error: Array, covariance: Array) -> Array:
    """``eᵀ P⁻¹ e / d`` of errors ``(..., d)`` under ``(..., d, d)``; NaN where the covariance is not positive."""
    shape, d = error.shape[:-1], error.shape[-1]
    e, P = error.reshape(-1, d), covariance.reshape(-1, d, d)
    result = np.full(len(e), np.nan)
    usable = np.all(np.isfinite(P), axis=(1, 2)) & np.all(np.isfinite(e), axis=1)
    usable[usable] = np.linalg.eigvalsh(P[usable])[:, 0] > 0
    solved = np.linalg.solve(P[usable], e[usable][..., None])[..., 0]
    result[usable] = np.sum(e[usable] * solved, axis=-1) / d
    return result.reshape(shape)


def joint_nees(estimate: Motion, truth: Motion, covariance: PoseCovariance) -> Array:
    """NEES of every joint rotation, ``(T, 24)``: ``R_true = R_estimated Exp(e)``, ``e ~ N(0, P)``."""
    if len(covariance.joints) != len(estimate):
        raise InputError(
            f"covariance of {len(covariance.joints)} frames for a motion of {len(estimate)}: expected one each"
        )
    return nees(log(transpose(estimate.R_parent_child) @ truth.R_parent_child), covariance.joints)


def summarise(values: Array, dimension: int) -> Consistency:
    """Mean and 95 % coverage of NEES values, those that are NaN left out."""
    finite = values[np.isfinite(values)]
    if len(finite) == 0:
        return Consistency(float("nan"), float("nan"))
    inside = finite * dimension <= chdtri(dimension, 0.05)
    return Consistency(float(finite.mean()), float(inside.mean()))


def heading_nees(error: CalibrationError, estimate: Calibration) -> Array:
    """NEES of every sensor's heading, after the gauge."""
    sigma = np.array([estimate[name].heading_sigma for name in error.heading])
    return nees(np.array(list(error.heading.values()))[:, None], (sigma**2)[:, None, None])


def mounting_nees(error: CalibrationError, estimate: Calibration) -> Array:
    """NEES of every sensor's mounting, its three axes taken as independent."""
    sigma = np.stack([np.broadcast_to(estimate[name].mounting_sigma, 3) for name in error.mounting])
    return nees(np.stack(list(error.mounting.values())), (sigma**2)[..., None] * np.eye(3))


def camera_nees(tangent: Array, covariance: Array) -> Array:
    """NEES of camera poses ``(T,)``: right perturbations ``(T, 6)`` (rad, m) under ``(T, 6, 6)``."""
    return nees(tangent, covariance)
