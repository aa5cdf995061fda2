"""A first pose for every frame: instrumented bones as their sensors say, the others at the prior's mean."""

from collections.abc import Sequence

import numpy as np

from vip_factors.body.kinematics import local_rotations
from vip_factors.body.pose_prior import PosePrior
from vip_factors.body.skeleton import JOINT_COUNT, PARENTS
from vip_factors.geometry.rotations import Array, exp, rotation_z, transpose
from vip_factors.initialise.calibration import InitialCalibration
from vip_factors.sensors.frames import ImuFrames


def first_poses(
    frames: ImuFrames, bones: Sequence[int], calibration: InitialCalibration, prior: PosePrior
) -> Array:
    """Joint rotations ``(T, 24, 3, 3)`` to start the inertial tracker from.

    Where several sensors share a bone the first one decides; where none is valid the bone follows its parent at the
    mean pose of the prior. A pelvis without a sensor follows the first bone up the spine that has one.
    """
    T = len(frames)
    measured: dict[int, int] = {}
    for s, bone in enumerate(bones):
        measured.setdefault(bone, s)
    mean = np.concatenate([np.eye(3)[None], exp(prior.mean.reshape(-1, 3))])
    R_world_bone = np.empty((T, JOINT_COUNT, 3, 3))
    for joint in range(JOINT_COUNT):
        followed = R_world_bone[:, PARENTS[joint]] @ mean[joint] if joint else _pelvis(frames, measured, calibration)
        R_world_bone[:, joint] = followed
        if joint in measured:
            s = measured[joint]
            R = _bone_orientation(frames, s, calibration)
            R_world_bone[:, joint] = np.where(frames.orientation_valid[:, s, None, None], R, followed)
    return local_rotations(R_world_bone)


def _bone_orientation(frames: ImuFrames, s: int, calibration: InitialCalibration) -> Array:
    """``R_world_bone`` ``(T, 3, 3)`` of the bone that carries a sensor (thesis eq. 4.8)."""
    R_world_sensor = rotation_z(calibration.headings[s]) @ frames.R_inertial_sensor[:, s]
    return R_world_sensor @ transpose(calibration.R_bone_sensor[s])


def _pelvis(frames: ImuFrames, measured: dict[int, int], calibration: InitialCalibration) -> Array:
    """Orientation of the pelvis where its own sensor is missing: that of the lowest instrumented bone of the trunk."""
    for bone in (0, 3, 6, 9, 12, 15, 1, 2):
        if bone in measured:
            return _bone_orientation(frames, measured[bone], calibration)
    return _bone_orientation(frames, next(iter(measured.values())), calibration)
