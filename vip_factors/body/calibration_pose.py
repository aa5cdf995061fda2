"""The poses that wearers hold for calibration."""

from dataclasses import dataclass

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


NOMINAL_SIGMA_DEG = 6.0  # a pose held by eye turns bones by 10–15°, through several joints
# How people who were asked for a pose hold it: degrees about x, y, z of each joint of the left side and the middle,
# mean and standard deviation; the right side is the mirror image. Arms in a T-pose hang 5–25° low, are turned by
# 20–45° about themselves (the rest pose of the CMU database by 30°) and bent by about 20°; about a limb's own axis a
# pose says next to nothing. Legs and trunk are 3–8° off, heads 16°, feet 7–15°; upright knees are bent by 3–7°.
_TRUNK = {"spine1": 5.0, "spine2": 4.0, "spine3": 4.0, "neck": 8.0, "head": 10.0}
_LEFT_SIGMAS = {
    "left_hip": (7.0, 10.0, 6.0), "left_knee": (7.0, 8.0, 4.0), "left_ankle": (8.0, 10.0, 8.0),
    "left_foot": (8.0, 8.0, 8.0), "left_collar": (8.0, 8.0, 8.0), "left_shoulder": (25.0, 15.0, 12.0),
    "left_elbow": (20.0, 12.0, 10.0), "left_wrist": (20.0, 12.0, 12.0), "left_hand": (10.0, 10.0, 10.0),
}  # fmt: skip
_LEFT_MEANS = {
    "t-pose": {"left_shoulder": (-30.0, 0.0, -10.0), "left_elbow": (0.0, -20.0, 0.0), "left_knee": (3.0, 0.0, 0.0)},
    "n-pose": {"left_shoulder": (-10.0, 0.0, 10.0), "left_elbow": (0.0, -20.0, 0.0), "left_knee": (3.0, 0.0, 0.0)},
}


@dataclass(frozen=True)
class HeldPose:
    """A calibration pose as people hold it: ``(24, 3, 3)`` rotations, of which the root's heading is free, and standard
    deviations ``(24, 3)`` in radians about each joint's own axes; the root's row has no meaning.
    """

    R_parent_child: Array
    sigma: Array


def nominal_pose(pose: str) -> HeldPose:
    """One of the poses to the letter, as the papers take it: every joint held as well as another, by eye.

    Raises:
        InputError: for another name.
    """
    return HeldPose(calibration_pose(pose), np.full((JOINT_COUNT, 3), np.radians(NOMINAL_SIGMA_DEG)))


def held_pose(pose: str) -> HeldPose:
    """One of the poses, upright and facing the world's x axis.

    Raises:
        InputError: for another name.
    """
    R, sigma = calibration_pose(pose), np.ones((JOINT_COUNT, 3))
    for name, spread in _TRUNK.items():
        sigma[joint_index(name)] = np.radians(spread)
    for left, spreads in _LEFT_SIGMAS.items():
        mean = np.radians(_LEFT_MEANS[pose].get(left, (0.0, 0.0, 0.0)))
        for joint, mirror in ((left, np.ones(3)), (left.replace("left", "right"), np.array([1.0, -1.0, -1.0]))):
            sigma[joint_index(joint)] = np.radians(spreads)
            R[joint_index(joint)] = R[joint_index(joint)] @ exp(mirror * mean)
    return HeldPose(R, sigma)
