"""TotalCapture (Trumble et al. 2017): 13 Xsens sensors at 60 Hz with Vicon's skeleton as the truth.

A sequence is a ``.sensors`` file with its calibration (``calib_imu_bone.txt``, ``calib_imu_ref.txt``) and truth
(``gt_skel_gbl_pos.txt``, ``gt_skel_gbl_ori.txt``) beside it; their names may have prefixes. By the dataset's readme
``R_vicon_bone = R_ref · R_inertial_sensor · R_bone⁻¹``, so that ``R_bone`` is the sensor's mounting. Vicon's
skeleton has 21 joints, in inches, Y up.
"""

import re
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
from vip_factors.io.motions.skeleton_maps import both_sides
from vip_factors.sensors.calibration import Placement, SensorSite, sensor_site
from vip_factors.sensors.imu_stream import ImuStream

FORMAT = "totalcapture"
# The published mountings leave bones 2–7° from the optical ones: soft tissue, mostly.
MOUNTING_SIGMA = np.deg2rad(7.0)
_LIMBS = {
    "upper_arm": "{}_UpArm", "forearm": "{}_LowArm", "thigh": "{}_UpLeg", "shank": "{}_LowLeg", "foot": "{}_Foot",
}  # fmt: skip
SENSOR_SITES = {"Head": "head", "Sternum": "sternum", "Pelvis": "pelvis"} | {
    name: site for site, name in both_sides(_LIMBS, "L", "R").items()
}
METRES_PER_INCH = 0.0254
RATE = 60.0  # Hz
R_WORLD_VICON = rotation_x(np.pi / 2)  # Y up to Z up
SNAP_DEG = 20.0  # bone axes this near to a signed permutation were meant to be one

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
COMPANIONS = {
    "bone": "calib_imu_bone.txt",
    "ref": "calib_imu_ref.txt",
    "position": "gt_skel_gbl_pos.txt",
    "orientation": "gt_skel_gbl_ori.txt",
}
MOST_DIGITS = 12  # of a frame's number
_NUMBER = r"[ \t]+[-+.\deE]+"
# Counts of sensors and frames, a frame's number, and the first sensor with 7 or 13 numbers.
_HEAD = re.compile(rf"\d+[ \t]+\d+\s*\n\d+\s*\n[^\d\s]\S*(?:{_NUMBER}){{7}}(?:(?:{_NUMBER}){{6}})?\s")


@dataclass(frozen=True)
class SensorTable:
    """Content of a ``.sensors`` file.

    Attributes:
        names: of the sensors.
        index: ``(N,)`` 1-based frame numbers.
        values: ``(N, S, 7)`` ``qw qx qy qz ax ay az``, or ``(N, S, 13)`` with ``gx gy gz mx my mz``.
        truncated: a sentence if the file holds fewer frames than it announces.
    """

    names: tuple[str, ...]
    index: Array
    values: Array
    truncated: str = ""


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
    notes.append(f"our joints lie {error.mean() * 1000:.1f} mm from the optical skeleton's")
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


def matches(path: Path) -> bool:
    """Whether the path is a ``.sensors`` file by its first lines, or a folder that holds one."""
    if path.is_dir():
        return any(_is_sensors_file(file) for file in path.glob("*.sensors"))
    return _is_sensors_file(path)


def read(path: Path) -> ImportedLog:
    """The sensors, the published mountings, and the optical motion, whose first frame is the sensors' first.

    Args:
        path: a ``.sensors`` file, or a folder with one sequence.

    Raises:
        FileFormatError: if a file is not of the form, naming the line.
    """
    file = _sensors_file(path)
    table = _read_sensors(file)
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
    positions, orientations = _companion(file, "position"), _companion(file, "orientation")
    if positions is None or orientations is None:
        notes.append("no optical truth: gt_skel_gbl_pos.txt and gt_skel_gbl_ori.txt are not both beside the sensors")
        return None
    names, p = _read_truth(positions, 3)
    names_too, q = _read_truth(orientations, 4)
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
    bone_file, ref_file = _companion(file, "bone"), _companion(file, "ref")
    if bone_file is None:
        notes.append("no mountings: calib_imu_bone.txt is not beside the sensors")
        return None
    R_joint_sensor = _read_calibration(bone_file)
    R_vicon_inertial = _read_calibration(ref_file) if ref_file else {}
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


