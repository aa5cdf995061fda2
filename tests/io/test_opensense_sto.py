"""OpenSense quaternion tables."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vip_factors.errors import FileFormatError
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import Array, exp
from vip_factors.io.importers.maker_tables import OPENSENSE

HEADER = "DataRate=100.000000\nDataType=Quaternion\nversion=3\nOpenSimVersion=4.1\nendheader\n"


def write(
    path: Path, R: Array, names: list[str], start: float = 678.0, rate: float = 100.0, header: str = HEADER
) -> Path:
    """Rotations ``(T, sensors, 3, 3)`` as a table."""
    lines = ["\t".join(["time", *names])]
    for row, quaternions in enumerate(quaternion_from_matrix(R, Order.WXYZ)):
        lines.append("\t".join([repr(start + row / rate), *(",".join(map(repr, map(float, q))) for q in quaternions)]))
    path.write_text(header + "\n".join(lines) + "\n")
    return path


def rotations(count: int, sensors: int, seed: int = 0) -> Array:
    return exp(np.random.default_rng(seed).normal(size=(count, sensors, 3)))


@given(count=st.integers(1, 20), seed=st.integers(0, 1000), blank_first=st.booleans())
def test_reads_back(tmp_path_factory: pytest.TempPathFactory, count: int, seed: int, blank_first: bool) -> None:
    R = rotations(count, 2, seed)
    header = "\n" + HEADER if blank_first else HEADER
    path = write(tmp_path_factory.mktemp("sto") / "a.sto", R, ["torso_imu", "tibia_r_imu"], header=header)
    assert OPENSENSE.matches(path)
    log = OPENSENSE.read(path)
    np.testing.assert_allclose(log.imus["tibia_r_imu"].R_inertial_sensor, R[:, 1], atol=1e-12)
    np.testing.assert_allclose(log.imus["torso_imu"].time, np.arange(count) / 100, atol=1e-9)
    assert log.imus["torso_imu"].specific_force is None
    assert log.default_sites == {"torso_imu": "sternum", "tibia_r_imu": "right_shank"}
    assert any("z up" in note for note in log.notes)


def test_blank_cells_are_gaps_of_that_sensor(tmp_path: Path) -> None:
    path = write(tmp_path / "a.sto", rotations(4, 2), ["a", "b"])
    lines = path.read_text().splitlines()
    lines[-3] = "\t".join([*lines[-3].split("\t")[:2], ""])
    lines[-2] = "\t".join([*lines[-2].split("\t")[:2], "nan,nan,nan,nan"])
    path.write_text("\n".join(lines) + "\n")
    log = OPENSENSE.read(path)
    assert len(log.imus["a"]) == 4
    assert len(log.imus["b"]) == 2


def test_broken_tables(tmp_path: Path) -> None:
    path = write(tmp_path / "a.sto", rotations(4, 2), ["a", "b"])
    whole = path.read_text()
    path.write_text(whole[:-50])
    log = OPENSENSE.read(path)
    assert len(log.imus["a"]) == 3
    assert any("breaks off" in note for note in log.notes)
    path.write_text(whole.replace("678.01\t", "678.01\tx"))
    with pytest.raises(FileFormatError, match="line 8: column 'a_w' is 'x"):
        OPENSENSE.read(path)
    path.write_text(HEADER + "time\ta\n")
    with pytest.raises(FileFormatError, match="no rows"):
        OPENSENSE.read(path)
    path.write_text(whole.replace("DataType=Quaternion", "DataType=double"))
    assert not OPENSENSE.matches(path)


def test_times_win_over_the_stated_rate(tmp_path: Path) -> None:
    log = OPENSENSE.read(write(tmp_path / "a.sto", rotations(5, 1), ["a"], rate=60.0))
    assert log.imus["a"].rate == pytest.approx(60)
    assert any("100 Hz" in note and "60.00 Hz" in note for note in log.notes)


@pytest.mark.data
def test_real_tables(data_folder: Path) -> None:
    log = OPENSENSE.read(data_folder / "opensense" / "S07" / "S07_IMU" / "imu_walking_25s.sto")
    assert len(log.imus) == 8
    assert all(len(stream) == 1501 for stream in log.imus.values())
    assert log.imus["pelvis_imu"].time[-1] == pytest.approx(15)
    assert set(log.default_sites.values()) == {
        "sternum", "pelvis", "right_shank", "right_thigh", "left_shank", "left_thigh", "right_foot", "left_foot",
    }  # fmt: skip
    for path in sorted((data_folder / "opensense" / "opensense_tests").glob("*.sto")):
        assert OPENSENSE.matches(path), path.name
        assert len(OPENSENSE.read(path).imus) >= 7, path.name
