"""Heading walk: a filter without a magnetometer forgets its north, slowly and with no memory of where it was."""

from dataclasses import dataclass

import gtsam
import numpy as np

from vip_factors.factors.adapter import custom_factor
from vip_factors.geometry.rotations import Array


@dataclass(frozen=True)
class HeadingWalkSettings:
    """How fast headings drift, where they are let drift."""

    # Degrees per √minute: magnetometer-free filters of consumer sensors drift by 1–5. Too small a number holds a
    # drifting heading back, too large a one only makes it less sure.
    drift_deg: float = 2.0

    def sigma(self, seconds: Array) -> Array:
        """Standard deviations in radians of what is added to a heading in so many seconds."""
        return np.deg2rad(self.drift_deg) * np.sqrt(np.asarray(seconds) / 60)


def heading_walk_residual(before: Array, after: Array) -> Array:
    """How far a heading walked from one knot to the next, radians; any shape.

    Its derivatives are −1 and 1. Not wrapped: between its knots the heading is interpolated, so it is continuous.
    """
    return after - before


def heading_walk_factor(before_key: int, after_key: int, sigma: float) -> gtsam.CustomFactor:
    """The GTSAM factor between one sensor's headings at neighbouring knots; ``sigma`` in radians."""

    def evaluate(values: gtsam.Values) -> tuple[Array, list[Array]]:
        before, after = np.array([values.atDouble(before_key)]), np.array([values.atDouble(after_key)])
        return heading_walk_residual(before, after), [-np.eye(1), np.eye(1)]

    noise = gtsam.noiseModel.Isotropic.Sigma(1, sigma)
    return custom_factor("heading walk", noise, [before_key, after_key], [1, 1], evaluate)
