"""Heading walk: a filter without a magnetometer forgets its north, slowly and with no memory of where it was."""

from dataclasses import dataclass

import numpy as np

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
