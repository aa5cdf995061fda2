"""APDM csv exports in both layouts, units, a frame whose z may point down; OpenSense's quaternions."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from table_samples import GRAVITY, STO_HEADER, turning, write_format7, write_named, write_quaternions

from vip_factors.errors import FileFormatError
from vip_factors.geometry.rotations import Array, exp
from vip_factors.io.importers.maker_tables import APDM, OPENSENSE
from vip_factors.io.importers.shared import mean_force_inertial

R_DOWN = np.diag([1.0, -1.0, -1.0])


def test_format_7(tmp_path: Path) -> None:
    sensors = {"Lumbar": turning(seed=1, hertz=128.0), "Right Ankle": turning(seed=2, hertz=128.0)}
    path = write_format7(tmp_path / "log.csv", sensors)
    assert APDM.matches(path)
    assert APDM.matches(tmp_path)
    log = APDM.read(path)
    assert log.start_ns == 1550879504438281000
    assert log.default_sites == {"Lumbar": "lower_back", "Right Ankle": "right_ankle"}
    for name, (R, force, rate) in sensors.items():
        np.testing.assert_allclose(log.imus[name].time, np.arange(6) / 128, atol=1e-6)
        np.testing.assert_allclose(log.imus[name].R_inertial_sensor, R, atol=1e-5)
        np.testing.assert_allclose(log.imus[name].specific_force, force, atol=1e-5)
        np.testing.assert_allclose(log.imus[name].angular_rate, rate, atol=1e-5)


def test_named_columns_and_other_units(tmp_path: Path) -> None:
    R, force, rate = turning(seed=3, hertz=128.0)
    path = write_named(tmp_path / "log.csv", {"Chest": (R, force / 9.80665, np.rad2deg(rate))}, ("g", "deg/s"))
    assert APDM.matches(path)
    stream = APDM.read(path).imus["Chest"]
    np.testing.assert_allclose(stream.specific_force, force, atol=1e-6)
    np.testing.assert_allclose(stream.angular_rate, rate, atol=1e-6)
    np.testing.assert_allclose(stream.time, np.arange(6) / 128, atol=1e-8)


def test_a_frame_with_z_down_is_turned_over(tmp_path: Path) -> None:
    R, force, rate = turning(seed=4, hertz=128.0)
    log = APDM.read(write_named(tmp_path / "log.csv", {"Chest": (R_DOWN @ R, force, rate)}, ("m/s^2", "rad/s")))
    np.testing.assert_allclose(log.imus["Chest"].R_inertial_sensor, R, atol=1e-6)
    assert any("z down" in note for note in log.notes)


def test_orientation_that_gravity_contradicts_is_told(tmp_path: Path) -> None:
    R, force, rate = turning(seed=5, hertz=128.0)
    sideways = exp(np.array([np.pi / 2, 0, 0]))
    log = APDM.read(write_named(tmp_path / "log.csv", {"Chest": (sideways @ R, force, rate)}, ("m/s^2", "rad/s")))
    assert any("90° off" in note for note in log.notes)


def test_broken_files(tmp_path: Path) -> None:
    path = write_format7(tmp_path / "log.csv", {"Lumbar": turning(seed=1, hertz=128.0)})
    whole = path.read_text()
    path.write_text(whole[:-60])
    log = APDM.read(path)
    assert len(log.imus["Lumbar"]) == 5
    assert any("breaks off" in note for note in log.notes)
    path.write_text("\n".join(whole.splitlines()[:3]) + "\n")
    with pytest.raises(FileFormatError, match="no samples"):
        APDM.read(path)
    lines = whole.splitlines()
    lines[3] = lines[3].replace(",", ",red", 1)
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(FileFormatError, match=r"line 4: column 'Lumbar/acceleration/X' is 'red.*expected a number"):
        APDM.read(path)
    path.write_text("a,b\n1,2\n")
    assert not APDM.matches(path)
    with pytest.raises(FileFormatError, match="found none"):
        APDM.read(path)


@pytest.mark.data
def test_real_exports(data_folder: Path) -> None:
    folder = data_folder / "opensense" / "reader_fixtures" / "APDM"
    pendulum = APDM.read(folder / "imuData01.csv")
    assert {name: len(stream) for name, stream in pendulum.imus.items()} == dict.fromkeys(
        ("Static", "Upper", "Middle", "Lower"), 1024
    )
    assert pendulum.imus["Static"].rate == pytest.approx(128)
    for stream in pendulum.imus.values():
        rest = stream.cut(0, 1)
        assert np.linalg.norm(rest.specific_force, axis=1).mean() == pytest.approx(9.8, abs=0.15)
        force = mean_force_inertial(rest.R_inertial_sensor, rest.specific_force)
        np.testing.assert_allclose(force, GRAVITY, atol=0.3)
    assert not pendulum.notes
    body = APDM.read(folder / "apdm_format7.csv")
    assert list(body.imus) == ["Lumbar", "Right Ankle", "Left Ankle", "Left Foot", "Chest", "Right Foot"]
    assert all(len(stream) == 3 for stream in body.imus.values())


def rotations(count: int, sensors: int, seed: int = 0) -> Array:
    return exp(np.random.default_rng(seed).normal(size=(count, sensors, 3)))


@given(count=st.integers(1, 20), seed=st.integers(0, 1000), blank_first=st.booleans())
def test_reads_back(tmp_path_factory: pytest.TempPathFactory, count: int, seed: int, blank_first: bool) -> None:
    R = rotations(count, 2, seed)
    header = "\n" + STO_HEADER if blank_first else STO_HEADER
    path = write_quaternions(tmp_path_factory.mktemp("sto") / "a.sto", R, ["torso_imu", "tibia_r_imu"], header=header)
    assert OPENSENSE.matches(path)
    log = OPENSENSE.read(path)
    np.testing.assert_allclose(log.imus["tibia_r_imu"].R_inertial_sensor, R[:, 1], atol=1e-12)
    np.testing.assert_allclose(log.imus["torso_imu"].time, np.arange(count) / 100, atol=1e-9)
    assert log.imus["torso_imu"].specific_force is None
    assert log.default_sites == {"torso_imu": "sternum", "tibia_r_imu": "right_shank"}
    assert any("z up" in note for note in log.notes)


def test_blank_cells_are_gaps_of_that_sensor(tmp_path: Path) -> None:
    path = write_quaternions(tmp_path / "a.sto", rotations(4, 2), ["a", "b"])
    lines = path.read_text().splitlines()
    lines[-3] = "\t".join([*lines[-3].split("\t")[:2], ""])
    lines[-2] = "\t".join([*lines[-2].split("\t")[:2], "nan,nan,nan,nan"])
    path.write_text("\n".join(lines) + "\n")
    log = OPENSENSE.read(path)
    assert len(log.imus["a"]) == 4
    assert len(log.imus["b"]) == 2


def test_broken_tables(tmp_path: Path) -> None:
    path = write_quaternions(tmp_path / "a.sto", rotations(4, 2), ["a", "b"])
    whole = path.read_text()
    path.write_text(whole[:-50])
    log = OPENSENSE.read(path)
    assert len(log.imus["a"]) == 3
    assert any("breaks off" in note for note in log.notes)
    path.write_text(whole.replace("678.01\t", "678.01\tx"))
    with pytest.raises(FileFormatError, match="line 8: column 'a_w' is 'x"):
        OPENSENSE.read(path)
    path.write_text(STO_HEADER + "time\ta\n")
    with pytest.raises(FileFormatError, match="no rows"):
        OPENSENSE.read(path)
    path.write_text(whole.replace("DataType=Quaternion", "DataType=double"))
    assert not OPENSENSE.matches(path)
