"""The MATLAB file of ``full_body_16imu``, as the qmt toolbox writes it: a struct a sensor, and a shared time t.

What ``quat`` means is not said in the file, so the gyroscope decides: either it turns as the sensor does, or it is the
orientation of the body segment, and then the constant rotation between the two is the sensor's mounting.
"""

from pathlib import Path
from typing import Any

import numpy as np

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.errors import FileFormatError
from vip_factors.geometry.quaternions import Order, matrix_from_quaternion
from vip_factors.geometry.rotations import Array, angle_between, log, nearest_rotation, transpose
from vip_factors.io.importers.shared import ImportedLog, default_sites, z_up
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
# Segment axes of qmt's body models → bone axes (x left, y up, z forward in the T-pose). Trunk, head, legs: x forward,
# y up, z right. Arms: y towards the shoulder, x to the palm's side, which is down in the T-pose.
_R_BONE_SEGMENT = {
    "middle": np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]]),
    "left_arm": np.array([[0.0, -1, 0], [-1, 0, 0], [0, 0, -1]]),
    "right_arm": np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]),
}
_ARM_BONES = ("shoulder", "elbow", "wrist")


def read(path: Path) -> ImportedLog:
    """Read a file. Sensors whose ``quat`` is not their own orientation come back without one, but with a mounting.

    Raises:
        FileFormatError: for a file without such structs.
    """
    from scipy.io import loadmat

    content = loadmat(path, squeeze_me=True, struct_as_record=False)
    structs = {name: value for name, value in content.items() if hasattr(value, "acc")}
    if "t" not in content or not structs:
        raise FileFormatError(f"{path}: no variable 't' or no struct with a field 'acc'; expected qmt's example data")
    sites, skeleton = default_sites(list(structs)), skeleton_from_stature(DEFAULT_STATURE_M)
    streams, placed = dict[str, ImuStream](), list[SensorSite]()
    for name, struct in structs.items():
        streams[name], R_segment_sensor = _sensor(name, struct, content["t"] - content["t"][0])
        site = None if name not in sites else sensor_site(sites[name], skeleton, name)
        if name == "upper_back":  # on the back of the thorax, which no named site is
            chest, strapped = sensor_site("sternum", skeleton, name), sensor_site("lower_back", skeleton, name)
            behind = chest.p_bone_sensor * np.array([1.0, 1.0, -1.0])
            site = SensorSite(name, "spine3", behind, strapped.R_bone_sensor, STRAPPED_MOUNTING_SIGMA)
        if site is not None and R_segment_sensor is not None:
            side, _, joint = site.bone.partition("_")
            R_bone_segment = _R_BONE_SEGMENT[f"{side}_arm" if joint in _ARM_BONES else "middle"]
            R_bone_sensor = R_bone_segment @ R_segment_sensor
            site = SensorSite(name, site.bone, site.p_bone_sensor, R_bone_sensor, CARELESS_MOUNTING_SIGMA)
        if site is not None and (R_segment_sensor is not None or name == "upper_back"):
            placed.append(site)
    return ImportedLog(FORMAT, streams, sites, Placement(tuple(placed), FORMAT) if placed else None)


def _sensor(name: str, struct: Any, time: Array) -> tuple[ImuStream, Array | None]:
    """The stream, and ``R_segment_sensor`` where ``quat`` turns as the segment does."""
    force, rate = np.asarray(struct.acc, float), np.asarray(struct.gyr, float)
    R = matrix_from_quaternion(np.asarray(struct.quat, float), Order.WXYZ)
    turned = log(transpose(R[:-1]) @ R[1:]) / np.diff(time)[:, None]
    mounting = nearest_rotation(turned.T @ ((rate[:-1] + rate[1:]) / 2))
    own = np.rad2deg(angle_between(np.eye(3), mounting)) < OWN_ANGLE_DEG
    R_inertial_sensor = z_up(name, R, force)[0] if own else None
    return ImuStream.from_samples(name, time, force, R_inertial_sensor, rate), None if own else mounting
