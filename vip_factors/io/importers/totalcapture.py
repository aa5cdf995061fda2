"""TotalCapture (Trumble et al. 2017): 13 Xsens sensors at 60 Hz with Vicon's skeleton as the truth.

A sequence is a ``.sensors`` file with its calibration (``calib_imu_bone.txt``, ``calib_imu_ref.txt``) and truth
(``gt_skel_gbl_pos.txt``, ``gt_skel_gbl_ori.txt``) beside it; their names may have prefixes. By the dataset's readme
``R_vicon_bone = R_ref · R_inertial_sensor · R_bone⁻¹``, so that ``R_bone`` is the sensor's mounting.
"""

from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from vip_factors.body.kinematics import Motion
from vip_factors.body.lengths import stature_of
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.quaternions import Order, matrix_from_quaternion
from vip_factors.geometry.rotations import Array, angle_between, transpose
from vip_factors.io.imported import ImportedLog
from vip_factors.io.importers.inertial_frame import z_up
from vip_factors.io.importers.totalcapture_body import BONE_JOINTS, RATE, OpticalBody, optical_body
from vip_factors.io.importers.totalcapture_files import (
    SensorTable,
    companion,
    is_sensors_file,
    read_calibration,
    read_sensors,
    read_truth,
    sensors_file,
)
from vip_factors.sensors.calibration import SITES, Placement, SensorSite, place
from vip_factors.sensors.imu_stream import ImuStream

FORMAT = "totalcapture"

Align = Literal["head", "tail"]
Rows = NDArray[np.intp]
# The published mountings leave bones 2–7° from the optical ones: soft tissue, mostly.
MOUNTING_SIGMA = np.deg2rad(7.0)

SENSOR_SITES = {"Head": "head", "Sternum": "sternum", "Pelvis": "pelvis"} | {
    f"{side[0]}_{name}": f"{side.lower()}_{site}"
    for side in ("Left", "Right")
    for name, site in {
        "UpArm": "upper_arm", "LowArm": "forearm", "UpLeg": "thigh", "LowLeg": "shank", "Foot": "foot",
    }.items()
}  # fmt: skip


def matches(path: Path) -> bool:
    """Whether the path is a ``.sensors`` file by its first lines, or a folder that holds one."""
    if path.is_dir():
        return any(is_sensors_file(file) for file in path.glob("*.sensors"))
    return is_sensors_file(path)


def read(path: Path, align: Align = "head") -> ImportedLog:
    """The sensors, the published mountings, and the optical motion.

    Args:
        path: a ``.sensors`` file, or a folder with one sequence.
        align: whether the first (``"head"``) or the last (``"tail"``) frames of sensors and truth are simultaneous
            where their numbers differ; the notes say how well either fits.

    Raises:
        FileFormatError: if a file is not of the form, naming the line.
        InputError: for an unknown ``align``.
    """
    if align not in get_args(Align):
        raise InputError(f"align '{align}': expected {' or '.join(get_args(Align))}")
    file = sensors_file(path)
    table = read_sensors(file)
    notes = [table.truncated] if table.truncated else []
    R_inertial_sensor = _orientations(file, table)
    imus = _streams(table, R_inertial_sensor, notes)
    body = _body(file, notes)
    truth, placement = None, None
    if body is not None:
        notes += body.notes
        notes.append(f"our joints lie {body.joint_error_m * 1000:.1f} mm from the optical skeleton's")
        shift = _shift(table, body, R_inertial_sensor, align, notes)
        first = body.motion
        truth = Motion(
            first.skeleton, first.R_parent_child, first.p_world_pelvis, RATE, first.start - shift / RATE, first.name
        )
        placement = _placement(file, table, body, R_inertial_sensor, shift, notes)
    return ImportedLog(
        format=FORMAT,
        imus=imus,
        default_sites={name: SENSOR_SITES[name] for name in imus if name in SENSOR_SITES},
        placement=placement,
        truth_motion=truth,
        stature_m=None if truth is None else stature_of(truth.skeleton),
        notes=tuple(notes),
    )


def _orientations(file: Path, table: SensorTable) -> Array:
    """``(N, S, 3, 3)``, NaN where a quaternion is all zeros: how the exports write a lost sample."""
    q = table.values[..., :4]
    lost = ~(np.linalg.norm(q, axis=-1) > 0)
    try:
        R = matrix_from_quaternion(np.where(lost[..., None], [1.0, 0, 0, 0], q), Order.WXYZ)
    except InputError as error:
        raise FileFormatError(f"{file}: frame and sensor {error}") from error
    R[lost] = np.nan
    return R


