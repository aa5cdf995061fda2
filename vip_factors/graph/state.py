"""The variables of the whole graph as arrays, and as GTSAM values."""

from dataclasses import dataclass, field, replace

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
        headings: ``(S,)`` radians; at the first knot, where they walk.
        R_bone_sensor: ``(S, 3, 3)`` mountings.
        pose_mean: ``(69,)`` the recording's mean joint vector, radians.
        later_headings: ``(K − 1, S)`` radians, at the further knots; none where headings are constant.
    """

    R_parent_child: Array
    p_world_pelvis: Array
    headings: Array
    R_bone_sensor: Array
    pose_mean: Array
    later_headings: Array = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def heading_knots(self) -> Array:
        """Headings at all knots ``(K, S)``."""
        return np.vstack([self.headings, self.later_headings.reshape(-1, len(self.headings))])

    def heading(self, sensor: int, weights: Array | None) -> float | Array:
        """A sensor's heading: at the frames whose knots' ``weights`` ``(t, K)`` are given, or the constant one."""
        return float(self.headings[sensor]) if weights is None else weights @ self.heading_knots[:, sensor]

    def with_knots(self, count: int) -> "GraphState":
        """The same headings, now at ``count`` knots: all as the first."""
        return replace(self, later_headings=np.tile(self.headings, (max(count - 1, 0), 1)))

    def retract(self, joints: Array, root: Array, static: Array, walk: Array | None = None) -> "GraphState":
        """Move by tangent steps, as GTSAM does: on the right.

        ``joints`` ``(T, 24, 3)``, ``root`` ``(T, 3)``, ``static``: headings, then mountings, then the pose mean;
        and ``walk`` ``(K − 1, S)``: the later headings.
        """
        S = len(self.headings)
        headings, mountings, mean = np.split(static, [S, 4 * S])
        return GraphState(
            self.R_parent_child @ exp(joints),
            self.p_world_pelvis + root,
            self.headings + headings,
            self.R_bone_sensor @ exp(mountings.reshape(S, 3)),
            self.pose_mean + mean,
            self.later_headings if walk is None else self.later_headings + walk,
        )

    def turned(self, angle: float, shift: Array | None = None) -> "GraphState":
        """The same motion in a world turned about the vertical by an angle in radians, then shifted ``(3,)``."""
        turn, R = rotation_z(angle), self.R_parent_child.copy()
        R[:, 0] = turn @ R[:, 0]
        p = self.p_world_pelvis @ turn.T + (0.0 if shift is None else shift)
        later = self.later_headings + angle
        return replace(self, R_parent_child=R, p_world_pelvis=p, headings=self.headings + angle, later_headings=later)

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
        for (k, s), heading in np.ndenumerate(self.later_headings):
            values.insert(heading_key(s, wearer, k + 1), float(heading))
        values.insert(pose_mean_key(wearer), self.pose_mean)
        return values

    @classmethod
    def from_values(cls, values: gtsam.Values, frames: int, sensors: int, knots: int = 1) -> "GraphState":
        """Read back what :meth:`to_values` wrote."""
        joints = range(JOINT_COUNT)
        return cls(
            np.array([[values.atRot3(joint_key(t, j)).matrix() for j in joints] for t in range(frames)]),
            np.array([values.atPoint3(root_key(t)) for t in range(frames)]),
            np.array([values.atDouble(heading_key(s)) for s in range(sensors)]),
            np.array([values.atRot3(mounting_key(s)).matrix() for s in range(sensors)]).reshape(-1, 3, 3),
            values.atVector(pose_mean_key()),
            np.array(
                [[values.atDouble(heading_key(s, 0, k)) for s in range(sensors)] for k in range(1, knots)]
            ).reshape(-1, sensors),
        )
