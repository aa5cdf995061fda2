"""The poses that wearers hold for calibration."""

import numpy as np

from vip_factors.body.skeleton import JOINT_COUNT, joint_index
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array, exp

# Body axes (x left, y up, z forward) in a Z-up world, facing its x axis: the pelvis of a person standing upright.
R_WORLD_FACING_X = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
POSES = ("t-pose", "n-pose")


def calibration_pose(pose: str) -> Array:
    """Joint rotations ``(24, 3, 3)`` of a nominal pose, upright and facing the world's x axis.

    ``"t-pose"``: rest. ``"n-pose"``: the arms hang straight down, palms towards the thighs.

    Raises:
        InputError: for another name.
    """
    if pose not in POSES:
        raise InputError(f"initial pose '{pose}': expected t-pose or n-pose")
    R = np.broadcast_to(np.eye(3), (JOINT_COUNT, 3, 3)).copy()
    R[0] = R_WORLD_FACING_X
    if pose == "n-pose":
        R[joint_index("left_shoulder")] = exp([0, 0, -np.pi / 2])
        R[joint_index("right_shoulder")] = exp([0, 0, np.pi / 2])
    return R
