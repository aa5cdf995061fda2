"""TotalCapture (Trumble et al. 2017): 13 Xsens sensors at 60 Hz with Vicon's skeleton as the truth.

A sequence is a ``.sensors`` file with its calibration (``calib_imu_bone.txt``, ``calib_imu_ref.txt``) and truth
(``gt_skel_gbl_pos.txt``, ``gt_skel_gbl_ori.txt``) beside it; their names may have prefixes. By the dataset's readme
``R_vicon_bone = R_ref · R_inertial_sensor · R_bone⁻¹``, so that ``R_bone`` is the sensor's mounting. Vicon's
skeleton has 21 joints, in inches, Y up.
"""

import re
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from vip_factors.body.anthropometry import STATURE_RANGE_M, skeleton_from_stature
from vip_factors.body.kinematics import Motion, local_rotations
from vip_factors.body.lengths import LEGS, stature_of
from vip_factors.body.skeleton import JOINT_NAMES, PARENTS, Skeleton, joint_index
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.quaternions import UNIT_TOLERANCE, Order, matrix_from_quaternion
from vip_factors.geometry.rotations import Array, angle_between, exp, log, rotation_x, transpose
from vip_factors.io.importers.shared import ImportedLog, default_sites, rotations_or_nan, z_up
from vip_factors.io.importers.text_table import peek
from vip_factors.io.motions.skeleton_maps import MOTIONBUILDER, both_sides
from vip_factors.sensors.calibration import Placement, SensorSite, sensor_site
from vip_factors.sensors.imu_stream import ImuStream

FORMAT = "totalcapture"
# The published mountings leave bones 2–7° from the optical ones: soft tissue, mostly.
MOUNTING_SIGMA = np.deg2rad(7.0)
METRES_PER_INCH = 0.0254
RATE = 60.0  # Hz
R_WORLD_VICON = rotation_x(np.pi / 2)  # Y up to Z up
SNAP_DEG = 20.0  # bone axes this near to a signed permutation were meant to be one

# Our bones and the joint that carries their position and turning; spine1 shares Spine and Spine1.
BONE_JOINTS = (
    dict(MOTIONBUILDER.joints)
    | {"spine2": "Spine2", "spine3": "Spine3"}
    | both_sides({"hand": "{}Hand", "foot": "{}Foot"}, "Left", "Right")
)
ENDS = ("left_hand", "right_hand", "left_foot", "right_foot")  # joints that the optical skeleton does not have
MOST_DIGITS = 12  # of a frame's number
_NUMBER = r"[ \t]+[-+.\deE]+"
# Counts of sensors and frames, a frame's number, and the first sensor with 7 or 13 numbers.
_HEAD = re.compile(rf"\d+[ \t]+\d+\s*\n\d+\s*\n[^\d\s]\S*(?:{_NUMBER}){{7}}(?:(?:{_NUMBER}){{6}})?\s")


class SensorTable(NamedTuple):
    """Content of a ``.sensors`` file.

    Attributes:
        names: the sensors'.
        numbers: ``(N,)`` frame numbers from 1 on.
        values: ``(N, S, 7)`` ``qw qx qy qz ax ay az``, or ``(N, S, 13)`` with ``gx gy gz mx my mz``.
    """

    names: tuple[str, ...]
    numbers: Array
    values: Array


class OpticalBody(NamedTuple):
    """The wearer as the optical system measured it.

    Attributes:
        motion: in our skeleton; time 0 is the first frame of the file.
        R_joint_bone: our bone axes in those of their joints, the same for all.
        R_vicon_joint: ``(T, 3, 3)`` by joint, of the frames of the motion.
        first_frame: number of the motion's first frame in the file, from 0 on.
    """

    motion: Motion
    R_joint_bone: Array
    R_vicon_joint: Mapping[str, Array]
    first_frame: int


def matches(path: Path) -> bool:
    """Whether the path is a ``.sensors`` file by its first lines, or a folder that holds one."""
    if path.is_dir():
        return any(_is_sensors_file(file) for file in path.glob("*.sensors"))
    return _is_sensors_file(path)


