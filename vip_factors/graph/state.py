"""The variables of the whole graph as arrays, and as GTSAM values."""

from dataclasses import dataclass, replace

import gtsam
import numpy as np

from vip_factors.body.skeleton import JOINT_COUNT
from vip_factors.geometry.rotations import Array, exp, rotation_z
from vip_factors.graph.keys import heading_key, joint_key, mounting_key, pose_mean_key, root_key


@dataclass(frozen=True)
class GraphState:
    """Values of all variables of one wearer.

    Attributes:
        R_parent_child: ``(T, 24, 3, 3)`` joint rotations.
        p_world_pelvis: ``(T, 3)`` metres.
        headings: ``(S,)`` radians.
        R_bone_sensor: ``(S, 3, 3)`` mountings.
        pose_mean: ``(69,)`` the recording's mean joint vector, radians.
    """

    R_parent_child: Array
    p_world_pelvis: Array
    headings: Array
    R_bone_sensor: Array
    pose_mean: Array

    def retract(self, joints: Array, root: Array, static: Array) -> "GraphState":
        """Move by tangent steps, as GTSAM does: on the right.

        ``joints`` ``(T, 24, 3)``, ``root`` ``(T, 3)``, and ``static``: headings, then mountings, then the pose mean.
        """
        S = len(self.headings)
        headings, mountings, mean = np.split(static, [S, 4 * S])
        return GraphState(
            self.R_parent_child @ exp(joints),
            self.p_world_pelvis + root,
            self.headings + headings,
            self.R_bone_sensor @ exp(mountings.reshape(S, 3)),
            self.pose_mean + mean,
        )

    def turned(self, angle: float, shift: Array | None = None) -> "GraphState":
        """The same motion in a world turned about the vertical by an angle in radians, then shifted ``(3,)``."""
        turn, R = rotation_z(angle), self.R_parent_child.copy()
        R[:, 0] = turn @ R[:, 0]
        p = self.p_world_pelvis @ turn.T + (0.0 if shift is None else shift)
        return replace(self, R_parent_child=R, p_world_pelvis=p, headings=self.headings + angle)

    def to_values(self, wearer: int = 0) -> gtsam.Values:
        """As GTSAM values, under the keys of :mod:`vip_factors.graph.keys`."""
        values = gtsam.Values()
        for t, (R, p) in enumerate(zip(self.R_parent_child, self.p_world_pelvis, strict=True)):
            for joint in range(JOINT_COUNT):
                values.insert(joint_key(t, joint, wearer), gtsam.Rot3(R[joint]))
            values.insert(root_key(t, wearer), p)
        for s, (heading, R) in enumerate(zip(self.headings, self.R_bone_sensor, strict=True)):
            values.insert(heading_key(s, wearer), float(heading))
            values.insert(mounting_key(s, wearer), gtsam.Rot3(R))
        values.insert(pose_mean_key(wearer), self.pose_mean)
        return values

    @classmethod
    def from_values(cls, values: gtsam.Values, frames: int, sensors: int) -> "GraphState":
        """Read back what :meth:`to_values` wrote."""
        joints = range(JOINT_COUNT)
        return cls(
            np.array([[values.atRot3(joint_key(t, j)).matrix() for j in joints] for t in range(frames)]),
            np.array([values.atPoint3(root_key(t)) for t in range(frames)]),
            np.array([values.atDouble(heading_key(s)) for s in range(sensors)]),
            np.array([values.atRot3(mounting_key(s)).matrix() for s in range(sensors)]).reshape(-1, 3, 3),
            values.atVector(pose_mean_key()),
        )
