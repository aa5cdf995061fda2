"""A log of any make: first guesses of its columns and sensors' places, and a recording made with them as they are."""

from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import assert_one_sentence
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import Array, exp
from vip_factors.io.mcap_recording import read_scene

SENSORS = ("LF", "RS", "TR")


def motion(count: int = 150, rate: float = 50.0) -> tuple[Array, Array, Array, Array]:
    """Time, orientation, specific force and angular rate of somebody who moves gently."""
    time = np.arange(count) / rate
    R = exp(np.stack([0.4 * np.sin(3 * time), 0.3 * np.cos(2 * time), 0.2 * time], axis=1))
    rate_rads = np.stack([1.2 * np.cos(3 * time), -0.6 * np.sin(2 * time), np.full(count, 0.2)], axis=1)
    return time, R, np.einsum("nji,j->ni", R, [0, 0, 9.81]), rate_rads


def write_raw(path: Path, force_unit: float, rate_unit: float, names: str = "{0}_{1}_{2}") -> Path:
    time, _, force, rate = motion()
    columns = {"time_ms": 1000 * time}
    for sensor in SENSORS:
        for quantity, values in (("acc", force / force_unit), ("gyr", rate / rate_unit)):
            columns.update({names.format(sensor, quantity, axis): values[:, i] for i, axis in enumerate("xyz")})
    lines = [",".join(columns)]
    lines += [",".join(f"{one:.5f}" for one in row) for row in np.stack(list(columns.values()), axis=1)]
    path.write_text("\r\n".join(lines) + "\r\n", encoding="utf-8-sig")
    return path


@pytest.mark.parametrize("units", [(1.0, 1.0), (9.80665, np.pi / 180), (9.80665e-3, 1.0)])
@pytest.mark.parametrize("names", ["{0}_{1}_{2}", "{1}_{0}_{2}", "{0} {1} {2} (raw)", "{0}.{1}[{2}]"])
def test_a_recording_from_guesses_left_as_they_are(run, tmp_path: Path, units: tuple[float, float], names: str) -> None:
    log = write_raw(tmp_path / "log.csv", *units, names)
    told = run("convert", log, "--template", tmp_path / "guess.toml")
    assert told.code == 0, told.err
    columns, placement = tmp_path / "guess_columns.toml", tmp_path / "guess_placement.toml"
    assert f"--columns {columns} --placement {placement}" in told.out
    told = run("convert", log, tmp_path / "a.mcap", "--columns", columns, "--placement", placement)
    assert told.code == 0, told.err
    recording = read_scene(tmp_path / "a.mcap").wearers[0]
    bones = {site.sensor: site.bone for site in recording.placement.sites}
    assert bones == {"LF": "left_ankle", "RS": "right_knee", "TR": "spine3"}
    _, _, force, rate = motion()
    for stream in recording.imus.values():
        assert stream.rate == pytest.approx(50)
        np.testing.assert_allclose(stream.specific_force, force, atol=0.02)
        np.testing.assert_allclose(stream.angular_rate, rate, atol=0.02)


def test_orientations_are_read_as_gravity_has_them(run, tmp_path: Path) -> None:
    time, R, force, _ = motion()
    quaternions = quaternion_from_matrix(np.swapaxes(R, 1, 2), Order.XYZW)  # from world to sensor, w last
    folder = tmp_path / "log"
    folder.mkdir()
    for sensor in ("pelvis", "thigh_l"):
        rows = np.column_stack([time, force, quaternions])
        header = "Timestamp;AccX;AccY;AccZ;q1;q2;q3;q4"
        lines = [header, *(";".join(f"{one:.6f}".replace(".", ",") for one in row) for row in rows)]
        (folder / f"{sensor}.csv").write_text("\n".join(lines) + "\n")
    assert run("convert", folder, "--template", tmp_path / "g").code == 0
    text = (tmp_path / "g_columns.toml").read_text()
    assert 'quaternion_order = "xyzw"' in text
    assert 'quaternion_sense = "world_to_sensor"' in text
    options = ("--columns", tmp_path / "g_columns.toml", "--placement", tmp_path / "g_placement.toml")
    told = run("convert", folder, tmp_path / "a.mcap", *options)
    assert told.code == 0, told.err
    recording = read_scene(tmp_path / "a.mcap").wearers[0]
    assert recording.placed == ["pelvis", "thigh_l"]
    for stream in recording.imus.values():
        np.testing.assert_allclose(stream.R_inertial_sensor, R, atol=1e-5)


