"""A camera's pose as factors see it: ``T_world_camera``, perturbed on the right, rotation first (GTSAM's ``Pose3``)."""

from dataclasses import dataclass

import gtsam
import numpy as np

from vip_factors.geometry.rotations import Array, exp, hat, right_jacobian


@dataclass(frozen=True)
class CameraPoses:
    """Poses at ``T`` frames: ``R_world_camera`` ``(T, 3, 3)`` and ``p_world_camera`` ``(T, 3)`` in metres.

    The tangent is ``(rotation, translation)``, both in the camera's axes: ``R ← R Exp(ω)``, ``p ← p + R v``.
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
        R = self.R_world_camera
        turned = right_jacobian(-steps[:, :3]) @ steps[:, 3:, None]
        return CameraPoses(R @ exp(steps[:, :3]), self.p_world_camera + (R @ turned)[..., 0])

    @classmethod
    def of(cls, values: gtsam.Values, key: int) -> "CameraPoses":
        """One pose out of GTSAM values."""
        pose = values.atPose3(key)
        return cls(pose.rotation().matrix()[None], pose.translation()[None])
