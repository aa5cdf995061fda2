"""The heading and mounting of every sensor: estimated, or known to a simulator."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from vip_factors.geometry.rotations import Array


@dataclass(frozen=True)
class SensorCalibration:
    """How one sensor relates to the world and to its bone.

    Attributes:
        heading: γ in radians, ``R_world_inertial = rotation_z(γ)``; at the start, if it changes.
        R_bone_sensor: ``(3, 3)`` mounting.
        heading_sigma: standard deviation in radians, NaN if not estimated.
        mounting_sigma: ``(3,)`` standard deviations in radians about the sensor's axes, NaN if not estimated.
        heading_time, heading_path: ``(n,)`` seconds, and ``(n,)`` radians (not wrapped) of a heading that changes with
            time, linear in between; empty where it is constant.
        bone: name of the bone that it is on; empty where that is not known, or where it is on a camera.
    """

    heading: float
    R_bone_sensor: Array
    heading_sigma: float = float("nan")
    mounting_sigma: Array = field(default_factory=lambda: np.full(3, np.nan))
    heading_time: Array = field(default_factory=lambda: np.zeros(0))
    heading_path: Array = field(default_factory=lambda: np.zeros(0))
    bone: str = ""

    def heading_at(self, time: Array) -> Array:
        """Headings in radians at instants in seconds; beyond its ends the path stays as it is there."""
        if len(self.heading_path) == 0:
            return np.full(np.shape(time), self.heading)
        return np.interp(time, self.heading_time, self.heading_path)


Calibration = Mapping[str, SensorCalibration]
"""Calibrations by sensor name."""
