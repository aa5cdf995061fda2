"""The MATLAB file of ``full_body_16imu``, as the qmt toolbox writes it: a struct a sensor, and a shared time t.

What ``quat`` means is not said in the file, so the gyroscope decides: either it turns as the sensor does, or it is the
orientation of the body segment, and then the constant rotation between the two is the sensor's mounting.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.errors import FileFormatError
from vip_factors.geometry.quaternions import Order
from vip_factors.geometry.rotations import Array, angle_between, log, nearest_rotation, transpose
from vip_factors.io.importers.shared import (
    GRAVITY,
    ImportedLog,
    default_sites,
    merge_notes,
    rotations_or_nan,
    tilt_of_up,
    z_up,
)
from vip_factors.sensors.calibration import (
    CARELESS_MOUNTING_SIGMA,
    STRAPPED_MOUNTING_SIGMA,
    Placement,
    SensorSite,
    sensor_site,
)
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.recording import DEFAULT_STATURE_M

FORMAT = "qmt_mat"
OWN_ANGLE_DEG = 10.0  # a quaternion of the sensor itself agrees with its gyroscope within a degree or two
EXPLAINED = 0.7  # share of the turning that a constant mounting must explain; 0.86–0.99 in the example of 16 sensors
SEGMENT_TILT_DEG = 15.0  # and with it, specific force must point up about as well as soft tissue lets it

# Segment axes of qmt's body models → bone axes (x left, y up, z forward in the T-pose). Trunk, head, legs: x forward,
# y up, z right. Arms: y towards the shoulder, x to the palm's side, which is down in the T-pose.
_R_BONE_SEGMENT = {
    "middle": np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]]),
    "left_arm": np.array([[0.0, -1, 0], [-1, 0, 0], [0, 0, -1]]),
    "right_arm": np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]),
}
_ARM_BONES = ("shoulder", "elbow", "wrist")


@dataclass(frozen=True)
class _Sensor:
    stream: ImuStream
    R_segment_sensor: Array | None  # where quat turned out to be the segment's


def read(path: Path) -> ImportedLog:
    """Read a file. Sensors whose ``quat`` is not their own orientation come back without one, but with a mounting.

    Raises:
        FileFormatError: for other files, or fields of unequal length.
    """
    content = _load(path)
    if "t" not in content:
        raise FileFormatError(f"{path}: no variable 't' with the times of the samples")
    time = np.atleast_1d(_floats(path, "t", content["t"])).ravel()
    structs = {name: value for name, value in content.items() if hasattr(value, "acc")}
    if not structs:
        raise FileFormatError(f"{path}: no struct with a field 'acc'; variables: {', '.join(content) or 'none'}")
    notes: list[str] = []
    sensors = {name: _sensor(path, name, value, time, notes) for name, value in structs.items()}
    sites = default_sites(list(sensors))
    placed = [_place(name, sensor, sites.get(name)) for name, sensor in sensors.items()]
    placement = Placement(tuple(site for site in placed if site is not None), FORMAT)
    mounted = [name for name, sensor in sensors.items() if sensor.R_segment_sensor is not None]
    if mounted:
        notes.append(
            f"{path.name}: quat of {len(mounted)} of {len(sensors)} sensors turns as the body segment does, not as the "
            "sensor: the rotation between them is used as mounting, and orientation comes from acc and gyr"
        )
    streams = {name: sensor.stream for name, sensor in sensors.items()}
    return ImportedLog(FORMAT, streams, sites, placement if placement.sites else None, notes=merge_notes(notes))


def _load(path: Path) -> dict[str, Any]:
    from scipy.io import loadmat

    try:
        content = loadmat(path, squeeze_me=True, struct_as_record=False)
    except Exception as error:  # whatever its parsing comes upon
        raise FileFormatError(f"{path}: not a MATLAB file saved with '-v7' ({error})") from error
    return {name: value for name, value in content.items() if not name.startswith("__")}


def _sensor(path: Path, name: str, struct: Any, time: Array, notes: list[str]) -> _Sensor:
    def field(label: str, width: int) -> Array | None:
        values = getattr(struct, label, None)
        if values is None or np.size(values) == 0:
            return None
        values = _floats(path, f"{name}.{label}", values)
        if values.shape != (len(time), width):
            raise FileFormatError(f"{path}: {name}.{label} has shape {values.shape}: expected ({len(time)}, {width})")
        return values

    force, rate, quaternion = field("acc", 3), field("gyr", 3), field("quat", 4)
    if force is not None and 0.8 < np.nanmedian(np.linalg.norm(force, axis=1)) < 1.2:
        force = GRAVITY * force
        notes.append(f"{name}: acc is in g; turned into m/s²")
    R = mounting = None
    if quaternion is not None:
        R = rotations_or_nan(quaternion, Order.WXYZ, f"{path}, sensor '{name}'", notes)
        if rate is not None and force is not None:
            R, mounting = _own_or_segment(name, R, force, rate, time, notes)
        if R is not None and force is not None:
            R, turned = z_up(name, R, force)
            notes += turned
    return _Sensor(ImuStream.from_samples(name, time - time[0], force, R, rate), mounting)


def _floats(path: Path, where: str, values: Any) -> Array:
    try:
        return np.asarray(values, dtype=float)
    except (ValueError, TypeError) as error:
        raise FileFormatError(f"{path}: {where}: expected numbers ({error})") from error


def _own_or_segment(
    name: str, R: Array, force: Array, rate: Array, time: Array, notes: list[str]
) -> tuple[Array | None, Array | None]:
    """R_inertial_sensor if the quaternions are the sensor's own, and R_segment_sensor if they are its segment's."""
    good = np.all(np.isfinite(np.column_stack([R.reshape(-1, 9), force, rate])), axis=1)
    pairs = np.flatnonzero(good[:-1] & good[1:] & (np.diff(time) > 0))
    if len(pairs) < 10:
        return R, None
    turned = log(transpose(R[pairs]) @ R[pairs + 1]) / np.diff(time)[pairs, None]
    with np.errstate(over="ignore", invalid="ignore"):
        measured = (rate[pairs] + rate[pairs + 1]) / 2
        agreement = turned.T @ measured
    if not np.all(np.isfinite(agreement)):
        notes.append(f"{name}: gyr holds numbers that no gyroscope measures: nothing tells whose quat is; left out")
        return None, None
    mounting = nearest_rotation(agreement)
    total = float(np.sum(turned**2))
    explained = 1 - float(np.sum((turned - measured @ mounting.T) ** 2)) / total if total > 0 else 0.0
    if explained < EXPLAINED:
        if tilt_of_up(R, force) < SEGMENT_TILT_DEG:  # too still to tell by turning, but gravity agrees
            return R, None
        notes.append(f"{name}: quat fits neither the gyroscope nor gravity: left out")
        return None, None
    if np.rad2deg(angle_between(np.eye(3), mounting)) < OWN_ANGLE_DEG:
        return R, None
    if tilt_of_up(R @ mounting, force) < SEGMENT_TILT_DEG:
        return None, mounting
    notes.append(f"{name}: quat turns with the gyroscope but gravity does not fit it: left out")
    return None, None


def _place(name: str, sensor: _Sensor, site: str | None) -> SensorSite | None:
    """The sensor's site if its mounting is known or no named site fits (a sensor on the back of the thorax)."""
    skeleton = skeleton_from_stature(DEFAULT_STATURE_M)
    if name == "upper_back":
        chest = sensor_site("sternum", skeleton, name)
        behind = chest.p_bone_sensor * np.array([1.0, 1.0, -1.0])
        strapped = sensor_site("lower_back", skeleton, name).R_bone_sensor
        found = SensorSite(name, "spine3", behind, strapped, STRAPPED_MOUNTING_SIGMA)
    elif site is not None and sensor.R_segment_sensor is not None:
        found = sensor_site(site, skeleton, name)
    else:
        return None
    if sensor.R_segment_sensor is None:
        return found
    side, _, joint = found.bone.partition("_")
    kind = f"{side}_arm" if joint in _ARM_BONES else "middle"
    R_bone_sensor = _R_BONE_SEGMENT[kind] @ sensor.R_segment_sensor
    return SensorSite(name, found.bone, found.p_bone_sensor, R_bone_sensor, CARELESS_MOUNTING_SIGMA)
