"""Forward kinematics of all frames at once, and the Jacobian of any point on any bone.

Rotations are perturbed on the right, ``R_parent_child ← R_parent_child Exp(δ)``, as the graph's variables are.
"""

from dataclasses import dataclass

import numpy as np

from vip_factors.body.skeleton import JOINT_COUNT, PARENTS, Skeleton, ancestors
from vip_factors.geometry.rotations import Array, hat, transpose


@dataclass(frozen=True)
class BodyState:
    """World poses of all bones in ``T`` frames.

    Attributes:
        R_world_bone: ``(T, 24, 3, 3)``.
        p_world_joint: ``(T, 24, 3)`` metres.
    """

    R_world_bone: Array
    p_world_joint: Array

    def point(self, bone: int, p_bone_point: Array) -> Array:
        """World positions ``(T, 3)`` of a point fixed to a bone (``p_bone_point`` in metres, bone axes)."""
        return self.p_world_joint[:, bone] + self.R_world_bone[:, bone] @ p_bone_point

    def orientation_jacobian(self, bone: int) -> tuple[tuple[int, ...], Array]:
        """How a bone turns, in the world, when the joints of its chain are perturbed.

        Returns:
            The chain of joints, root first, and ``(T, len(chain), 3, 3)`` with ``R_world_bone ←
            Exp(J δ) R_world_bone``: simply each joint's own world rotation (thesis eq. 3.23).
        """
        chain = ancestors(bone)
        return chain, self.R_world_bone[:, chain]

    def point_jacobian(self, bone: int, p_bone_point: Array) -> tuple[tuple[int, ...], Array]:
        """Derivative of :meth:`point` by the joint perturbations of its chain (thesis eq. 3.25).

        Returns:
            The chain of joints, root first, and ``(T, len(chain), 3, 3)`` in metres per radian. The derivative by
            the root translation is the identity.
        """
        chain = ancestors(bone)
        arm = self.point(bone, p_bone_point)[:, None] - self.p_world_joint[:, chain]
        return chain, -hat(arm) @ self.R_world_bone[:, chain]


def forward_kinematics(skeleton: Skeleton, R_parent_child: Array, p_world_pelvis: Array) -> BodyState:
    """World poses of all bones.

    Args:
        skeleton: whose bones.
        R_parent_child: ``(T, 24, 3, 3)`` joint rotations; joint 0 is ``R_world_pelvis``.
        p_world_pelvis: ``(T, 3)`` metres.
    """
    R_world_bone = np.empty_like(R_parent_child)
    p_world_joint = np.empty(R_parent_child.shape[:-1])
    R_world_bone[:, 0] = R_parent_child[:, 0]
    p_world_joint[:, 0] = p_world_pelvis
    for joint in range(1, JOINT_COUNT):
        parent = PARENTS[joint]
        np.matmul(R_world_bone[:, parent], R_parent_child[:, joint], out=R_world_bone[:, joint])
        p_world_joint[:, joint] = p_world_joint[:, parent] + R_world_bone[:, parent] @ skeleton.p_parent_joint[joint]
    return BodyState(R_world_bone, p_world_joint)


def local_rotations(R_world_bone: Array) -> Array:
    """Joint rotations ``(T, 24, 3, 3)`` of world bone rotations ``(T, 24, 3, 3)``; joint 0 stays in the world."""
    R_parent_child = R_world_bone.copy()
    parents = np.array(PARENTS[1:])
    R_parent_child[:, 1:] = transpose(R_world_bone[:, parents]) @ R_world_bone[:, 1:]
    return R_parent_child
