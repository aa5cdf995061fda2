"""GTSAM keys of the variables, by the letters of the design: r, t per frame; h, b per sensor."""

import gtsam

from vip_factors.body.skeleton import JOINT_COUNT
from vip_factors.factors.chain import FrameKeys

# A symbol's index packs frame and joint; 32 joints to a frame leave room for 2⁵¹ frames.
JOINT_SLOTS = 32


def joint_key(frame: int, joint: int) -> int:
    """Key of the ``Rot3`` R_parent_child; joint 0 is R_world_pelvis."""
    return gtsam.symbol("r", frame * JOINT_SLOTS + joint)


def root_key(frame: int) -> int:
    """Key of the ``Point3`` p_world_pelvis."""
    return gtsam.symbol("t", frame)


def heading_key(sensor: int) -> int:
    """Key of the double γ, with R_world_inertial = Rz(γ)."""
    return gtsam.symbol("h", sensor)


def mounting_key(sensor: int) -> int:
    """Key of the ``Rot3`` R_bone_sensor."""
    return gtsam.symbol("b", sensor)


def pose_mean_key() -> int:
    """Key of the ``Vector`` of 69: the recording's mean joint vector."""
    return gtsam.symbol("m", 0)


def frame_keys(frame: int) -> FrameKeys:
    """All keys of one frame."""
    return FrameKeys({joint: joint_key(frame, joint) for joint in range(JOINT_COUNT)}, root_key(frame))
