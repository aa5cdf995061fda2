"""DIP-IMU (Huang et al. 2018): pickles with 17 calibrated sensors and SMPL poses at 60 Hz.

The published orientations are calibrated already: they are those of SMPL's bones but for the calibration's error, so
the mountings are near the identity. Accelerations are global and without gravity. The global frame has its y up, as
SMPL's body has; where poses are given, the wearer's mean upright direction says whether that is so.
"""

import mmap
from pathlib import Path

import numpy as np

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import JOINT_COUNT
from vip_factors.errors import FileFormatError
from vip_factors.geometry.quaternions import interpolate_rotations
from vip_factors.geometry.rotations import Array, angle_between, exp, nearest_rotation, rotation_x
from vip_factors.io.imported import ImportedLog
from vip_factors.io.importers.numpy_pickle import load_plain_pickle
from vip_factors.sensors.calibration import CARELESS_MOUNTING_SIGMA, Placement, SensorSite, place
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.recording import DEFAULT_STATURE_M

FORMAT = "dip-imu"

RATE = 60.0  # Hz
GRAVITY = np.array([0.0, 0.0, 9.81])
ROUNDING = 0.05  # of RᵀR from the identity: rounded and smoothed matrices stay below, others were no rotations
ALIGNED_DEG = 45.0  # a mounting further from the identity was never calibrated

# The sensors in the file's order, with the places where Xsens suits carry them.
SENSOR_SITES = {
    "head": "head", "spine2": "sternum", "belly": "pelvis",
    "lchest": "left_shoulder", "rchest": "right_shoulder", "lshoulder": "left_upper_arm",
    "rshoulder": "right_upper_arm", "lelbow": "left_forearm", "relbow": "right_forearm", "lhip": "left_thigh",
    "rhip": "right_thigh", "lknee": "left_shank", "rknee": "right_shank", "lwrist": "left_hand",
    "rwrist": "right_hand", "lankle": "left_foot", "rankle": "right_foot",
}  # fmt: skip


def matches(path: Path) -> bool:
    """Whether the file is a pickle that names the arrays of DIP-IMU; nothing is unpickled."""
    if not path.is_file() or path.stat().st_size < 16:
        return False
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        looks_pickled = content[:1] == b"\x80" or content[:2] in (b"(d", b"}q")
        return looks_pickled and content.find(b"imu_ori") >= 0 and content.find(b"imu_acc") >= 0


def read(path: Path) -> ImportedLog:
    """The sensors, and the SMPL poses as motion; samples with NaN become gaps.

    Raises:
        FileFormatError: if the pickle holds anything but arrays, or not the arrays of DIP-IMU.
        RecordingError: if no sensor has a usable sample.
    """
    orientation, acceleration, poses = _arrays(path)
    R_z_up, up_note = _z_up(poses)
    notes = [up_note]
    time = np.arange(len(orientation)) / RATE
    R_inertial_sensor = R_z_up @ _rotations(path, orientation)
    force = np.einsum("tsji,tsj->tsi", R_inertial_sensor, acceleration @ R_z_up.T + GRAVITY)
    imus = {}
    for row, name in enumerate(SENSOR_SITES):
        lost = ~np.all(np.isfinite(R_inertial_sensor[:, row]), axis=(1, 2)) | ~np.all(
            np.isfinite(force[:, row]), axis=1
        )
        if np.all(lost):
            notes.append(f"sensor {name} has no finite sample and is left out")
            continue
        if np.any(lost):
            notes.append(f"sensor {name}: {np.count_nonzero(lost)} of {len(lost)} samples are not finite: gaps")
        imus[name] = ImuStream.from_samples(name, time, force[:, row], R_inertial_sensor[:, row])
    truth = _motion(poses, R_z_up, notes)
    placement = _placement(imus, truth, notes)
    sites = {name: SENSOR_SITES[name] for name in imus}
    return ImportedLog(FORMAT, imus, sites, placement, truth, notes=tuple(notes))


def _arrays(path: Path) -> tuple[Array, Array, Array | None]:
    content = load_plain_pickle(path)
    keys = sorted(str(key) for key in content) if isinstance(content, dict) else [type(content).__name__]
    if not {"imu_ori", "imu_acc"} <= set(keys):
        raise FileFormatError(f"{path}: holds {', '.join(keys)}: expected imu_ori, imu_acc and gt of DIP-IMU")
    found: dict[str, Array] = {}
    for name, tail in (("imu_ori", (17, 3, 3)), ("imu_acc", (17, 3)), ("gt", (3 * JOINT_COUNT,))):
        if name not in content:
            continue
        try:
            found[name] = np.asarray(content[name], dtype=float)
        except (TypeError, ValueError) as error:
            raise FileFormatError(f"{path}: {name} is no array of numbers") from error
        if found[name].shape[1:] != tail:
            expected = ", ".join(map(str, tail))
            raise FileFormatError(f"{path}: {name} has shape {found[name].shape}: expected (frames, {expected})")
    lengths = {name: len(values) for name, values in found.items()}
    if len(set(lengths.values())) > 1 or 0 in lengths.values():
        said = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise FileFormatError(f"{path}: frames differ or are none: {said}: expected one length")
    return found["imu_ori"], found["imu_acc"], found.get("gt")


