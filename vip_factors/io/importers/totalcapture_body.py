"""From TotalCapture's optical skeleton (21 joints, inches, Y up) to our 24 joints."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from vip_factors.body.anthropometry import STATURE_RANGE_M, skeleton_from_stature
from vip_factors.body.kinematics import Motion, local_rotations
from vip_factors.body.lengths import LEGS
from vip_factors.body.skeleton import JOINT_NAMES, PARENTS, Skeleton, joint_index
from vip_factors.errors import InputError
from vip_factors.geometry.quaternions import UNIT_TOLERANCE, Order, matrix_from_quaternion
from vip_factors.geometry.rotations import Array, angle_between, exp, log, rotation_x, transpose

METRES_PER_INCH = 0.0254
RATE = 60.0  # Hz
R_WORLD_VICON = rotation_x(np.pi / 2)  # Y up to Z up
SNAP_DEG = 20.0  # bone axes this near to a signed permutation were meant to be one
REST_DEG = 30.0  # limbs further from the T-pose at identity mean another zero pose

# Our bones and the joint that carries their position and turning; spine1 shares Spine and Spine1.
BONE_JOINTS = {
    "pelvis": "Hips", "spine1": "Spine", "spine2": "Spine2", "spine3": "Spine3", "neck": "Neck", "head": "Head",
} | {
    f"{side.lower()}_{bone}": f"{side}{joint}"
    for side in ("Left", "Right")
    for bone, joint in {
        "collar": "Shoulder", "shoulder": "Arm", "elbow": "ForeArm", "wrist": "Hand", "hand": "Hand",
        "hip": "UpLeg", "knee": "Leg", "ankle": "Foot", "foot": "Foot",
    }.items()
}  # fmt: skip
ENDS = ("left_hand", "right_hand", "left_foot", "right_foot")  # joints that the optical skeleton does not have
# Where limbs point at rest, in our axes.
REST_DIRECTIONS = {
    "left_elbow": (1, 0, 0), "left_wrist": (1, 0, 0), "right_elbow": (-1, 0, 0), "right_wrist": (-1, 0, 0),
    "left_knee": (0, -1, 0), "left_ankle": (0, -1, 0), "right_knee": (0, -1, 0), "right_ankle": (0, -1, 0),
}  # fmt: skip


@dataclass(frozen=True)
class OpticalBody:
    """The optical system's wearer.

    Attributes:
        motion: in our skeleton, its start at the first frame of the file.
        R_joint_bone: our bone axes in those of their joints, the same for all.
        R_vicon_joint: ``(T, J, 3, 3)`` and ``names``: their own rotations, of the frames kept.
        first_frame: of the file that was kept.
        joint_error_m: mean distance between our joints and theirs.
        notes: what was trimmed or looked odd.
    """

    motion: Motion
    R_joint_bone: Array
    R_vicon_joint: Array
    names: tuple[str, ...]
    first_frame: int
    joint_error_m: float
    notes: tuple[str, ...]


def optical_body(names: tuple[str, ...], positions: Array, quaternions: Array) -> OpticalBody:
    """Our skeleton and motion of joint positions ``(T, J, 3)`` in inches and rotations ``(T, J, 4)``, w last.

    Raises:
        InputError: if joints are missing, or frames in the middle hold no rotations.
    """
    missing = sorted({*BONE_JOINTS.values(), "Spine1"} - set(names))
    if missing:
        raise InputError(f"joint {missing[0]} is missing among {', '.join(names)}")
    first, last, notes = _whole_frames(positions, quaternions)
    R = matrix_from_quaternion(quaternions[first:last], Order.XYZW)
    p = positions[first:last] * METRES_PER_INCH
    column = {name: k for k, name in enumerate(names)}
    R_joint_bone = _bone_axes(R, p, column)

    turning = [R[:, column[BONE_JOINTS[name]]] for name in JOINT_NAMES]
    # spine1 spans Spine and Spine1: it turns halfway between them.
    halfway = exp(0.5 * log(transpose(R[:, column["Spine"]]) @ R[:, column["Spine1"]]))
    turning[joint_index("spine1")] = R[:, column["Spine"]] @ halfway
    R_world_bone = R_WORLD_VICON @ np.stack(turning, axis=1) @ R_joint_bone
    p_world_joint = p[:, [column[BONE_JOINTS[name]] for name in JOINT_NAMES]] @ R_WORLD_VICON.T

    skeleton = _skeleton(R_world_bone, p_world_joint)
    motion = Motion(
        skeleton, local_rotations(R_world_bone), p_world_joint[:, 0], RATE, first / RATE, "TotalCapture Vicon"
    )
    has_twin = [name not in ENDS for name in JOINT_NAMES]
    error = np.linalg.norm(motion.state.p_world_joint - p_world_joint, axis=-1)[:, has_twin]
    notes += _odd_limbs(skeleton)
    return OpticalBody(motion, R_joint_bone, R, names, first, float(error.mean()), tuple(notes))


def _whole_frames(positions: Array, quaternions: Array) -> tuple[int, int, list[str]]:
    T = min(len(positions), len(quaternions))
    notes = (
        []
        if len(positions) == len(quaternions)
        else [f"truth has {len(positions)} positions, {len(quaternions)} rotations"]
    )
    good = np.all(np.abs(np.linalg.norm(quaternions[:T], axis=-1) - 1) < UNIT_TOLERANCE, axis=1)
    good &= np.all(np.isfinite(positions[:T]), axis=(1, 2))
    kept = np.flatnonzero(good)
    if len(kept) < 2:
        raise InputError("no two frames of the truth hold unit quaternions: expected x y z w of each joint")
    first, last = int(kept[0]), int(kept[-1]) + 1
    if not np.all(good[first:last]):
        bad = first + int(np.flatnonzero(~good[first:last])[0])
        raise InputError(f"frame {bad} of the truth holds no unit quaternions: expected x y z w of each joint")
    if (first, last) != (0, T):
        notes.append(f"truth: {first} frames at its start and {T - last} at its end hold no rotations and are left out")
    return first, last, notes


def _bone_axes(R: Array, p: Array, column: dict[str, int]) -> Array:
    """Our axes x left, y up, z forward in the axes of their joints, which all agree in the T-pose."""

    def offset(parent: str, child: str) -> Array:
        a, b = column[parent], column[child]
        return np.einsum("tji,tj->ti", R[:, a], p[:, b] - p[:, a]).mean(axis=0)

    left = offset("Hips", "LeftUpLeg") - offset("Hips", "RightUpLeg")
    spine = ("Hips", "Spine", "Spine1", "Spine2", "Spine3", "Neck", "Head")
    up = sum((offset(a, b) for a, b in pairwise(spine)), np.zeros(3))
    x = left / np.linalg.norm(left)
    y = up - x * (x @ up)
    y /= np.linalg.norm(y)
    axes = np.stack([x, y, np.cross(x, y)], axis=1)
    snapped = np.round(axes)
    proper = np.allclose(snapped @ snapped.T, np.eye(3)) and np.linalg.det(snapped) > 0
    return snapped if proper and angle_between(axes, snapped) < np.deg2rad(SNAP_DEG) else axes


def _skeleton(R_world_bone: Array, p_world_joint: Array) -> Skeleton:
    """Mean offsets of each joint in its parent bone; hands, feet and landmarks in the proportions of the legs."""
    parents = np.array(PARENTS[1:])
    offsets = np.zeros((len(PARENTS), 3))
    apart = p_world_joint[:, 1:] - p_world_joint[:, parents]
    offsets[1:] = np.einsum("tjba,tjb->tja", R_world_bone[:, parents], apart).mean(axis=0)
    leg = sum(np.linalg.norm(offsets[joint_index(f"left_{name}")]) for name in ("knee", "ankle"))
    usual = skeleton_from_stature(float(np.clip(leg / LEGS, *STATURE_RANGE_M)))
    for name in ENDS:
        offsets[joint_index(name)] = usual.p_parent_joint[joint_index(name)]
    return Skeleton(offsets, usual.landmarks, "TotalCapture Vicon; hands and feet from the legs' length")


def _odd_limbs(skeleton: Skeleton) -> list[str]:
    notes = []
    for name, direction in REST_DIRECTIONS.items():
        offset = skeleton.p_parent_joint[joint_index(name)]
        angle = np.rad2deg(np.arccos(np.clip(offset @ np.array(direction) / np.linalg.norm(offset), -1, 1)))
        if angle > REST_DEG:
            notes.append(f"truth: at identity the bone towards {name} lies {angle:.0f}° off the T-pose")
    return notes
