"""A first pose for every frame: instrumented bones as their sensors say, the others at the prior's mean."""

from collections.abc import Sequence
from itertools import accumulate

import numpy as np

from vip_factors.body.kinematics import local_rotations
from vip_factors.body.pose_prior import PosePrior
from vip_factors.body.skeleton import JOINT_COUNT, PARENTS, ancestors
from vip_factors.geometry.quaternions import interpolate_rotations
from vip_factors.geometry.rotations import Array, exp, log, rotation_z, transpose
from vip_factors.initialise.calibration import InitialCalibration
from vip_factors.sensors.frames import ImuFrames

TRUNK = (0, 3, 6, 9, 12, 15)  # pelvis, spine, neck, head


def first_poses(frames: ImuFrames, bones: Sequence[int], calibration: InitialCalibration, prior: PosePrior) -> Array:
    """Joint rotations ``(T, 24, 3, 3)`` to start the inertial tracker from.

    Between two instrumented bones the joints start at the prior's mean and share what is left, a like angle each: a
    trunk whose neck alone did all the turning would start beyond its limits, in another valley than the solution's.
    Where several sensors share a bone the first one decides; what it missed is interpolated, and one that measured
    nothing is passed over. A pelvis without a sensor follows the first bone up the spine that has one.
    """
    measured: dict[int, int] = {}
    for s, bone in enumerate(bones):
        if frames.orientation_valid[:, s].any():
            measured.setdefault(bone, s)
    mean = np.concatenate([np.eye(3)[None], exp(prior.mean.reshape(-1, 3))])
    R_world_bone = np.empty((len(frames), JOINT_COUNT, 3, 3))
    R_world_bone[:, 0] = _pelvis(frames, measured, calibration)
    placed = {0}
    for bone in sorted(measured, key=_trunk_first):
        chain = [joint for joint in ancestors(bone) if joint not in placed]
        if not chain:
            continue
        start = R_world_bone[:, PARENTS[chain[0]]]
        followed = start[:, None] @ np.stack(list(accumulate(mean[chain], np.matmul)))
        R = _bone_orientation(frames, measured[bone], calibration)
        left = log(transpose(start) @ R @ transpose(followed[:, -1]) @ start)
        shares = np.arange(1, len(chain) + 1) / len(chain)
        turned = exp(shares[:, None] * left[:, None])
        R_world_bone[:, chain] = start[:, None] @ turned @ transpose(start)[:, None] @ followed
        placed |= set(chain)
    for joint in range(JOINT_COUNT):
        if joint not in placed:
            R_world_bone[:, joint] = R_world_bone[:, PARENTS[joint]] @ mean[joint]
    return local_rotations(R_world_bone)


def _trunk_first(bone: int) -> tuple[bool, int]:
    """Order in which instrumented bones are placed: up the trunk, then limbs from the inside out."""
    return bone not in TRUNK, len(ancestors(bone))


def _bone_orientation(frames: ImuFrames, s: int, calibration: InitialCalibration) -> Array:
    """``R_world_bone`` ``(T, 3, 3)`` of the bone that carries a sensor (thesis eq. 4.8), gaps interpolated."""
    seen = frames.orientation_valid[:, s]
    R_inertial_sensor = interpolate_rotations(frames.time[seen], frames.R_inertial_sensor[seen, s], frames.time)
    return rotation_z(calibration.headings[s]) @ R_inertial_sensor @ transpose(calibration.R_bone_sensor[s])


def _pelvis(frames: ImuFrames, measured: dict[int, int], calibration: InitialCalibration) -> Array:
    """Orientation of the pelvis where its own sensor is missing: that of the lowest instrumented bone of the trunk."""
    for bone in (*TRUNK, 1, 2):
        if bone in measured:
            return _bone_orientation(frames, measured[bone], calibration)
    return _bone_orientation(frames, next(iter(measured.values())), calibration)
