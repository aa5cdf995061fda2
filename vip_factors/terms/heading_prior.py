"""Heading prior: what the rough placement and the initial pose said about one sensor's heading."""

from dataclasses import dataclass

import numpy as np

from vip_factors.geometry.rotations import Array, wrap_angle


@dataclass(frozen=True)
class HeadingPriorSettings:
    """How far the initial headings may be off."""

    least_sigma_deg: float = 12.0  # of the initial headings, however sure they claim to be
    gauge_sigma_deg: float = 0.1  # of the reference sensor, whose heading defines the world's

    @property
    def least_sigma(self) -> float:
        """Least standard deviation in radians."""
        return float(np.deg2rad(self.least_sigma_deg))

    @property
    def gauge_sigma(self) -> float:
        """Standard deviation in radians of the reference sensor's heading."""
        return float(np.deg2rad(self.gauge_sigma_deg))


def heading_prior_residual(heading: Array, prior_heading: Array) -> Array:
    """Heading less its prior, wrapped into [−π, π), radians; any shape. Its derivative is one."""
    return wrap_angle(heading - prior_heading)
