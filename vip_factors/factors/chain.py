"""Reading a kinematic chain out of GTSAM values: what every factor on a bone needs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import gtsam
import numpy as np

from vip_factors.body.kinematics import BodyState, forward_kinematics
from vip_factors.body.skeleton import JOINT_COUNT, Skeleton, ancestors
from vip_factors.geometry.rotations import Array


@dataclass(frozen=True)
class FrameKeys:
    """The GTSAM keys of one person in one frame."""

    joints: Mapping[int, int]
    root: int

    def chain(self, bone: int) -> list[int]:
        """Keys of the joints from the root to a bone."""
        return [self.joints[joint] for joint in ancestors(bone)]


def chain_state(skeleton: Skeleton, values: gtsam.Values, keys: FrameKeys, bone: int, with_root: bool) -> BodyState:
    """World poses of the bones along one chain, of one frame (other bones are left at rest)."""
    R = np.tile(np.eye(3), (1, JOINT_COUNT, 1, 1))
    for joint in ancestors(bone):
        R[0, joint] = values.atRot3(keys.joints[joint]).matrix()
    root = values.atPoint3(keys.root) if with_root else np.zeros(3)
    return forward_kinematics(skeleton, R, root[None])


def split_blocks(jacobian: Array) -> Sequence[Array]:
    """The blocks ``(m, 3)`` of a chain Jacobian of one frame ``(1, c, m, 3)``."""
    return list(jacobian[0])
