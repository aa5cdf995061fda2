"""Points fixed to bones."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vip_factors.body.kinematics import BodyState
from vip_factors.geometry.rotations import Array


@dataclass(frozen=True)
class BodyPoint:
    """A point fixed to a bone."""

    bone: int
    p_bone_point: Array

    def of(self, body: BodyState) -> Array:
        """World positions ``(T, 3)``."""
        return body.point(self.bone, self.p_bone_point)


@dataclass(frozen=True)
class BodyPoints:
    """Points on the body, as arrays: ``bones`` they are on, and ``p_bone_point`` ``(n, 3)`` metres."""

    bones: tuple[int, ...]
    p_bone_point: Array

    @classmethod
    def of(cls, points: Sequence[BodyPoint]) -> "BodyPoints":
        """The same points."""
        p = np.array([point.p_bone_point for point in points]).reshape(-1, 3)
        return cls(tuple(point.bone for point in points), p)

    def on(self, body: BodyState) -> Array:
        """World positions ``(T, n, 3)``."""
        return body.points(np.array(self.bones, dtype=int), self.p_bone_point)
