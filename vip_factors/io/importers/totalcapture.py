"""TotalCapture (Trumble et al. 2017): 13 Xsens sensors at 60 Hz with Vicon's skeleton as the truth.

A sequence is a ``.sensors`` file with its calibration (``calib_imu_bone.txt``, ``calib_imu_ref.txt``) and truth
(``gt_skel_gbl_pos.txt``, ``gt_skel_gbl_ori.txt``) beside it; their names may have prefixes. By the dataset's readme
``R_vicon_bone = R_ref · R_inertial_sensor · R_bone⁻¹``, so that ``R_bone`` is the sensor's mounting. Vicon's
skeleton has 21 joints, in inches, Y up.
"""

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from vip_factors.body.anthropometry import STATURE_RANGE_M, skeleton_from_stature
from vip_factors.body.kinematics import Motion, local_rotations
from vip_factors.body.lengths import LEGS, stature_of
from vip_factors.body.skeleton import JOINT_NAMES, PARENTS, Skeleton, joint_index
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.quaternions import UNIT_TOLERANCE, Order, matrix_from_quaternion
from vip_factors.geometry.rotations import Array, angle_between, exp, log, rotation_x, transpose
from vip_factors.io.importers.shared import ImportedLog, rotations_or_nan, z_up
from vip_factors.io.importers.totalcapture_files import (
    SensorTable,
    companion,
    is_sensors_file,
    read_calibration,
    read_sensors,
    read_truth,
    sensors_file,
)
from vip_factors.io.motions.skeleton_maps import both_sides
from vip_factors.sensors.calibration import Placement, SensorSite, sensor_site
from vip_factors.sensors.imu_stream import ImuStream

METRES_PER_INCH = 0.0254
RATE = 60.0  # Hz
R_WORLD_VICON = rotation_x(np.pi / 2)  # Y up to Z up
SNAP_DEG = 20.0  # bone axes this near to a signed permutation were meant to be one
REST_DEG = 30.0  # limbs further from the T-pose at identity mean another zero pose

