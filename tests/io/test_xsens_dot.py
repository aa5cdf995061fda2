"""Xsens DOT exports: a clock in microseconds that wraps, free acceleration, sites from the names of the files."""

from pathlib import Path

import numpy as np
import pytest

from vip_factors.errors import FileFormatError
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import Array, exp
from vip_factors.io.importers.shared import site_of_name
from vip_factors.io.importers.xsens import DOT, MTW

PREAMBLE = (
    "sep=,\nDeviceTag:,abc\nFirmwareVersion:,2.0.0\nSyncStatus:,Synced\nOutputRate:,60Hz\n"
    "Measurement Mode:,Sensor fusion Mode - Extended(Quaternion)\n"
    "StartTime: ,2021-08-20_20:21:13_{ms} GMT+8\n© Xsens Technologies\n\n"
)
STEP_US = 16667


def write(path: Path, R: Array, free: Array, clock_us: Array, ms: int = 839, kind: str = "quaternion") -> Path:
    names = ["PacketCounter", "SampleTimeFine"]
    if kind == "quaternion":
        names += ["Quat_W", "Quat_X", "Quat_Y", "Quat_Z"]
        orientation = quaternion_from_matrix(R, Order.WXYZ)
    else:
        names += ["Euler_X", "Euler_Y", "Euler_Z"]
        roll, yaw = np.arctan2(R[:, 2, 1], R[:, 2, 2]), np.arctan2(R[:, 1, 0], R[:, 0, 0])
        orientation = np.rad2deg(np.stack([roll, -np.arcsin(R[:, 2, 0]), yaw], axis=1))
    names += ["FreeAcc_X", "FreeAcc_Y", "FreeAcc_Z", "Gyr_X", "Gyr_Y", "Gyr_Z", "Status"]
    rows = [
        ",".join([str(i + 1), str(clock), *(f"{v:.6f}" for v in (*orientation[i], *free[i], 90.0, 0.0, 0.0)), "0"])
        for i, clock in enumerate(clock_us)
    ]
    text = PREAMBLE.format(ms=ms) + "\n".join([",".join(names), *rows])
    path.write_text(text, encoding="utf-8")
    return path


def sample(count: int) -> tuple[Array, Array]:
    R = exp(np.array([0.3, -0.2, 1.0])) @ exp(0.02 * np.arange(count)[:, None] * np.array([1.0, 0.5, 0.2]))
    return R, np.tile([0.4, -0.3, 0.2], (count, 1))


@pytest.mark.parametrize("kind", ["quaternion", "euler"])
def test_one_clock_over_its_wrap(tmp_path: Path, kind: str) -> None:
    R, free = sample(20)
    begin = 2**32 - 5 * STEP_US
    write(tmp_path / "Pelvis_20210820_202113_836.csv", R, free, (begin + STEP_US * np.arange(20)) % 2**32, 836, kind)
    later = (begin + STEP_US * (np.arange(20) + 7)) % 2**32
    write(tmp_path / "RTibia_20210820_202114_001.csv", R, free, later, 839, kind)
    assert DOT.matches(tmp_path)
    log = DOT.read(tmp_path)
    np.testing.assert_allclose(log.imus["RTibia"].time, STEP_US * 1e-6 * (np.arange(20) + 7), atol=1e-9)
    assert log.imus["Pelvis"].time[0] == 0
    np.testing.assert_allclose(log.imus["Pelvis"].R_inertial_sensor, R, atol=1e-5)
    np.testing.assert_allclose(
        np.einsum("nij,nj->ni", R, log.imus["Pelvis"].specific_force), free + np.array([0, 0, 9.80665]), atol=1e-4
    )
    np.testing.assert_allclose(log.imus["Pelvis"].angular_rate[:, 0], np.pi / 2, atol=1e-6)
    assert log.default_sites == {"Pelvis": "pelvis", "RTibia": "right_shank"}
    assert log.start_ns == 1629462073836 * 10**6


def test_clocks_never_set_together_fall_back_to_counters(tmp_path: Path) -> None:
    R, free = sample(5)
    write(tmp_path / "A_20210820_202113_836.csv", R, free, 1000 + STEP_US * np.arange(5))
    write(tmp_path / "B_20210820_202113_836.csv", R, free, 4 * 10**9 // 2 + STEP_US * np.arange(5))
    log = DOT.read(tmp_path)
    np.testing.assert_allclose(log.imus["B"].time, np.arange(5) / 60)
    assert any("not set together" in note for note in log.notes)


def test_two_files_of_one_sensor_are_an_error(tmp_path: Path) -> None:
    R, free = sample(5)
    for second in (13, 50):
        write(tmp_path / f"Pelvis_20210820_2021{second}_836.csv", R, free, STEP_US * np.arange(5))
    with pytest.raises(FileFormatError, match="both of sensor 'Pelvis'"):
        DOT.read(tmp_path)


@pytest.mark.parametrize(
    ("name", "site"),
    [
        ("LFemur", "left_thigh"), ("RTibia", "right_shank"), ("Pelvis", "pelvis"), ("femur_r_imu", "right_thigh"),
        ("calcn_l_imu", "left_foot"), ("torso_imu", "sternum"), ("humerus_r_imu", "right_upper_arm"),
        ("radius_l", "left_forearm"), ("Right Ankle", "right_ankle"), ("upper_arm_left", "left_upper_arm"),
        ("hip", "pelvis"), ("lower_back", "lower_back"), ("L_LowArm", "left_forearm"), ("Lumbar", "lower_back"),
        ("upper_back", "upper_back"), ("belly_imu", "belly"), ("LeftHandBack", "left_hand"),
        ("toes_l_imu_offset", "left_foot"), ("Upper", None), ("00B40B91", None), ("Left", None),
        ("LeftUpperLeg", "left_thigh"),
    ],
)  # fmt: skip
def test_names_tell_sites(name: str, site: str | None) -> None:
    assert site_of_name(name) == site


@pytest.mark.data
def test_real_recording_of_five_sensors(data_folder: Path) -> None:
    log = DOT.read(data_folder / "xsens_dot" / "Original_XsensDot_Data_Realtime")
    counts = {name: len(stream) for name, stream in log.imus.items()}
    assert counts == {"LFemur": 195, "LTibia": 381, "Pelvis": 382, "RFemur": 381, "RTibia": 382}
    for stream in log.imus.values():
        rest = stream.cut(0, 0.5)
        np.testing.assert_allclose(np.linalg.norm(rest.specific_force, axis=1).mean(), 9.81, atol=0.15)
    assert set(log.default_sites.values()) == {"left_thigh", "left_shank", "pelvis", "right_thigh", "right_shank"}


@pytest.mark.data
def test_converted_recording_is_read_and_distrusted(data_folder: Path) -> None:
    folder = data_folder / "xsens_dot" / "Transformed_XsensDot_Data_RealTime"
    assert not DOT.matches(folder)
    log = MTW.read(folder)
    assert len(log.imus["Pelvis"]) == 382
    assert log.imus["Pelvis"].rate == pytest.approx(60, abs=0.1)
    assert any("gravity had been removed" in note for note in log.notes)
