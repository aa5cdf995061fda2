"""GTSAM keys of the variables, by the letters of the design: r, t, c per frame; h, b per sensor (h per knot).

Those of the second and further wearers carry the wearer's number above bit 44.
"""

import gtsam

from vip_factors.body.skeleton import JOINT_COUNT
from vip_factors.factors.chain import FrameKeys

# A symbol's index packs frame and joint; 32 joints to a frame leave room for 2⁵¹ frames.
JOINT_SLOTS = 32
WEARER = 1 << 44
KNOT = 1 << 8  # sensors to a wearer; leaves room for a knot a frame


def joint_key(frame: int, joint: int, wearer: int = 0) -> int:
    """Key of the ``Rot3`` R_parent_child; joint 0 is R_world_pelvis."""
    return gtsam.symbol("r", wearer * WEARER + frame * JOINT_SLOTS + joint)


def root_key(frame: int, wearer: int = 0) -> int:
    """Key of the ``Point3`` p_world_pelvis."""
    return gtsam.symbol("t", wearer * WEARER + frame)


def heading_key(sensor: int, wearer: int = 0, knot: int = 0) -> int:
    """Key of the double γ, with R_world_inertial = Rz(γ), at a knot of its walk; a constant heading has the first."""
    return gtsam.symbol("h", wearer * WEARER + knot * KNOT + sensor)


def mounting_key(sensor: int, wearer: int = 0) -> int:
    """Key of the ``Rot3`` R_bone_sensor."""
    return gtsam.symbol("b", wearer * WEARER + sensor)


def pose_mean_key(wearer: int = 0) -> int:
    """Key of the ``Vector`` of 69: the recording's mean joint vector."""
    return gtsam.symbol("m", wearer * WEARER)


def frame_keys(frame: int, wearer: int = 0) -> FrameKeys:
    """All keys of one frame."""
    return FrameKeys({joint: joint_key(frame, joint, wearer) for joint in range(JOINT_COUNT)}, root_key(frame, wearer))


def camera_key(frame: int) -> int:
    """Key of the ``Pose3`` T_world_camera; a camera that stands still has the one of frame 0."""
    return gtsam.symbol("c", frame)


def camera_heading_key() -> int:
    """Key of the double γ of the IMU on the camera."""
    return gtsam.symbol("g", 0)


def camera_mounting_key() -> int:
    """Key of the ``Rot3`` R_camera_imu."""
    return gtsam.symbol("q", 0)


def clock_key() -> int:
    """Key of the double: seconds by which the video's clock must still be put forward."""
    return gtsam.symbol("o", 0)