def _streams(table: SensorTable, R_inertial_sensor: Array, notes: list[str]) -> dict[str, ImuStream]:
    time = (table.index - 1) / RATE
    imus = {}
    for k, name in enumerate(table.names):
        force = table.values[:, k, 4:7]
        rate = table.values[:, k, 7:10] if table.values.shape[-1] > 7 else None
        R, odd = z_up(name, R_inertial_sensor[:, k], force)
        notes += odd
        imus[name] = ImuStream.from_samples(name, time, force, R, rate)
    return imus


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
        return optical_body(names, p, q[:, [names_too.index(name) for name in names]])
    except InputError as error:
        raise FileFormatError(f"{orientations}: {error}") from error


def _paired(table: SensorTable, body: OpticalBody, shift: int) -> tuple[Rows, Rows]:
    """Rows of the sensor table and of the kept truth frames that are simultaneous."""
    frames = table.index.astype(int) - 1 + shift - body.first_frame
    rows = np.flatnonzero((frames >= 0) & (frames < len(body.motion)))
    return rows, frames[rows]


def _shift(table: SensorTable, body: OpticalBody, R_inertial_sensor: Array, align: Align, notes: list[str]) -> int:
    """Truth frame at the sensors' first frame, and a note on how well sensors and bones turn together either way."""
    truth_frames = body.first_frame + len(body.motion)
    shifts = {"head": 0, "tail": truth_frames - int(table.index[-1])}
    if shifts["tail"] == 0:
        notes.append("sensors and truth have the same number of frames")
    said = ", ".join(
        f"{name} {_turning_residual(table, body, R_inertial_sensor, shift):.2f} rad/s" for name, shift in shifts.items()
    )
    notes.append(f"aligned at the {align}; turning speeds of sensors and bones differ by (root mean square) {said}")
    return shifts[align]


def _turning_residual(table: SensorTable, body: OpticalBody, R_inertial_sensor: Array, shift: int) -> float:
    """Difference of turning speeds in rad/s, which neither heading nor mounting changes."""
    rows, frames = _paired(table, body, shift)
    next_too = np.flatnonzero(np.diff(frames) == 1)
    differences = []
    for k, name in enumerate(table.names):
        if name not in SENSOR_SITES:
            continue
        R_bone = body.R_vicon_joint[:, body.names.index(_joint_of(name))]
        a, b = next_too, next_too + 1
        sensor = angle_between(R_inertial_sensor[rows[a], k], R_inertial_sensor[rows[b], k])
        differences.append((sensor - angle_between(R_bone[frames[a]], R_bone[frames[b]])) * RATE)
    everything = np.concatenate(differences) if differences else np.zeros(0)
    everything = everything[np.isfinite(everything)]
    return float(np.sqrt(np.mean(everything**2))) if len(everything) else float("nan")


def _joint_of(sensor: str) -> str:
    return BONE_JOINTS[SITES[SENSOR_SITES[sensor]].bone]


def _placement(
    file: Path, table: SensorTable, body: OpticalBody, R_inertial_sensor: Array, shift: int, notes: list[str]
) -> Placement | None:
    bone_file, ref_file = companion(file, "bone"), companion(file, "ref")
    if bone_file is None:
        notes.append("no mountings: calib_imu_bone.txt is not beside the sensors")
        return None
    R_joint_sensor = read_calibration(bone_file)
    R_vicon_inertial = read_calibration(ref_file) if ref_file else {}
    rows, frames = _paired(table, body, shift)
    sites, angles = [], []
    for k, name in enumerate(table.names):
        if name not in SENSOR_SITES or name not in R_joint_sensor:
            continue
        usual = place(SENSOR_SITES[name], body.motion.skeleton, name)
        R_bone_sensor = body.R_joint_bone.T @ R_joint_sensor[name]
        sites.append(SensorSite(name, usual.bone, usual.p_bone_sensor, R_bone_sensor, MOUNTING_SIGMA))
        if name in R_vicon_inertial:
            R_vicon_joint = body.R_vicon_joint[frames, body.names.index(_joint_of(name))]
            found = R_vicon_inertial[name] @ R_inertial_sensor[rows, k] @ transpose(R_joint_sensor[name])
            angles.append(angle_between(R_vicon_joint, found))
    if angles:
        middle = np.rad2deg(np.nanmedian(np.concatenate(angles)))
        notes.append(f"calibrated sensors turn their bones {middle:.1f}° (median) from the optical ones")
    return Placement(tuple(sites), FORMAT)