def read(path: Path) -> ImportedLog:
    """Read the sensors, the published mountings, and the optical motion, whose first frame is the sensors' first.

    Args:
        path: a ``.sensors`` file, or a folder with one sequence.

    Raises:
        FileFormatError: if a file is not of the form, naming the line.
    """
    file, notes, imus = _sensors_file(path), list[str](), dict[str, ImuStream]()
    table = _read_sensors(file, notes)
    R_inertial_sensor = {}
    for name, values in zip(table.names, np.moveaxis(table.values, 1, 0), strict=True):
        is_lost = ~np.any(values[:, :4], axis=1)  # exports write zeros
        quaternions = np.where(is_lost[:, None], np.nan, values[:, :4])
        R_inertial_sensor[name] = rotations_or_nan(quaternions, Order.WXYZ, f"{file}, sensor {name}", notes)
        R = z_up(name, R_inertial_sensor[name], values[:, 4:7], notes)
        rate = values[:, 7:10] if values.shape[1] > 7 else None
        imus[name] = ImuStream.from_samples(name, (table.numbers - 1) / RATE, values[:, 4:7], R, rate)
    sites, body = default_sites(list(imus)), _optical_body(file, notes)
    if body is None:
        return ImportedLog(FORMAT, imus, sites, notes=tuple(notes))
    placement = _placement(file, table, R_inertial_sensor, body, notes)
    stature_m = stature_of(body.motion.skeleton)
    return ImportedLog(FORMAT, imus, sites, placement, body.motion, stature_m=stature_m, notes=tuple(notes))


def _placement(
    file: Path, table: SensorTable, R_inertial_sensor: Mapping[str, Array], body: OpticalBody, notes: list[str]
) -> Placement | None:
    """The published mountings; a note says how far the bones that they give are from the optical ones."""
    bone_file, ref_file = _companion(file, "calib_imu_bone.txt"), _companion(file, "calib_imu_ref.txt")
    if bone_file is None:
        notes.append("no mountings: calib_imu_bone.txt is not beside the sensors")
        return None
    R_joint_sensor = _read_calibration(bone_file)
    R_vicon_inertial = _read_calibration(ref_file) if ref_file else {}
    frames = table.numbers.astype(int) - 1 - body.first_frame
    rows = np.flatnonzero((frames >= 0) & (frames < len(body.motion)))
    sites = default_sites(list(table.names))
    placed, angles = [], []
    for name in (name for name in sites if name in R_joint_sensor):
        site = sensor_site(sites[name], body.motion.skeleton, name)
        R_bone_sensor = body.R_joint_bone.T @ R_joint_sensor[name]
        placed.append(SensorSite(name, site.bone, site.p_bone_sensor, R_bone_sensor, MOUNTING_SIGMA))
        if name in R_vicon_inertial:
            R_vicon_joint = R_vicon_inertial[name] @ R_inertial_sensor[name][rows] @ transpose(R_joint_sensor[name])
            angles.append(angle_between(body.R_vicon_joint[BONE_JOINTS[site.bone]][frames[rows]], R_vicon_joint))
    if angles:
        median = np.rad2deg(np.nanmedian(np.concatenate(angles)))
        notes.append(f"calibrated sensors turn their bones {median:.1f}° (median) from the optical ones")
    return Placement(tuple(placed), FORMAT)


def _optical_body(file: Path, notes: list[str]) -> OpticalBody | None:
    """The optical truth beside a ``.sensors`` file, or None."""
    position_file, rotation_file = _companion(file, "gt_skel_gbl_pos.txt"), _companion(file, "gt_skel_gbl_ori.txt")
    if position_file is None or rotation_file is None:
        notes.append("no optical truth: gt_skel_gbl_pos.txt and gt_skel_gbl_ori.txt are not both beside the sensors")
        return None
    positions, quaternions = _read_truth(position_file, 3), _read_truth(rotation_file, 4)
    if set(positions) != set(quaternions):
        raise FileFormatError(
            f"{rotation_file}: its joints are not those of {position_file.name}: expected the same names"
        )
    missing = sorted({*BONE_JOINTS.values(), "Spine1"} - set(positions))
    if missing:
        raise FileFormatError(f"{rotation_file}: joint {missing[0]} is missing among {', '.join(positions)}")
    first, end = _complete_frames(rotation_file, positions, quaternions, notes)
    R = {name: matrix_from_quaternion(rows[first:end], Order.XYZW) for name, rows in quaternions.items()}
    p = {name: rows[first:end] * METRES_PER_INCH for name, rows in positions.items()}
    R_joint_bone = _bone_axes(R, p)
    R_bones = {name: R[joint] for name, joint in BONE_JOINTS.items()}
    R_bones["spine1"] = R["Spine"] @ exp(0.5 * log(transpose(R["Spine"]) @ R["Spine1"]))  # halfway: it spans both
    R_world_bone = R_WORLD_VICON @ np.stack([R_bones[name] for name in JOINT_NAMES], axis=1) @ R_joint_bone
    p_world_joint = np.stack([p[BONE_JOINTS[name]] for name in JOINT_NAMES], axis=1) @ R_WORLD_VICON.T
    skeleton = _skeleton(R_world_bone, p_world_joint)
    R_parent_child = local_rotations(R_world_bone)
    motion = Motion(skeleton, R_parent_child, p_world_joint[:, 0], RATE, first / RATE, "TotalCapture Vicon")
    error = np.linalg.norm(motion.state.p_world_joint - p_world_joint, axis=-1)
    error = error[:, [name not in ENDS for name in JOINT_NAMES]]
    notes.append(f"our joints lie {error.mean() * 1000:.1f} mm from the optical skeleton's")
    return OpticalBody(motion, R_joint_bone, R, first)


