"""GTSAM keys of the variables.

| letter | type | index | variable |
|---|---|---|---|
| ``r`` | ``Rot3`` | frame, joint | R_parent_child; of joint 0 R_world_pelvis |
| ``t`` | ``Point3`` | frame | p_world_pelvis |
| ``h`` | ``double`` | step, sensor | heading γ, R_world_inertial = Rz(γ); only step 0 if constant |
| ``b`` | ``Rot3`` | sensor | mounting R_bone_sensor |
| ``p`` | ``Point3`` | sensor | sensor position minus the declared one, bone axes |
| ``m`` | ``Vector`` of 69 | | the recording's mean joint vector |
| ``s`` | ``Vector`` of 12 | | changes of the body's lengths, metres |
| ``e`` | ``Vector`` of 14 | | axes of elbows and knees: tilts and offsets, radians |
| ``f`` | ``double`` | | logarithm of the thickness of the soles over its prior mean |
| ``k`` | ``Point3`` | keypoint | offset of the detector's keypoint from the skeleton's, bone axes |
| ``c`` | ``Pose3`` | frame | T_world_camera; only frame 0 for a static camera |
| ``g``, ``q`` | ``double``, ``Rot3`` | | heading of the camera's sensor, and R_camera_imu |
| ``o`` | ``double`` | | offset of the video's clock in the recording's middle, s |
| ``d`` | ``double`` | | drift of the video's clock, s/s |
| ``z`` | ``double`` | | logarithm of the focal length over its nominal value |

Keys of the second and further wearers or cameras contain their owner's number above bit 44.
"""

import gtsam

from vip_factors.problem.variables import ROWS

# A symbol's index packs frame and joint; 32 joints a frame leave room for 2³⁹ frames of a wearer.
JOINT_SLOTS = 32
WEARER = 1 << 44
STEP = 1 << 8  # sensors of a wearer; leaves room for a step in each frame


def joint_key(frame: int, joint: int, wearer: int = 0) -> int:
    """Key of the ``Rot3`` R_parent_child; joint 0 is R_world_pelvis."""
    return int(gtsam.symbol("r", wearer * WEARER + frame * JOINT_SLOTS + joint))


def root_key(frame: int, wearer: int = 0) -> int:
    """Key of the ``Point3`` p_world_pelvis."""
    return int(gtsam.symbol("t", wearer * WEARER + frame))


def camera_key(frame: int, camera: int = 0) -> int:
    """Key of the ``Pose3`` T_world_camera; a static camera has that of frame 0."""
    return int(gtsam.symbol("c", camera * WEARER + frame))


def variable_key(block: str, item: int = 0, wearer: int = 0, step: int = 0) -> int:
    """Key of a static variable.

    Args:
        block: row of :data:`~vip_factors.problem.variables.ROWS` (``headings``, ``R_bone_sensor``, ``body`` …).
        item: number of the sensor or keypoint.
        wearer: number of the wearer or camera.
        step: step of a drifting heading.
    """
    return int(gtsam.symbol(ROWS[block].letter, wearer * WEARER + step * STEP + item))
