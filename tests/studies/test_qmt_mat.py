"""MATLAB recordings of qmt: whose orientation ``quat`` is must be found out from the gyroscope."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from tests.studies import qmt_mat
from vip_factors.errors import FileFormatError
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import Array, angle_between, exp, log, mean_rotation, rotation_z, transpose
from vip_factors.sensors.imu_stream import with_orientation

RATE = 100.0
GRAVITY = np.array([0.0, 0.0, 9.81])


def turning(count: int = 400) -> Array:
    """A sensor that rocks about all axes."""
    t = np.arange(count) / RATE
    angles = np.stack([np.sin(3 * t), 0.7 * np.sin(2 * t + 1), 0.5 * np.sin(4 * t + 2)], axis=1)
    return exp(np.array([0.2, 0.5, -0.3])) @ exp(angles)


def struct_of(R: Array, R_segment_sensor: Array | None = None) -> dict[str, Array]:
    """acc, gyr and quat of a sensor at R; quat of the segment where a mounting is given."""
    rate = log(transpose(R[:-1]) @ R[1:]) * RATE
    rate = np.concatenate([rate[:1], (rate[:-1] + rate[1:]) / 2, rate[-1:]])
    told = R if R_segment_sensor is None else R @ transpose(R_segment_sensor)
    quaternion = quaternion_from_matrix(told, Order.WXYZ)
    return {"acc": np.einsum("nji,j->ni", R, GRAVITY), "gyr": rate, "quat": quaternion}


def write(path: Path, **sensors: dict[str, Array]) -> Path:
    savemat(path, {"t": 40 + np.arange(400) / RATE, **sensors})
    return path


@pytest.mark.parametrize("mounted", [False, True])
def test_quat_is_the_sensors_own_or_its_segments(tmp_path: Path, mounted: bool) -> None:
    R, mounting = turning(), exp(np.array([0.4, -1.0, 0.9]))
    struct = struct_of(R, mounting if mounted else None)
    imported = qmt_mat.read(write(tmp_path / "a.mat", hip=struct, upper_back=struct_of(R)))
    if mounted:
        assert imported.imus["hip"].R_inertial_sensor is None
        found = imported.placement.site("hip").R_bone_sensor
        expected = np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]]) @ mounting
        assert np.rad2deg(angle_between(found, expected)) < 2.0
    else:
        np.testing.assert_allclose(imported.imus["hip"].R_inertial_sensor, R, atol=1e-9)
    site = imported.placement.site("upper_back")
    assert site.bone == "spine3"
    assert site.p_bone_sensor[2] < 0  # behind
    savemat(tmp_path / "a.mat", {"t": np.arange(4.0)})
    with pytest.raises(FileFormatError, match="no struct"):
        qmt_mat.read(tmp_path / "a.mat")


@pytest.mark.data
def test_real_full_body_stands_upright(data_folder: Path) -> None:
    imported = qmt_mat.read(data_folder / "full_body_16imu" / "full_body_example_data.mat")
    assert len(imported.imus) == 16
    assert all(len(stream) == 10000 for stream in imported.imus.values())
    assert imported.placement is not None
    assert len(imported.placement.sites) == 16
    for site in imported.placement.sites:
        stream = imported.imus[site.sensor].cut(0, 3)  # standing, arms hanging
        force = stream.specific_force.mean(axis=0)
        assert np.linalg.norm(force) == pytest.approx(9.95, abs=0.25)
        up = site.R_bone_sensor @ force / np.linalg.norm(force)
        arm = {"left": -1.0, "right": 1.0}.get(site.bone.split("_")[0], 0.0)
        hangs = any(joint in site.bone for joint in ("shoulder", "elbow", "wrist"))
        expected = np.array([arm, 0, 0]) if hangs else np.array([0, 1.0, 0])
        limit = 30 if hangs else 20  # degrees; arms hang with bent elbows and loose wrists
        assert np.rad2deg(np.arccos(up @ expected)) < limit, site.sensor


@pytest.mark.data
def test_real_mountings_make_the_trunk_face_one_way(data_folder: Path) -> None:
    imported = qmt_mat.read(data_folder / "full_body_16imu" / "full_body_example_data.mat")
    # Hand-tuned headings in degrees, published with the data, good to some 15° each.
    tuned = {"hip": 0.0, "upper_back": 15.0, "foot_right": -150.0, "upper_arm_right": 60.0, "forearm_left": -95.0}
    for sensor, heading in tuned.items():
        stream = with_orientation(imported.imus[sensor].cut(0, 3))
        R_bone_sensor = imported.placement.site(sensor).R_bone_sensor
        R_world_bone = rotation_z(np.deg2rad(heading)) @ stream.R_inertial_sensor @ R_bone_sensor.T
        forward = mean_rotation(R_world_bone)[:, 2]
        assert abs(np.rad2deg(np.arctan2(forward[1], forward[0]))) < 35, sensor