def _complete_frames(
    path: Path, positions: Mapping[str, Array], quaternions: Mapping[str, Array], notes: list[str]
) -> tuple[int, int]:
    """The first frame that holds rotations, and the one after the last."""
    p, q = (np.stack(list(rows.values()), axis=1) for rows in (positions, quaternions))
    count = min(len(p), len(q))
    if len(p) != len(q):
        notes.append(f"truth has {len(p)} positions, {len(q)} rotations")
    is_complete = np.all(np.abs(np.linalg.norm(q[:count], axis=-1) - 1) < UNIT_TOLERANCE, axis=1)
    is_complete &= np.all(np.isfinite(p[:count]), axis=(1, 2))
    complete = np.flatnonzero(is_complete)
    if len(complete) < 2:
        raise FileFormatError(f"{path}: no two frames hold unit quaternions: expected x y z w of each joint")
    first, end = int(complete[0]), int(complete[-1]) + 1
    if len(complete) < end - first:
        lost = first + int(np.argmin(is_complete[first:end]))
        raise FileFormatError(f"{path}: frame {lost} holds no unit quaternions: expected x y z w of each joint")
    if (first, end) != (0, count):
        notes.append(f"truth: {first} frames at its start and {count - end} at its end hold no rotations: left out")
    return first, end


def _bone_axes(R: Mapping[str, Array], p: Mapping[str, Array]) -> Array:
    """Our axes x left, y up, z forward in the axes of their joints, which all agree in the T-pose."""

    def offset(parent: str, child: str) -> Array:
        return np.einsum("tji,tj->ti", R[parent], p[child] - p[parent]).mean(axis=0)

    left = offset("Hips", "LeftUpLeg") - offset("Hips", "RightUpLeg")
    spine = ("Hips", "Spine", "Spine1", "Spine2", "Spine3", "Neck", "Head")
    up = sum((offset(parent, child) for parent, child in pairwise(spine)), np.zeros(3))
    x = left / np.linalg.norm(left)
    y = up - x * (x @ up)
    y /= np.linalg.norm(y)
    axes = np.stack([x, y, np.cross(x, y)], axis=1)
    snapped = np.round(axes)
    is_rotation = np.allclose(snapped @ snapped.T, np.eye(3)) and np.linalg.det(snapped) > 0
    return snapped if is_rotation and angle_between(axes, snapped) < np.deg2rad(SNAP_DEG) else axes


def _skeleton(R_world_bone: Array, p_world_joint: Array) -> Skeleton:
    """Mean offsets of each joint in its parent bone; hands, feet and landmarks in the proportions of the legs."""
    parents = np.array(PARENTS[1:])
    p_parent_joint = np.zeros((len(PARENTS), 3))
    offsets = p_world_joint[:, 1:] - p_world_joint[:, parents]
    p_parent_joint[1:] = np.einsum("tjba,tjb->tja", R_world_bone[:, parents], offsets).mean(axis=0)
    leg = sum(np.linalg.norm(p_parent_joint[joint_index(f"left_{name}")]) for name in ("knee", "ankle"))
    usual = skeleton_from_stature(float(np.clip(leg / LEGS, *STATURE_RANGE_M)))
    for name in ENDS:
        p_parent_joint[joint_index(name)] = usual.p_parent_joint[joint_index(name)]
    return Skeleton(p_parent_joint, usual.landmarks, "TotalCapture Vicon; hands and feet from the legs' length")


def _is_sensors_file(path: Path) -> bool:
    return _HEAD.match(peek(path)) is not None


def _sensors_file(path: Path) -> Path:
    """The ``.sensors`` file at a path; of a folder's, the one with angular rates if there are two of one sequence."""
    if path.is_file():
        return path
    files = [file for file in sorted(path.glob("*.sensors")) if _is_sensors_file(file)]
    if not files:
        raise FileFormatError(f"{path}: no .sensors file of TotalCapture there: expected 13 and the number of frames")
    if len({_sequence(file) for file in files}) > 1:
        names = ", ".join(file.name for file in files[:4])
        raise FileFormatError(f"{path}: holds several sequences ({names}): name the .sensors file you mean")
    return next((file for file in files if "AuxFields" in file.name), files[0])