def test_a_known_format_gets_a_placement_alone(run, tmp_path: Path) -> None:
    log = tmp_path / "a.sto"
    rows = [f"{i / 50}\t1,0,0,0\t1,0,0,0" for i in range(9)]
    log.write_text("\n".join(["DataType=Quaternion", "endheader", "time\tpelvis_imu\tS7", *rows]) + "\n")
    assert run("convert", log, "--template", tmp_path / "g").code == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.sto", "g_placement.toml"]
    text = (tmp_path / "g_placement.toml").read_text()
    assert '"pelvis_imu" = "pelvis"' in text
    assert '# "S7"' in text
    assert run("convert", log, tmp_path / "a.mcap", "--placement", tmp_path / "g_placement.toml").code == 0
    told = run("convert", tmp_path / "a.mcap", "--template", tmp_path / "h")
    assert told.code == 2
    assert "already" in told.err


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a,b\n1,2\n3,4\n", "no column's name tells acceleration, angular rate or orientation (log.csv: a, b)"),
        ("hello\n", "holds no row of two numbers or more"),
        ("acc_x,acc_y\n1,2\n3,4\n", "expected names such as pelvis_acc_x"),
    ],
)
def test_nothing_to_guess(run, tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "log.csv").write_text(text)
    told = run("convert", tmp_path / "log.csv", "--template", tmp_path / "g")
    assert (told.code, told.err.count("\n")) == (2, 1)
    assert words in told.err
    assert [path.name for path in tmp_path.iterdir()] == ["log.csv"]


def test_existing_files_are_kept_and_one_thing_is_asked_at_a_time(run, tmp_path: Path) -> None:
    log = write_raw(tmp_path / "log.csv", 1.0, 1.0)
    (tmp_path / "g_placement.toml").write_text("precious")
    told = run("convert", log, "--template", tmp_path / "g")
    assert (told.code, (tmp_path / "g_placement.toml").read_text()) == (2, "precious")
    assert not (tmp_path / "g_columns.toml").exists()
    assert "leave one of them out" in run("convert", log, tmp_path / "a.mcap", "--template", tmp_path / "h").err
    assert "no RECORDING.mcap" in run("convert", log).err


def spoiled(log: Path, row: int, column: int, cell: str) -> None:
    lines = log.read_text(encoding="utf-8-sig").splitlines()
    cells = lines[row].split(",")
    cells[column] = cell
    log.write_text("\n".join([*lines[:row], ",".join(cells), *lines[row + 1 :]]) + "\n")


@pytest.mark.parametrize("column", [1, 4], ids=["acceleration", "angular rate"])
@pytest.mark.parametrize("cell", ["1e300", "-1e300", "1e20", "1e6"])
def test_a_number_that_no_sensor_measures_costs_its_sample_only(run, tmp_path: Path, column: int, cell: str) -> None:
    log = write_raw(tmp_path / "log.csv", 1.0, 1.0)
    spoiled(log, 70, column, cell)
    told = run("convert", log, "--template", tmp_path / "guess.toml")
    assert (told.code, "encountered" in told.err) == (0, False), told.err
    maps = "--columns", tmp_path / "guess_columns.toml", "--placement", tmp_path / "guess_placement.toml"
    told = run("convert", log, tmp_path / "a.mcap", *maps)
    assert (told.code, "encountered" in told.err) == (0, False), told.err
    recording = read_scene(tmp_path / "a.mcap").wearers[0]
    told = run("info", tmp_path / "a.mcap")
    assert "impossible ones, dropped" in told.out or "more than 400 m/s² in 1 samples: interpolated" in told.out
    assert [len(stream) for stream in recording.imus.values()][1:] == [150, 150]
    for stream in recording.imus.values():
        assert stream.specific_force is not None
        assert np.abs(stream.specific_force).max() < 20


@pytest.mark.parametrize("pause_s", [5, 600])
def test_a_pause_of_a_raw_log_is_the_reason_that_is_given(run, tmp_path: Path, pause_s: int) -> None:
    log = write_raw(tmp_path / "log.csv", 1.0, 1.0)
    for row in range(71, 151):
        spoiled(log, row, 0, f"{20 * (row - 1) + 1000 * pause_s}")
    assert run("convert", log, "--template", tmp_path / "guess.toml").code == 0
    maps = "--columns", tmp_path / "guess_columns.toml", "--placement", tmp_path / "guess_placement.toml"
    told = run("convert", log, tmp_path / "a.mcap", *maps)
    assert_one_sentence(told, f"lost {pause_s + 0.02:.2f} s of samples", "--end-s 1.38")
    told = run("convert", log, tmp_path / "a.mcap", *maps, "--end-s", "1.38")
    assert told.code == 0, told.err


def test_what_nobody_declared_is_printed(run, tmp_path: Path) -> None:
    log = write_raw(tmp_path / "log.csv", 1.0, 1.0)
    log.write_text(log.read_text(encoding="utf-8-sig").replace("TR_", "thing_"))
    told = run("convert", log, "--template", tmp_path / "guess.toml")
    assert "note: no mounting is declared: LF, RS have the default axes of their sites" in told.err
    assert "note: no site is declared for thing" in told.err


def test_a_table_of_one_sample_is_refused(run, tmp_path: Path) -> None:
    log = tmp_path / "pelvis.csv"
    log.write_text("time,acc_x,acc_y,acc_z,gyr_x,gyr_y,gyr_z\n0.0,0,0,9.81,0,0,0\n")
    told = run("convert", log, "--template", tmp_path / "guess")
    assert_one_sentence(told, "pelvis.csv: one sample: expected at least two")
    assert list(tmp_path.iterdir()) == [log]