# Our bones and the joint that carries their position and turning; spine1 shares Spine and Spine1.
BONE_JOINTS = {
    "pelvis": "Hips", "spine1": "Spine", "spine2": "Spine2", "spine3": "Spine3", "neck": "Neck", "head": "Head",
} | both_sides(
    {
        "collar": "{}Shoulder", "shoulder": "{}Arm", "elbow": "{}ForeArm", "wrist": "{}Hand", "hand": "{}Hand",
        "hip": "{}UpLeg", "knee": "{}Leg", "ankle": "{}Foot", "foot": "{}Foot",
    }, "Left", "Right",
)  # fmt: skip
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
    """

    motion: Motion
    R_joint_bone: Array
    R_vicon_joint: Array
    names: tuple[str, ...]
    first_frame: int


def optical_body(names: tuple[str, ...], positions: Array, quaternions: Array, notes: list[str]) -> OpticalBody:
    """Our skeleton and motion of joint positions ``(T, J, 3)`` in inches and rotations ``(T, J, 4)``, w last.

    What was trimmed or looks odd is added to ``notes``.

    Raises:
        InputError: if joints are missing, or frames in the middle hold no rotations.
    """
    missing = sorted({*BONE_JOINTS.values(), "Spine1"} - set(names))
    if missing:
        raise InputError(f"joint {missing[0]} is missing among {', '.join(names)}")
    first, last = _whole_frames(positions, quaternions, notes)
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
    notes += [*_odd_limbs(skeleton), f"our joints lie {error.mean() * 1000:.1f} mm from the optical skeleton's"]
    return OpticalBody(motion, R_joint_bone, R, names, first)


def _whole_frames(positions: Array, quaternions: Array, notes: list[str]) -> tuple[int, int]:
    """The frames that hold rotations: the first, and the one after the last."""
    T = min(len(positions), len(quaternions))
    if len(positions) != len(quaternions):
        notes.append(f"truth has {len(positions)} positions, {len(quaternions)} rotations")
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
    return first, last


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


FORMAT = "totalcapture"

# The published mountings leave bones 2–7° from the optical ones: soft tissue, mostly.
MOUNTING_SIGMA = np.deg2rad(7.0)

_LIMBS = {
    "upper_arm": "{}_UpArm", "forearm": "{}_LowArm", "thigh": "{}_UpLeg", "shank": "{}_LowLeg", "foot": "{}_Foot",
}  # fmt: skip
SENSOR_SITES = {"Head": "head", "Sternum": "sternum", "Pelvis": "pelvis"} | {
    name: site for site, name in both_sides(_LIMBS, "L", "R").items()
}


def matches(path: Path) -> bool:
    """Whether the path is a ``.sensors`` file by its first lines, or a folder that holds one."""
    if path.is_dir():
        return any(is_sensors_file(file) for file in path.glob("*.sensors"))
    return is_sensors_file(path)


def read(path: Path) -> ImportedLog:
    """The sensors, the published mountings, and the optical motion, whose first frame is the sensors' first.

    Args:
        path: a ``.sensors`` file, or a folder with one sequence.

    Raises:
        FileFormatError: if a file is not of the form, naming the line.
    """
    file = sensors_file(path)
    table = read_sensors(file)
    notes = [table.truncated] if table.truncated else []
    imus, R_inertial_sensor = _streams(file, table, notes)
    body = _body(file, notes)
    truth = None if body is None else body.motion
    return ImportedLog(
        format=FORMAT,
        imus=imus,
        default_sites={name: SENSOR_SITES[name] for name in imus if name in SENSOR_SITES},
        placement=None if body is None else _placement(file, table, body, R_inertial_sensor, notes),
        truth_motion=truth,
        stature_m=None if truth is None else stature_of(truth.skeleton),
        notes=tuple(notes),
    )


def _streams(file: Path, table: SensorTable, notes: list[str]) -> tuple[dict[str, ImuStream], Array]:
    """Streams by sensor, and all orientations ``(N, S, 3, 3)``, NaN where lost: exports write these as zeros."""
    time, R_inertial_sensor, imus = (table.index - 1) / RATE, [], {}
    for k, name in enumerate(table.names):
        lost = ~np.any(table.values[:, k, :4], axis=1)
        quaternions = np.where(lost[:, None], np.nan, table.values[:, k, :4])
        R_inertial_sensor.append(rotations_or_nan(quaternions, Order.WXYZ, f"{file}, sensor {name}", notes))
        force = table.values[:, k, 4:7]
        rate = table.values[:, k, 7:10] if table.values.shape[-1] > 7 else None
        R, odd = z_up(name, R_inertial_sensor[-1], force)
        notes += odd
        imus[name] = ImuStream.from_samples(name, time, force, R, rate)
    return imus, np.stack(R_inertial_sensor, axis=1)


def _body(file: Path, notes: list[str]) -> OpticalBody | None:
    positions, orientations = companion(file, "position"), companion(file, "orientation")
    if positions is None or orientations is None:
        notes.append("no optical truth: gt_skel_gbl_pos.txt and gt_skel_gbl_ori.txt are not both beside the sensors")
        return None
    names, p = read_truth(positions, 3)
    names_too, q = read_truth(orientations, 4)
    if set(names) != set(names_too):
        raise FileFormatError(f"{orientations}: its joints are not those of {positions.name}: expected the same names")
    try:
        return optical_body(names, p, q[:, [names_too.index(name) for name in names]], notes)
    except InputError as error:
        raise FileFormatError(f"{orientations}: {error}") from error


def _placement(
    file: Path, table: SensorTable, body: OpticalBody, R_inertial_sensor: Array, notes: list[str]
) -> Placement | None:
    """The published mountings; a note tells how far the bones that they give are from the optical ones."""
    bone_file, ref_file = companion(file, "bone"), companion(file, "ref")
    if bone_file is None:
        notes.append("no mountings: calib_imu_bone.txt is not beside the sensors")
        return None
    R_joint_sensor = read_calibration(bone_file)
    R_vicon_inertial = read_calibration(ref_file) if ref_file else {}
    frames = table.index.astype(int) - 1 - body.first_frame
    rows = np.flatnonzero((frames >= 0) & (frames < len(body.motion)))
    sites, angles = [], []
    for k, name in enumerate(table.names):
        if name not in SENSOR_SITES or name not in R_joint_sensor:
            continue
        usual = sensor_site(SENSOR_SITES[name], body.motion.skeleton, name)
        R_bone_sensor = body.R_joint_bone.T @ R_joint_sensor[name]
        sites.append(SensorSite(name, usual.bone, usual.p_bone_sensor, R_bone_sensor, MOUNTING_SIGMA))
        if name in R_vicon_inertial:
            R_measured = body.R_vicon_joint[frames[rows], body.names.index(BONE_JOINTS[usual.bone])]
            R_vicon_joint = R_vicon_inertial[name] @ R_inertial_sensor[rows, k] @ transpose(R_joint_sensor[name])
            angles.append(angle_between(R_measured, R_vicon_joint))
    if angles:
        middle = np.rad2deg(np.nanmedian(np.concatenate(angles)))
        notes.append(f"calibrated sensors turn their bones {middle:.1f}° (median) from the optical ones")
    return Placement(tuple(sites), FORMAT)
