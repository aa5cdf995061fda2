"""The heading and mounting of every sensor: estimated, or known to a simulator."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from vip_factors.geometry.rotations import Array


@dataclass(frozen=True)
class SensorCalibration:
    """How one sensor relates to the world and to its bone.

    Attributes:
        heading: γ in radians, ``R_world_inertial = rotation_z(γ)``.
        R_bone_sensor: ``(3, 3)`` mounting.
        heading_sigma: standard deviation in radians, NaN if not estimated.
        mounting_sigma: ``(3,)`` standard deviations in radians about the sensor's axes, NaN if not estimated.
    """

    heading: float
    R_bone_sensor: Array
    heading_sigma: float = float("nan")
    mounting_sigma: Array = field(default_factory=lambda: np.full(3, np.nan))


Calibration = Mapping[str, SensorCalibration]
"""Calibrations by sensor name."""
