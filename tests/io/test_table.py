"""Tables of any make: what is written comes back, and each mistake is told in one sentence."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from table_samples import SENSORS, Layout, made_up, quantities_of, write_export, write_log

from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import exp
from vip_factors.io.convert import ImportOptions, import_recording, read_log
from vip_factors.io.importers.column_map import ACCELERATION_UNITS, ANGULAR_RATE_UNITS, TIME_UNITS, read_column_map
from vip_factors.io.importers.shared import ImportedLog
from vip_factors.io.importers.text_table import SEPARATORS, Dialect, read_text_table
from vip_factors.io.importers.units import R_UP, best_reading
from vip_factors.sensors.imu_stream import ImuStream

layouts = st.builds(
    Layout,
    separator=st.sampled_from(list(SEPARATORS)),
    ending=st.sampled_from(["\n", "\r\n"]),
    mark=st.booleans(),
    comments=st.integers(0, 3),
    time_unit=st.sampled_from(list(TIME_UNITS)),
    acceleration_unit=st.sampled_from(list(ACCELERATION_UNITS)),
    angular_rate_unit=st.sampled_from(list(ANGULAR_RATE_UNITS)),
    order=st.sampled_from([order.value for order in Order]),
    sense=st.sampled_from(["sensor_to_world", "world_to_sensor"]),
    up=st.sampled_from(list(R_UP)),
    per_sensor=st.booleans(),
    start=st.sampled_from([0.0, -3.5, 1.7e9]),
)


@settings(max_examples=30)
@given(layout=layouts, seed=st.integers(0, 100))
def test_what_is_written_comes_back(tmp_path_factory: pytest.TempPathFactory, layout: Layout, seed: int) -> None:
    streams = made_up(seed)
    log, columns = write_log(tmp_path_factory.mktemp("table"), streams, layout)
    found = read_log(log, columns=columns)
    assert list(found.imus) == list(SENSORS)
    for name, stream in streams.items():
        one = found.imus[name]
        np.testing.assert_allclose(one.time, stream.time, atol=1e-6)
        np.testing.assert_allclose(one.specific_force, stream.specific_force, atol=1e-9)
        np.testing.assert_allclose(one.angular_rate, stream.angular_rate, atol=1e-9)
        np.testing.assert_allclose(one.R_inertial_sensor, stream.R_inertial_sensor, atol=1e-9)
    assert found.start_ns == pytest.approx(1.7e18 if layout.start > 1e9 else 0, abs=1000)
    assert found.default_sites == {"pelvis": "pelvis", "left shank": "left_shank"}


@settings(max_examples=20)
@given(layout=layouts, seed=st.integers(0, 20))
def test_the_reading_that_points_gravity_upward_is_found(layout: Layout, seed: int) -> None:
    stream = made_up(seed)["pelvis"]
    numbers = quantities_of(stream, layout)
    reading, off = best_reading(numbers["quaternion"], numbers["acceleration"])
    assert reading == (layout.order, layout.sense, layout.up)
    assert off < 10


@pytest.fixture
def log(tmp_path: Path) -> tuple[Path, Path]:
    return write_log(tmp_path / "log", made_up(1), Layout())


def edited(columns: Path, old: str, new: str) -> Path:
    text = columns.read_text(encoding="utf-8")
    assert old in text
    columns.write_text(text.replace(old, new), encoding="utf-8")
    return columns


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ('time = "t"', 'tiem = "t"', "unknown key 'tiem'; did you mean 'time'"),
        ('time = "t"', "", "neither time nor rate_hz is given"),
        ('time = "t"', 'time = "t"\nrate_hz = 50', "both time and rate_hz are given"),
        ('time = "t"', "rate_hz = 0", "expected 1 to 20000 samples a second"),
        ('time = "t"', 'time = "time_s"', "no column 'time_s'"),
        ('time = "t"', "time = 99", "has no column 99: expected 1 to 21"),
        ('time_unit = "s"', 'time_unit = "sec"', "time_unit 'sec'; did you mean 's'"),
        ('"m/s2"', '"mm/s2"', "acceleration_unit 'mm/s2'; did you mean 'm/s2'"),
        ('"m/s2"', '"g"', r"acceleration is 9\.\d+ g long on the median: expected about 1, .*'m/s2' would fit"),
        ("'0_acceleration_0', ", "", "expected a list of 3 columns"),
        ("0_acceleration_0", "0_acceleration_1", "each named once"),
        ("0_acceleration_0", "0_acc_0", "no column '0_acc_0'; did you mean '0_acceleration_0'"),
        ('"wxyz"', '"xyzw"', "quaternion_order 'wxyz' it would be 0° off|acceleration is"),
        ('"wxyz"', '"wxzy"', "quaternion_order 'wxzy'; did you mean 'wxyz'"),
        ('world_up = "z"', 'world_up = "-z"', "with world_up 'z' it would be"),
        ('"sensor_to_world"', '"sensor_world"', "did you mean 'sensor_to_world'"),
        ('file = "log.csv"', 'file = "lag.csv"', "'lag.csv' is not in .*did you mean 'log.csv'"),
        ('[sensors."pelvis"]', "[sensors.a]\n[sensors.pelvis]", "sensor 'a': no columns named"),
        ('[sensors."pelvis"]', 'separator = "dot"\n[sensors.pelvis]', "separator 'dot'.*expected one of tab"),
        ('[sensors."pelvis"]', "header = 900\n[sensors.pelvis]", "no header line 900"),
        ('[sensors."pelvis"]', "sensor_column = 't'\n[sensors.pelvis]", "no row of .* is of sensor 'pelvis'"),
        ('[sensors."pelvis"]', "[sensors.pelvis", "expected a column map"),
        ("acceleration = ['0", "acceleration = ['t', '0", "expected a list of 3"),
    ],
)
def test_each_mistake_in_a_map_is_told(log: tuple[Path, Path], old: str, new: str, match: str) -> None:
    with pytest.raises(InputError, match=match) as caught:
        read_log(log[0], columns=edited(log[1], old, new))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("line", "change", "match"),
    [
        (5, lambda row: row.rsplit(",", 3)[0], "line 5: 18 cells where the header has 21 columns"),
        (5, lambda row: "oops," + row.split(",", 1)[1], "line 5: column 't' is 'oops': expected a number"),
        (5, lambda row: "-1," + row.split(",", 1)[1], "time 't' falls from .* expected it to grow"),
    ],
)
def test_each_mistake_in_a_table_is_told(log: tuple[Path, Path], line: int, change, match: str) -> None:
    lines = log[0].read_text().splitlines()
    lines[line - 1] = change(lines[line - 1])
    log[0].write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError, match=match):
        read_log(log[0], columns=log[1])


def test_blanks_and_a_broken_last_line_cost_their_samples_only(log: tuple[Path, Path]) -> None:
    lines = log[0].read_text().splitlines()
    cells = lines[9].split(",")
    cells[1], cells[2], cells[3] = "", "NaN", "n/a"
    lines[9] = ",".join(cells)
    log[0].write_text("\n".join([*lines, "0.8,1,2"]))
    found = read_log(log[0], columns=log[1])
    assert [len(imu) for imu in found.imus.values()] == [39, 40]
    assert any("1 of 40 samples with missing values" in note for note in found.notes)
    assert any("the last line 42 breaks off" in note for note in found.notes)


def test_a_folder_without_named_sensors_is_a_sensor_a_file(tmp_path: Path) -> None:
    streams = made_up(3)
    for name, stream in streams.items():
        folder = tmp_path / "one"
        write_log(folder, {name: stream}, Layout())
        (tmp_path / f"{name}.csv").write_bytes((folder / "log.csv").read_bytes())
    text = "rate_hz = 50\nacceleration = [2, 3, 4]\nangular_rate = [5, 6, 7]\nquaternion = [8, 9, 10, 11]\n"
    (tmp_path / "map.toml").write_text(text)
    found = read_log(tmp_path, columns=tmp_path / "map.toml")
    assert sorted(found.imus) == sorted(SENSORS)
    np.testing.assert_allclose(found.imus["pelvis"].specific_force, streams["pelvis"].specific_force)


def test_rows_of_all_sensors_in_one_table(tmp_path: Path) -> None:
    streams = made_up(4)
    lines = ["when,who,w,x,y,z"]
    for i in range(40):
        for name, stream in streams.items():
            quaternion = quaternion_from_matrix(stream.R_inertial_sensor[i], Order.WXYZ)
            lines.append(",".join([repr(float(stream.time[i])), name, *(repr(float(q)) for q in quaternion)]))
    (tmp_path / "log.raw").write_text("\n".join(lines))
    (tmp_path / "m.toml").write_text('time = "when"\nsensor_column = "who"\nquaternion = ["w", "x", "y", "z"]\n')
    found = read_log(tmp_path / "log.raw", columns=tmp_path / "m.toml")
    for name, stream in streams.items():
        np.testing.assert_allclose(found.imus[name].R_inertial_sensor, stream.R_inertial_sensor, atol=1e-9)


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("t;a b\n1,5;2\n3;4,25\n", ("t", "a b")),
        ("Device: 7\nFirmware, 1.2\n\ntime,acc x\n1.5,2\n3,4.25\n", ("time", "acc x")),
        ("# logger\n# t, a\n1.5,2\n3,4.25\n", ("t", "a")),
        ("s,s\nx,y\nm,m/s^2\n1.5,2\n3,4.25\n", ("s_x", "s_y")),
        ("left,\nx,y\n1.5,2\n3,4.25\n", ("left_x", "left_y")),
        ("1.5,2\n3,4.25\n", ("1", "2")),
        ('"a, b",c\n"1.5",2\n3,4.25\n', ("a, b", "c")),
        ("a\tb\t\n1.5\t2\t\n3\t4.25\t\n", ("a", "b", "3")),
        ("  a   b\n 1.5   2\n 3  4.25\n", ("a", "b")),
    ],
)
def test_dialects_are_found(tmp_path: Path, text: str, names: tuple[str, ...]) -> None:
    (tmp_path / "a.txt").write_text(text)
    table = read_text_table(tmp_path / "a.txt")
    assert table.names == names
    np.testing.assert_allclose(table.numbers([0, 1]), [[1.5, 2], [3, 4.25]])


def test_a_dialect_that_is_told_wins(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("!no\nx|y\nu|v\n1|2\n")
    assert read_text_table(tmp_path / "a.txt", Dialect("bar", "!", (2,))).names == ("x", "y")


@pytest.mark.parametrize("content", [b"", b"hello\nworld\n", b"\x00\x01\x02", b"PathFileType\t4\n", b"a,b\n"])
@pytest.mark.parametrize("suffix", [".csv", ".sto", ".trc"])
def test_what_is_no_table_is_refused(tmp_path: Path, content: bytes, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    path.write_bytes(content)
    with pytest.raises(InputError, match=f"a{suffix}"):
        read_text_table(path)


def test_opensims_tables_side_by_side_need_no_map(tmp_path: Path) -> None:
    streams = {f"{name}_imu": replace(one, name=f"{name}_imu") for name, one in made_up(5).items()}
    folder = write_export(tmp_path / "export", streams)
    for path in (folder, folder / "walk", folder / "walk_Accel.trc"):
        found = read_log(path)
        assert found.format == "opensim_export"
        for name, stream in streams.items():
            one = found.imus[name]
            np.testing.assert_allclose(one.specific_force, stream.specific_force)
            np.testing.assert_allclose(one.angular_rate, stream.angular_rate)
            np.testing.assert_allclose(one.R_inertial_sensor, stream.R_inertial_sensor, atol=1e-9)
    alone = read_log(folder / "walk_Orientations.sto")
    assert alone.format == "opensense_sto"
    assert any("walk_Accel.trc stands beside it" in note for note in alone.notes)


def test_files_of_one_sensor_that_do_not_belong_together(tmp_path: Path) -> None:
    folder = write_export(tmp_path, made_up(6))
    path = folder / "walk_Gyro.trc"
    path.write_text("\n".join(path.read_text().splitlines()[:20]) + "\n")
    with pytest.raises(InputError, match="are not those of the sensor's other file"):
        read_log(folder)


def jumping_wrist(up: float, standing_s: float, turning: float = 1.0) -> ImuStream:
    """A wrist that feels 24 m/s² on the median while its wearer jumps, after standing still."""
    time = np.arange(600) / 100
    moves = time > standing_s
    angle, pace = np.sin(2 * np.pi * time), 2 * np.pi * np.cos(2 * np.pi * time)
    axis = turning * np.array([0.3, 0.9, 0.2])
    R = exp(np.where(moves, angle, 0.0)[:, None] * axis)
    jumping = 30 * np.stack([np.sin(4 * np.pi * time), np.cos(4 * np.pi * time), np.sin(8 * np.pi * time)], axis=1)
    force = np.einsum("nji,nj->ni", R, np.where(moves[:, None], jumping, 0.0) + np.array([0, 0, up]))
    return ImuStream("pelvis", time, force, R, np.where(moves, pace, 0.0)[:, None] * axis)


def read_wrist(folder: Path, stream: ImuStream, quaternion: bool) -> ImportedLog:
    log, columns = write_log(folder, {"pelvis": stream}, Layout())
    if not quaternion:
        columns.write_text(re.sub("quaternion = .*", "", columns.read_text(encoding="utf-8")), encoding="utf-8")
    return read_log(log, columns=columns)


@pytest.mark.parametrize("quaternion", [True, False])
@pytest.mark.parametrize("standing_s", [0.0, 1.0])
def test_jumps_are_no_fault(tmp_path: Path, quaternion: bool, standing_s: float) -> None:
    """What is added to gravity cancels out over time."""
    stream = read_wrist(tmp_path, jumping_wrist(9.81, standing_s), quaternion).imus["pelvis"]
    assert stream.specific_force is not None
    assert np.quantile(np.linalg.norm(stream.specific_force, axis=1), 0.6) > 20


@pytest.mark.parametrize("quaternion", [True, False])
def test_gravity_that_is_left_out_shows_at_rest(tmp_path: Path, quaternion: bool) -> None:
    still = replace(jumping_wrist(0.0, 1.0), name="pelvis")
    with pytest.raises(FileFormatError, match=r"long at rest.*is gravity left out"):
        read_wrist(tmp_path, still, quaternion)


def test_a_sensor_that_never_rests_is_taken(tmp_path: Path) -> None:
    log = read_wrist(tmp_path, jumping_wrist(0.0, 0.0, turning=3.0), quaternion=False)
    assert list(log.imus) == ["pelvis"]
    assert any("never at rest" in note for note in log.notes)


def test_a_table_needs_its_map(log: tuple[Path, Path]) -> None:
    with pytest.raises(InputError, match=r"\(--columns MAP\.toml\); vip-factors convert LOG --template NAME"):
        read_log(log[0])
    with pytest.raises(InputError, match="needs a column map"):
        import_recording(log[0], ImportOptions(format="table"))
    with pytest.raises(InputError, match="only format 'table' takes one"):
        ImportOptions(format="mvnx", columns=log[1])
    assert read_column_map(log[1]).common.acceleration is None
    assert import_recording(log[0], ImportOptions(columns=log[1])).placed == list(SENSORS)
