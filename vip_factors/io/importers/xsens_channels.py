"""What the columns of an Xsens table mean: orientation, specific force, angular rate, sampling rate."""

from dataclasses import dataclass

import numpy as np

from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.quaternions import UNIT_TOLERANCE, Order, matrix_from_quaternion
from vip_factors.geometry.rotations import Array, nearest_rotation, rotation_x, rotation_y, rotation_z, transpose
from vip_factors.io.importers.sensor_table import SensorTable
from vip_factors.io.importers.shared import GRAVITY, UP, z_up

QUATERNIONS = (
    ("Quat_q0", "Quat_q1", "Quat_q2", "Quat_q3"),
    ("Quat_W", "Quat_X", "Quat_Y", "Quat_Z"),
    ("Quat_w", "Quat_x", "Quat_y", "Quat_z"),
)
MATRIX = tuple(f"Mat[{row}][{column}]" for row in (1, 2, 3) for column in (1, 2, 3))  # by name: any order in the file
EULER = (("Roll", "Pitch", "Yaw"), ("Euler_X", "Euler_Y", "Euler_Z"), ("Euler_x", "Euler_y", "Euler_z"))
ACCELERATION = ("Acc_X", "Acc_Y", "Acc_Z")
FREE_ACCELERATION = (("FreeAcc_X", "FreeAcc_Y", "FreeAcc_Z"), ("FreeAcc_E", "FreeAcc_N", "FreeAcc_U"))
ANGULAR_RATE = ("Gyr_X", "Gyr_Y", "Gyr_Z")

# North-east-down to east-north-up, for exports whose comment says NED.
R_ENU_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
# A worn sensor's specific force averages to about 9.8 m/s² over a file; a mean this short had its gravity removed.
GRAVITY_FREE_MEAN = 3.0
# The same tolerance as for quaternions: a matrix further off is not a rounded rotation but a mistake.
MATRIX_TOLERANCE = 0.05


@dataclass(frozen=True)
class Channels:
    """The samples of one table, in the package's units and frames; rows with NaN were lost."""

    specific_force: Array | None
    R_inertial_sensor: Array | None
    angular_rate: Array | None
    notes: tuple[str, ...]


def channels(table: SensorTable, gyr_unit: float = 1.0) -> Channels:
    """Interpret a table; ``gyr_unit`` is the angular rate's unit in rad/s.

    Raises:
        FileFormatError: if it holds neither orientation nor acceleration, or its orientation is not one.
    """
    R, notes = _orientation(table)
    acceleration = table.group(ACCELERATION)
    free = next((group for names in FREE_ACCELERATION if (group := table.group(names)) is not None), None)
    name = table.path.name
    if acceleration is not None and free is None and _without_gravity(acceleration):
        notes.append(
            f"{name}: gravity had been removed from Acc_*: taken as free acceleration in the inertial frame; without "
            "gravity nothing in this converted file can tell whether its orientation has z up, so prefer the original"
        )
        acceleration, free = None, acceleration
    if acceleration is None and free is not None:
        if R is None:
            notes.append(f"{name}: acceleration without gravity needs an orientation to restore it: left out")
        else:
            acceleration = np.einsum("nji,nj->ni", R, free + GRAVITY * UP)
    elif acceleration is not None and R is not None:
        R, turned = z_up(name, R, acceleration)
        notes += turned
    if R is None and acceleration is None:
        raise FileFormatError(
            f"{table.path}: neither orientation (Quat_*, Mat[*][*], Roll/Pitch/Yaw) nor acceleration (Acc_*) among its "
            f"columns {', '.join(table.header)}: export at least one of them"
        )
    rate = table.group(ANGULAR_RATE)
    return Channels(acceleration, R, None if rate is None else gyr_unit * rate, tuple(notes))


def _without_gravity(acceleration: Array) -> bool:
    return bool(np.linalg.norm(np.nanmean(acceleration, axis=0)) < GRAVITY_FREE_MEAN) and bool(
        np.nanmedian(np.linalg.norm(acceleration, axis=1)) < GRAVITY / 2  # a tumbling sensor also averages to little
    )


def _orientation(table: SensorTable) -> tuple[Array | None, list[str]]:
    """R_inertial_sensor ``(N, 3, 3)`` with z up, NaN where lost, from quaternion, matrix or Euler angles."""
    notes: list[str] = []
    R = None
    for names in QUATERNIONS:
        if (quaternion := table.group(names)) is not None:
            R = rotations_or_nan(quaternion, Order.WXYZ, str(table.path), notes)
            break
    else:
        if (cells := table.group(MATRIX)) is not None:
            R = _matrices_or_nan(cells.reshape(-1, 3, 3), str(table.path), notes)
        else:
            for angles in EULER:
                if (degrees := table.group(angles)) is not None:
                    roll, pitch, yaw = np.deg2rad(degrees).T
                    R = rotation_z(yaw) @ rotation_y(pitch) @ rotation_x(roll)
                    break
    if R is not None and (table.setting(r"coordinate system:\s*(\w+)") or "").upper() == "NED":
        R = R_ENU_NED @ R
        notes.append(f"{table.path.name}: turned from north-east-down to east-north-up")
    return R, notes


def rotations_or_nan(quaternion: Array, order: Order, where: str, notes: list[str]) -> Array:
    """Rotations ``(N, 3, 3)`` of quaternions ``(N, 4)``; NaN where a row is not of unit length.

    Raises:
        FileFormatError: if hardly any row is of unit length.
    """
    length = np.linalg.norm(quaternion, axis=1)
    good = np.abs(length - 1) < UNIT_TOLERANCE
    _complain(good, np.isfinite(length), where, "quaternions are not of unit length", notes)
    R = np.full((len(quaternion), 3, 3), np.nan)
    try:
        R[good] = matrix_from_quaternion(quaternion[good], order)
    except InputError as error:
        raise FileFormatError(f"{where}: {error}") from error
    return R


def _matrices_or_nan(matrices: Array, where: str, notes: list[str]) -> Array:
    finite = np.all(np.isfinite(matrices), axis=(1, 2))
    safe = np.where(finite[:, None, None], matrices, np.eye(3))
    off = np.abs(transpose(safe) @ safe - np.eye(3)).max(axis=(1, 2))
    good = finite & (off < MATRIX_TOLERANCE) & (np.linalg.det(safe) > 0)
    _complain(good, finite, where, "matrices are not rotations", notes)
    R = np.full(matrices.shape, np.nan)
    R[good] = nearest_rotation(matrices[good])
    return R


def _complain(good: np.ndarray, finite: np.ndarray, where: str, what: str, notes: list[str]) -> None:
    bad = int(np.sum(finite & ~good))
    if bad > np.sum(finite) / 2:
        raise FileFormatError(f"{where}: {bad} of {np.sum(finite)} {what}; check the columns and their order")
    if bad:
        notes.append(f"{where}: {bad} samples dropped whose {what}")
