"""A camera's pose as factors see it: ``T_world_camera``, perturbed on the right, rotation first (GTSAM's ``Pose3``)."""

from dataclasses import dataclass

import numpy as np

from vip_factors.geometry.poses import retract_pose
from vip_factors.geometry.rotations import Array, hat


@dataclass(frozen=True)
class CameraPoses:
    """Poses at ``T`` frames: ``R_world_camera`` ``(T, 3, 3)`` and ``p_world_camera`` ``(T, 3)`` in metres.

    The tangent is ``(ω, v)``, rotation first, both in the camera's axes: ``T ← T Exp(ω, v)``, that is ``R ← R Exp(ω)``
    and ``p ← p + R J_l(ω) v``, which to first order is ``p + R v``.
    """

    R_world_camera: Array
    p_world_camera: Array

    def __len__(self) -> int:
        return len(self.p_world_camera)

    def point(self, p_camera_point: Array) -> Array:
        """World positions ``(T, 3)`` of a point fixed to the camera."""
        return self.p_world_camera + self.R_world_camera @ p_camera_point

    def point_jacobian(self, p_camera_point: Array) -> Array:
        """Derivative ``(T, 3, 6)`` of :meth:`point` by the tangent."""
        R = self.R_world_camera
        return np.concatenate([-R @ hat(p_camera_point), R], axis=2)

    def retract(self, steps: Array) -> "CameraPoses":
        """Moved by tangent steps ``(T, 6)``, as ``Pose3`` moves: the translation turns along."""
        return CameraPoses(*retract_pose(self.R_world_camera, self.p_world_camera, steps))
