"""First poses (instrumented bones as their sensors say, the others at the prior's mean) and a first root path.

The root path is kinematics alone: whichever foot stands lowest stands still.
"""

from collections.abc import Sequence
from itertools import accumulate

import numpy as np
from scipy.ndimage import uniform_filter1d

from vip_factors.body.kinematics import BodyState, local_rotations
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


HEIGHT_BAND = 0.03  # m above the lowest point within which a point may bear the body: soles and floors are not flat
SPEED_SCALE = 0.4  # m/s: a planted foot rolls slower than this, a swinging one moves at 2–4 m/s
SMOOTHING = 0.1  # s over which confidence is averaged: a contact lasts longer than that
ROUNDING = 1e-6  # frames: at 15 Hz it is one and a half of them, and the last digit of a time must not say one or two


def standing_path(body: BodyState, points: tuple[tuple[int, Array], ...]) -> Array:
    """Root positions ``(T, 3)`` that keep the lowest contact point of each frame where it is, on a floor at z = 0.

    ``body`` has its root at the origin in all frames.
    """
    relative = np.stack([body.point(bone, p) for bone, p in points], axis=1)
    lowest = np.argmin(relative[:, :, 2], axis=1)
    rows = np.arange(len(relative) - 1)
    step = relative[rows, lowest[:-1]] - relative[rows + 1, lowest[:-1]]
    path = np.zeros((len(relative), 3))
    path[1:, :2] = np.cumsum(step[:, :2], axis=0)
    path[:, 2] = -relative[:, :, 2].min(axis=1)
    return path


def contact_confidence(body: BodyState, points: tuple[tuple[int, Array], ...], step: float) -> Array:
    """How surely each contact point ``(T, C)`` bears the body, in [0, 1]: it is low, and slower than anything else.

    ``body`` is placed in the world, with a first guess of its root path.
    """
    p = np.stack([body.point(bone, point) for bone, point in points], axis=1)
    velocity = np.gradient(p, step, axis=0)
    speed = np.linalg.norm(velocity, axis=2)
    height = p[:, :, 2] - p[:, :, 2].min(axis=1, keepdims=True)
    confidence = np.exp(-0.5 * (speed / SPEED_SCALE) ** 2 - 0.5 * (height / HEIGHT_BAND) ** 2)
    frames = max(1, round(SMOOTHING / step + ROUNDING))
    averaged = uniform_filter1d(confidence, frames, axis=0)
    return np.clip(averaged, 0.0, 1.0)  # the running sum rounds to slightly below zero