def _is_sensors_file(path: Path) -> bool:
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return _HEAD.match(file.read(2048).decode("ascii", "replace")) is not None


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


def _companion(sensors: Path, kind: str) -> Path | None:
    """The calibration or truth beside a ``.sensors`` file, by its ending; of several, the same sequence's."""
    ending = COMPANIONS[kind]
    files = sorted(file for file in sensors.parent.iterdir() if file.name.endswith(ending))
    if len(files) > 1:
        files = [file for file in files if _sequence(sensors) in file.name.removesuffix(ending)]
    if len(files) > 1:
        names = ", ".join(file.name for file in files)
        raise FileFormatError(f"{sensors}: {names} may all belong to it: keep one sequence in a folder")
    return files[0] if files else None


def _lines(path: Path) -> list[str]:
    return path.read_text(encoding="ascii", errors="replace").rstrip().split("\n")


def _read_sensors(path: Path) -> SensorTable:
    """One that breaks off gives its whole frames."""
    lines = _lines(path)
    counts = lines[0].split()
    if len(counts) != 2 or not all(word.isdigit() for word in counts) or int(counts[0]) < 1:
        raise FileFormatError(f"{path}: line 1 is '{lines[0][:40]}': expected the numbers of sensors and of frames")
    sensors, announced = map(int, counts)
    frames = (len(lines) - 1) // (sensors + 1)
    if frames < 1:
        raise FileFormatError(f"{path}: holds no whole frame: expected {announced}")
    names = tuple((line.split() or ["?"])[0] for line in lines[2 : 2 + sensors])
    index, rows = [], []
    for at, line in enumerate(lines[1 : 1 + frames * (sensors + 1)]):
        words, row = line.split(), at % (sensors + 1)
        if row == 0:
            if not line.strip().isdigit() or len(line.strip()) > MOST_DIGITS:
                raise FileFormatError(f"{path}: line {at + 2} is '{line[:40]}': expected a frame's number alone")
            index.append(float(line))
        elif words[:1] != [names[row - 1]]:
            raise FileFormatError(f"{path}: line {at + 2} is '{line[:40]}': expected sensor {names[row - 1]}")
        else:
            rows.append(words[1:])
    values = _numbers(path, rows, widths=(7, 13)).reshape(frames, sensors, -1)
    truncated = "" if frames >= announced else f"{path.name} announces {announced} frames and holds {frames} whole ones"
    return SensorTable(names, np.array(index), values, truncated)


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


def _read_truth(path: Path, width: int) -> tuple[tuple[str, ...], Array]:
    """Joint names and ``(T, J, width)`` numbers of a ``gt_skel_gbl_*.txt``; a last line that breaks off is left out."""
    header, *rows = [line.split() for line in _lines(path)]
    if rows and len(rows[-1]) < len(header) * width:
        rows = rows[:-1]
    if not rows:
        raise FileFormatError(f"{path}: holds no frame: expected joint names and a line a frame")
    return tuple(header), _numbers(path, rows, widths=(len(header) * width,)).reshape(len(rows), -1, width)


def _numbers(path: Path, rows: list[list[str]], widths: tuple[int, ...]) -> Array:
    """The rows as numbers, all with as many, which has to be one of ``widths``."""
    width = len(rows[0]) if len(rows[0]) in widths else widths[0]
    for number, row in enumerate(rows, start=1):
        if len(row) != width:
            raise FileFormatError(f"{path}: row {number} has {len(row)} numbers: expected {width} numbers")
    try:
        return np.array(rows, dtype=float)
    except ValueError as error:
        raise FileFormatError(f"{path}: {error}: expected numbers") from error