def _sequence(file: Path) -> str:
    """The sequence's name without the subject, which only some of its files carry: ``s1_walking2_Xsens`` → walking2."""
    words = [word for word in file.stem.split("_") if word not in ("Xsens", "AuxFields")]
    return re.sub(r"^[sS]\d+_", "", "_".join(words))


def _companion(sensors: Path, ending: str) -> Path | None:
    """The calibration or truth beside a ``.sensors`` file, by its ending; of several, the same sequence's."""
    files = sorted(file for file in sensors.parent.iterdir() if file.name.endswith(ending))
    if len(files) > 1:
        files = [file for file in files if _sequence(sensors) in file.name.removesuffix(ending)]
    if len(files) > 1:
        names = ", ".join(file.name for file in files)
        raise FileFormatError(f"{sensors}: {names} may all belong to it: keep one sequence in a folder")
    return files[0] if files else None


def _lines(path: Path) -> list[str]:
    return path.read_text(encoding="ascii", errors="replace").rstrip().split("\n")


def _read_sensors(path: Path, notes: list[str]) -> SensorTable:
    """Read a ``.sensors`` file; one that breaks off gives its complete frames."""
    lines = _lines(path)
    counts = lines[0].split()
    if len(counts) != 2 or not all(word.isdigit() for word in counts) or int(counts[0]) < 1:
        raise FileFormatError(f"{path}: line 1 is '{lines[0][:40]}': expected the numbers of sensors and of frames")
    sensors, announced = map(int, counts)
    frames = (len(lines) - 1) // (sensors + 1)
    if frames < 1:
        raise FileFormatError(f"{path}: holds no whole frame: expected {announced}")
    names = tuple((line.split() or ["?"])[0] for line in lines[2 : 2 + sensors])
    numbers, rows = [], []
    for index, line in enumerate(lines[1 : 1 + frames * (sensors + 1)]):
        words, row = line.split(), index % (sensors + 1)
        if row == 0:
            if not line.strip().isdigit() or len(line.strip()) > MOST_DIGITS:
                raise FileFormatError(f"{path}: line {index + 2} is '{line[:40]}': expected a frame's number alone")
            numbers.append(float(line))
        elif words[:1] != [names[row - 1]]:
            raise FileFormatError(f"{path}: line {index + 2} is '{line[:40]}': expected sensor {names[row - 1]}")
        else:
            rows.append(words[1:])
    if frames < announced:
        notes.append(f"{path.name} announces {announced} frames and holds {frames} whole ones")
    return SensorTable(names, np.array(numbers), _numbers(path, rows, 7, 13).reshape(frames, sensors, -1))


def _read_calibration(path: Path) -> dict[str, Array]:
    """Rotations ``(3, 3)`` by sensor name, of a ``calib_imu_*.txt`` (w last)."""
    rotations = {}
    for number, line in enumerate(_lines(path)[1:], start=2):
        name, *words = line.split() or [""]
        if not name:
            continue
        try:
            rotations[name] = matrix_from_quaternion(np.array(words, float).reshape(4), Order.XYZW)
        except (InputError, ValueError) as error:
            raise FileFormatError(f"{path}: line {number} is '{line[:60]}': expected Name qx qy qz qw") from error
    return rotations


def _read_truth(path: Path, width: int) -> dict[str, Array]:
    """Rows ``(T, width)`` by joint of a ``gt_skel_gbl_*.txt``; a last line that breaks off is left out."""
    header, *rows = [line.split() for line in _lines(path)]
    if rows and len(rows[-1]) < len(header) * width:
        rows = rows[:-1]
    if not rows:
        raise FileFormatError(f"{path}: holds no frame: expected joint names and a line a frame")
    values = _numbers(path, rows, len(header) * width).reshape(len(rows), -1, width)
    return dict(zip(header, np.moveaxis(values, 1, 0), strict=True))


def _numbers(path: Path, rows: list[list[str]], *widths: int) -> Array:
    """The rows as numbers, all with as many, which has to be one of ``widths``."""
    width = len(rows[0]) if len(rows[0]) in widths else widths[0]
    for number, row in enumerate(rows, start=1):
        if len(row) != width:
            raise FileFormatError(f"{path}: row {number} has {len(row)} numbers: expected {width} numbers")
    try:
        return np.array(rows, dtype=float)
    except ValueError as error:
        raise FileFormatError(f"{path}: {error}: expected numbers") from error