def _rotations(path: Path, matrices: Array) -> Array:
    """The matrices cleaned of rounding; rows with NaN stay so."""
    finite = np.all(np.isfinite(matrices), axis=(-1, -2))
    M = np.clip(matrices[finite], -2, 2)  # no rotation is changed by that, and no product overflows
    wrong = np.abs(np.swapaxes(M, -1, -2) @ M - np.eye(3)).max(axis=(-1, -2)) > ROUNDING
    wrong |= np.linalg.det(M) < 0
    if np.any(wrong):
        frame, sensor = np.argwhere(finite)[np.flatnonzero(wrong)[0]]
        name = list(SENSOR_SITES)[sensor]
        raise FileFormatError(f"{path}: imu_ori of {name} in frame {frame} is not a rotation matrix")
    R = np.full_like(matrices, np.nan)
    R[finite] = nearest_rotation(M) if len(M) else M
    return R


def _z_up(poses: Array | None) -> tuple[Array, str]:
    """The turn that puts the file's vertical onto z."""
    if poses is None:
        return rotation_x(np.pi / 2), "no poses in the file: its y axis is taken for the vertical"
    root = exp(poses[np.all(np.isfinite(poses[:, :3]), axis=1), :3])
    upright = root[:, :, 1].mean(axis=0) if len(root) else np.array([0.0, 1.0, 0.0])
    if upright[2] > upright[1]:
        return np.eye(3), "the wearer stands along the file's z axis: taken for the vertical"
    return rotation_x(np.pi / 2), "the wearer stands along the file's y axis, which becomes z"


def _motion(poses: Array | None, R_z_up: Array, notes: list[str]) -> Motion | None:
    if poses is None:
        return None
    good = np.all(np.isfinite(poses), axis=1)
    if not np.any(good):
        notes.append("no pose is finite: no motion")
        return None
    if not np.all(good):
        notes.append(f"{np.count_nonzero(~good)} of {len(good)} poses are not finite and were interpolated")
    R = exp(poses[good].reshape(-1, JOINT_COUNT, 3))
    if not np.all(good):
        frames = np.arange(len(good), dtype=float)
        columns = [interpolate_rotations(frames[good], R[:, joint], frames) for joint in range(JOINT_COUNT)]
        R = np.stack(columns, axis=1)
    R[:, 0] = R_z_up @ R[:, 0]
    skeleton = skeleton_from_stature(DEFAULT_STATURE_M)
    heel = skeleton.landmarks["left_heel"]
    floor = skeleton.p_pelvis_joint[heel.bone, 1] + heel.p_bone_point[1]
    notes.append("DIP-IMU tells neither where the wearer walked nor how tall they are: the pelvis keeps its place")
    return Motion(skeleton, R, np.tile([0.0, 0.0, -floor], (len(R), 1)), RATE, name="DIP-IMU SMPL poses")


def _placement(imus: dict[str, ImuStream], truth: Motion | None, notes: list[str]) -> Placement | None:
    """Sensors turned as their bones are; none, if the poses contradict that."""
    skeleton = truth.skeleton if truth else skeleton_from_stature(DEFAULT_STATURE_M)
    sites, angles = [], {}
    for name, stream in imus.items():
        usual = place(SENSOR_SITES[name], skeleton, name)
        sites.append(SensorSite(name, usual.bone, usual.p_bone_sensor, np.eye(3), CARELESS_MOUNTING_SIGMA))
        if truth is not None and stream.R_inertial_sensor is not None:
            R_world_bone = truth.state.R_world_bone[np.round(stream.time * RATE).astype(int), usual.bone_index]
            angles[name] = float(np.rad2deg(np.median(angle_between(R_world_bone, stream.R_inertial_sensor))))
    if angles:
        worst = max(angles, key=lambda name: angles[name])
        middle = float(np.median(list(angles.values())))
        notes.append(f"sensors lie {middle:.0f}° (median) from their bones, {worst} {angles[worst]:.0f}°")
        if middle > ALIGNED_DEG:
            notes.append("these orientations are not calibrated to the bones: no mounting is given")
            return None
    return Placement(tuple(sites), FORMAT)
