"""Clocks of tables: counters, units of time, dates, shared stamps and the ways in which rows are out of order."""

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from table_samples import turning

import vip_factors as vip
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import Array
from vip_factors.io.convert import ImportOptions, read_log
from vip_factors.io.importers.clocks import column_times, counter_column, stated_rate
from vip_factors.io.importers.column_map import TIME_UNITS
from vip_factors.io.importers.shared import ImportedLog, likely_sites
from vip_factors.io.importers.text_table import read_text_table
from vip_factors.io.importers.units import turning_hz, turning_scale
from vip_factors.sensors.imu_stream import ImuStream

AXES = [f"{quantity}_{axis}" for quantity in ("acc", "gyr") for axis in "xyz"]
MAP = 'acceleration = ["acc_x", "acc_y", "acc_z"]\nangular_rate = ["gyr_x", "gyr_y", "gyr_z"]\n'


def write_table(folder: Path, clocks: dict[str, list[str]], preamble: str = "", name: str = "pelvis.csv") -> Path:
    """A table of a sensor with noise; columns of clocks as they are to be written."""
    count = len(next(iter(clocks.values())))
    _, force, rate = turning(count)
    values = np.column_stack([force, rate]) + np.random.default_rng(0).normal(scale=0.01, size=(count, 6))
    rows = [
        ",".join([*cells, *map("{:.6f}".format, row)]) for *cells, row in zip(*clocks.values(), values, strict=True)
    ]
    (folder / name).write_text(preamble + "\n".join([",".join([*clocks, *AXES]), *rows]) + "\n")
    return folder / name


def read(folder: Path, log: Path, columns: str, rate_hz: float | None = None) -> ImportedLog:
    (folder / "map.toml").write_text(columns + "\n" + MAP)
    return read_log(log, columns=folder / "map.toml", rate_hz=rate_hz)


def texts(values: Array, form: str = "{:.6f}") -> list[str]:
    return [form.format(value) for value in values]


@given(
    modulus=st.sampled_from([2**8, 2**16, 2**32]),
    begin=st.floats(0, 1),
    steps=st.lists(st.sampled_from([1, 1, 1, 1, 2, 3, 9]), min_size=300, max_size=400),
    swapped=st.sets(st.integers(1, 290), max_size=4),
    repeated=st.booleans(),
)
@settings(max_examples=25, deadline=None)
def test_lost_and_late_packets_over_wraps(
    modulus: int, begin: float, steps: list[int], swapped: set[int], repeated: bool
) -> None:
    count = np.concatenate([[0], np.cumsum(steps)])
    order = np.arange(len(count))
    for at in swapped:
        order[[at, at + 1]] = order[[at + 1, at]]
    counter = (int(begin * (modulus - 1)) + count) % modulus
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = write_table(folder, {"PacketCounter": texts(counter, "{:d}")})
        header, *rows = path.read_text().splitlines()
        path.write_text("\n".join([header, *(rows[i] for i in order), *rows[-1:] * repeated]) + "\n")
        log = read(folder, path, 'counter = "PacketCounter"\nrate_hz = 50')
        plain = read(folder, path, "rate_hz = 50")
    stream = log.imus["pelvis"]
    np.testing.assert_allclose(stream.time, count / 50, atol=1e-6)
    np.testing.assert_allclose(plain.imus["pelvis"].time, stream.time)
    assert [float(row.split(",")[1]) for row in rows] == list(stream.specific_force[:, 0])
    lost = int(count[-1] + 1 - len(count))
    assert any(f"{lost} of {count[-1] + 1} packets lost" in note for note in log.notes) == (lost > 0)
    assert any("twice" in note for note in log.notes) == repeated


@pytest.mark.parametrize(
    "name",
    ["PacketCounter", "Packet Counter", "Counter", "Packet number", "packet_no", "SampleNumber", "frame index", "seq",
     "Sequence", "LF_PacketCounter", "Frame", "Index", "No.", "Sample Count", "pkt_id", "packet"],
)  # fmt: skip
def test_counters_by_name(tmp_path: Path, name: str) -> None:
    table = read_text_table(write_table(tmp_path, {name: texts(np.arange(250, 290) % 256, "{:d}")}))
    assert counter_column(table) == 0


@pytest.mark.parametrize("name", ["counterweight", "Temperature", "status", "Battery Number of cells"])
def test_other_columns_are_no_counters(tmp_path: Path, name: str) -> None:
    assert counter_column(read_text_table(write_table(tmp_path, {name: texts(np.arange(40), "{:d}")}))) is None


def test_frames_of_a_slower_camera_are_no_counter(tmp_path: Path) -> None:
    table = read_text_table(write_table(tmp_path, {"Frame": texts(np.arange(40) // 4, "{:d}")}))
    assert counter_column(table) is None


def test_sensors_side_by_side_share_a_clock_and_its_notes(tmp_path: Path) -> None:
    path = write_table(tmp_path, {"Counter": texts(np.delete(np.arange(40), 7), "{:d}")})
    (tmp_path / "map.toml").write_text("rate_hz = 50\n" + "".join(f"[sensors.s{i}]\n{MAP}" for i in range(3)))
    log = read_log(path, columns=tmp_path / "map.toml")
    assert [len(stream) for stream in log.imus.values()] == [39] * 3
    assert [note for note in log.notes if "lost" in note] == ["pelvis.csv: 1 of 40 packets lost"]


def test_several_samples_in_a_packet(tmp_path: Path) -> None:
    packets = np.repeat([0, 1, 2, 4, 5, 6, 7, 8], 4)
    log = read(tmp_path, write_table(tmp_path, {"packet": texts(packets, "{:d}")}), "rate_hz = 100")
    expected = (4 * packets + np.tile(np.arange(4), 8)) / 100
    np.testing.assert_allclose(log.imus["pelvis"].time, expected)


RESTARTS = {
    "at zero": np.r_[0:300, 0:300], "later": np.r_[500:800, 0:300], "of few": np.r_[0:15, 0:300],
    "8 bit": np.r_[0:200, 0:200], "near a wrap": np.r_[65000:65400, 0:300],
}  # fmt: skip


@pytest.mark.parametrize("counter", RESTARTS.values(), ids=RESTARTS)
def test_a_restart_is_decided_by_the_other_clock_or_refused(tmp_path: Path, counter: np.ndarray) -> None:
    time = np.arange(len(counter)) / 100
    line = int(np.flatnonzero(np.diff(counter) < 0)[0]) + 3
    path = write_table(tmp_path, {"Counter": texts(counter, "{:d}"), "time": texts(time)})
    with pytest.raises(FileFormatError, match=rf"pelvis\.csv, line {line}: the packet counter 'Counter' falls from"):
        read(tmp_path, path, 'counter = "Counter"\nrate_hz = 100')
    log = read(tmp_path, path, 'counter = "Counter"\ntime = "time"')
    np.testing.assert_allclose(log.imus["pelvis"].time, time, atol=1e-9)
    assert any(f"line {line}" in note and "'time' goes on and decides" in note for note in log.notes)
    assert not any("twice" in note for note in log.notes)


def test_times_that_begin_again_beside_a_counter_that_goes_on(tmp_path: Path) -> None:
    count = np.delete(np.arange(300), [40, 41, 200])
    time = np.where(count < 150, count, count - 150) / 50
    path = write_table(tmp_path, {"Counter": texts(count, "{:d}"), "time": texts(time)})
    log = read(tmp_path, path, 'time = "time"')
    np.testing.assert_allclose(log.imus["pelvis"].time, count / 50, atol=1e-6)
    assert any("3 of 300 packets lost" in note for note in log.notes)


@pytest.mark.parametrize(("late", "apart"), [(3, False), (500, False), (20_000, True)])
def test_counters_of_several_files(tmp_path: Path, late: int, apart: bool) -> None:
    for name, first in (("pelvis.csv", 65_500), ("left_foot.csv", 65_500 + late)):
        counter = (first + np.arange(600)) % 65_536
        write_table(tmp_path, {"Counter": texts(counter, "{:d}")}, "Sample rate: 100 Hz\n", name)
    log = read(tmp_path, tmp_path, "")
    starts = [log.imus[name].time[0] for name in ("pelvis", "left_foot")]
    assert starts == pytest.approx([0, 0 if apart else late / 100])
    assert any("not set together" in note for note in log.notes) == apart


@pytest.mark.parametrize(
    ("line", "rate"),
    [
        ("Acquisition frequency: 100 Hz", 100), ("// Update Rate: 100.0Hz", 100), ("# Sample rate,128,Hz", 128),
        ("OutputRate:,60Hz", 60), ("Sampling Frequency (Hz): 204.8", 204.8), ("SampleRate=100", 100),
        ("Sampling rate [Hz];148,15", 148.15), ("Frequency: 100 Hz", 100), ("Rate = 1.6 kHz", 1600),
        ("output data rate: 50 Hz", 50), ("samples per second: 100", 100), ("Logging rate\t200\tHz", 200),
        ("Baud rate: 115200", None), ("Magnetometer sample rate: 20 Hz", None), ("Video frame rate: 25 fps", None),
        ("Cut-off frequency: 20 Hz", None), ("Recording date: 2023-05-04", None), ("Sample rate: unknown", None),
    ],
)  # fmt: skip
def test_stated_rates(tmp_path: Path, line: str, rate: float | None) -> None:
    path = write_table(tmp_path, {"Counter": texts(np.arange(20), "{:d}")}, f"Device: 7\n{line}\n")
    assert stated_rate(read_text_table(path)) == rate
    if rate is None:
        with pytest.raises(InputError, match=r"neither time nor rate_hz is given.*--rate-hz"):
            read(tmp_path, path, "")
    assert read(tmp_path, path, "", 40.0).imus["pelvis"].rate == pytest.approx(40)
    assert rate is None or read(tmp_path, path, "").imus["pelvis"].rate == pytest.approx(rate)


CELLS = {
    "iso": ("2023-05-04T23:59:59.9{:02d}", 1683244799.9), "zone": ("2023-05-05 01:59:59.9{:02d}+02:00", 1683244799.9),
    "dots": ("04.05.2023 23:59:59.9{:02d}", 1683244799.9), "american": ("5/14/2023 11:59:59.9{:02d} PM", 1684108799.9),
    "clock": ("10:11:12.5{:02d}", None), "colon": ("10:11:12:5{:02d}", None), "noon": ("12:11:12.5{:02d} am", None),
    "minutes": ("59:12.5{:02d}", None),
}  # fmt: skip


@pytest.mark.parametrize(("form", "start"), CELLS.values(), ids=CELLS)
def test_dates_and_times_of_day(tmp_path: Path, form: str, start: float | None) -> None:
    cells = [form.format(i) for i in range(0, 100, 5)]
    log = read(tmp_path, write_table(tmp_path, {"time": cells}), 'time = "time"')
    np.testing.assert_allclose(log.imus["pelvis"].time, 0.005 * np.arange(20), atol=1e-6)
    assert log.start_ns == pytest.approx(1e9 * (start or 0), abs=1000)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("23:59:59.{:02d}", "00:00:00.{:02d}"), ("2024-02-29 23:59:59.{:02d}", "2024-03-01 00:00:00.{:02d}"),
        ("04/05/2023 23:59:59.{:02d}", "05/05/2023 00:00:00.{:02d}"), ("59:59.{:02d}", "00:00.{:02d}"),
        ("11:59:59.{:02d} PM", "12:00:00.{:02d} AM"), ("05/04/23 23:59:59.{:02d}", "05/05/23 00:00:00.{:02d}"),
    ],
)  # fmt: skip
def test_midnight(tmp_path: Path, before: str, after: str) -> None:
    cells = [form.format(i) for form in (before, after) for i in range(100)]
    log = read(tmp_path, write_table(tmp_path, {"time": cells}), 'time = "time"')
    np.testing.assert_allclose(log.imus["pelvis"].time, np.arange(200) / 100, atol=1e-6)


@pytest.mark.parametrize("start", [0.999999, 45_050.25])
def test_spreadsheet_days(tmp_path: Path, start: float) -> None:
    days = start + np.arange(50) / 100 / 86_400
    cells = texts(days % 1 if start < 1 else days, "{:.11f}")
    log = read(tmp_path, write_table(tmp_path, {"time": cells}), 'time = "time"\ntime_unit = "days"')
    np.testing.assert_allclose(log.imus["pelvis"].time, np.arange(50) / 100, atol=2e-6)
    assert log.start_ns == pytest.approx((45_050.25 - 25_569) * 86_400e9 if start > 1 else 0, abs=1e6)


@pytest.mark.parametrize(
    ("cells", "words"),
    [
        (["10:11:12.1", "10:11:12.2", "then", "10:11:12.4"], "line 4: column 'time' is 'then': expected a time as in"),
        (["2023-15-04 10:11:12.1", "2023-15-04 10:11:12.2"], "is no date"),
        (["1", "1", "1"], "the same time in all rows"),
        (["", "", ""], "holds no time"),
    ],
)
def test_times_that_are_none(tmp_path: Path, cells: list[str], words: str) -> None:
    path = write_table(tmp_path, {"time": cells})
    with pytest.raises(FileFormatError, match=words):
        column_times(read_text_table(path), 0, "s") if "is" in words else read(tmp_path, path, 'time = "time"')


@pytest.mark.parametrize("shared", [2, 3, 10])
@pytest.mark.parametrize("first", [0, 1])
def test_samples_that_share_a_stamp_are_spread(tmp_path: Path, shared: int, first: int) -> None:
    index = first + np.arange(300)
    is_kept = index // shared != 7  # a packet is lost
    stamps = texts((index // shared * shared / 100)[is_kept])
    log = read(tmp_path, write_table(tmp_path, {"time": stamps}), 'time = "time"')
    expected = index[is_kept] / 100
    np.testing.assert_allclose(log.imus["pelvis"].time, expected - expected[0], atol=0.006 if first else 1e-6)
    assert any("share the time in 'time'" in note for note in log.notes)


def test_a_swapped_pair_is_sorted_and_copies_are_dropped(tmp_path: Path) -> None:
    path = write_table(tmp_path, {"time": texts(np.arange(40) / 50)})
    header, *rows = path.read_text().splitlines()
    expected = read(tmp_path, path, 'time = "time"').imus["pelvis"]
    path.write_text("\n".join([header, *rows[:9], rows[10], rows[9], rows[10], *rows[11:], *rows[-1:] * 2]) + "\n")
    log = read(tmp_path, path, 'time = "time"')
    np.testing.assert_array_equal(log.imus["pelvis"].time, expected.time)
    np.testing.assert_array_equal(log.imus["pelvis"].specific_force, expected.specific_force)
    assert any("came late and were sorted" in note for note in log.notes)
    assert any("3 rows that repeat the one before dropped" in note for note in log.notes)


@pytest.mark.parametrize(
    ("unit", "factor", "preamble", "words"),
    [
        ("s", 1e-3, "", "give 0.1 samples a second: expected .* time_unit .*'ms' gives 100"),
        ("s", 86_400.0, "", "give 8.64e.06 samples a second: .*'days' gives 100"),
        ("ms", 1e-4, "Sample rate: 100 Hz\n", "give 10 samples a second, and 100 are stated .*'0.1ms' gives 100"),
        ("ms", 1e-4, "", None),
    ],
)
def test_a_unit_that_gives_no_bodys_rate(
    tmp_path: Path, unit: str, factor: float, preamble: str, words: str | None
) -> None:
    path = write_table(tmp_path, {"t": texts(np.arange(40) / 100 / factor, "{:.12g}")}, preamble)
    columns = f'time = "t"\ntime_unit = "{unit}"'
    if words is not None:
        with pytest.raises(FileFormatError, match=words):
            read(tmp_path, path, columns)
    else:
        assert any("10 samples a second" in note and "'0.1ms'" in note for note in read(tmp_path, path, columns).notes)


@pytest.mark.parametrize(
    ("ticks_hz", "units", "words"),
    [
        (1e3, 'time = "t"\ntime_unit = "ms"', None),
        (32_768.0, 'time = "t"\ntime_unit = "us"', "30.5 .*; ticks of 1/32768 s or rate_hz 100 instead of time"),
        (1e3, 'time = "t"\ntime_unit = "0.1ms"', "10 times .* 1000 samples .*; time_unit 'ms' or rate_hz 100"),
        (1.0, 'time = "t"\nangular_rate_unit = "deg/s"', "57.3 times .*; angular_rate_unit 'rad/s' would fit"),
        (1.0, "rate_hz = 400", "4 times .*; rate_hz 100 would fit"),
        (1.0, "rate_hz = 150", None),
    ],
)
def test_angular_rates_turn_as_far_as_orientations(
    tmp_path: Path, ticks_hz: float, units: str, words: str | None
) -> None:
    count, names = 200, [f"quat_{axis}" for axis in "wxyz"]
    quaternions = quaternion_from_matrix(turning(count)[0], Order.WXYZ).T
    clocks = {"t": texts(np.arange(count) / 100 * ticks_hz)}
    clocks |= {name: texts(values) for name, values in zip(names, quaternions, strict=True)}
    path, columns = write_table(tmp_path, clocks), f"{units}\nquaternion = {names}"
    if words is None:
        assert len(read(tmp_path, path, columns).imus["pelvis"]) == count
    else:
        with pytest.raises(FileFormatError, match=words):
            read(tmp_path, path, columns)


@pytest.mark.parametrize(("ticks_hz", "is_noted"), [(1e6, False), (32_768.0, True)])
def test_nobody_turns_back_and_forth_at_thirty_hertz(tmp_path: Path, ticks_hz: float, is_noted: bool) -> None:
    """Raw samples of a walk at 50 Hz, whose times in microseconds, or ticks, are read as microseconds."""
    imu = vip.simulate("walk", seconds=6.0).wearers[0].imus["left_foot"]
    assert imu.specific_force is not None
    assert imu.angular_rate is not None
    values = np.column_stack([ticks_hz * imu.time, imu.specific_force, imu.angular_rate])[::2]
    rows = [",".join(["t", *AXES]), *(",".join(texts(row)) for row in values)]
    (tmp_path / "left_foot.csv").write_text("\n".join(rows) + "\n")
    notes = read(tmp_path, tmp_path / "left_foot.csv", 'time = "t"\ntime_unit = "us"').notes
    assert any("people's are below 6 Hz: check time_unit" in note for note in notes) == is_noted


def test_sensors_that_hardly_turn_show_no_unit() -> None:
    R = np.tile(np.eye(3), (200, 1, 1))
    still = ImuStream("pelvis", np.arange(200) / 100, None, R, np.full((200, 3), 1e-3))
    assert turning_scale(still) is None
    assert turning_hz(still) is None


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "utf-8-sig"])
def test_encodings(tmp_path: Path, encoding: str) -> None:
    path = write_table(tmp_path, {"time": texts(np.arange(40) / 100)}, "sep=,\n")
    expected = read(tmp_path, path, 'time = "time"').imus["pelvis"]
    path.write_bytes(path.read_text().encode(encoding))
    np.testing.assert_array_equal(read(tmp_path, path, 'time = "time"').imus["pelvis"].time, expected.time)


@pytest.mark.parametrize(
    ("names", "units"),
    [
        ("S1_Time,S1_Accel_X,S1_Gyro_X", "ms,m/(s^2),deg/s"), ("t,a,b", "[s],[m/s²],[rad/s]"),
        ("t,a,b", "mSecs,m/(sec^2),deg/sec"), ("t,a,b", "(s),(mG),(deg/s)"), ("t,a,b", "yyyy/mm/dd hh:mm:ss.000,g,°/s"),
        ("t,a,b", "s,m*s^-2,dps"), ("t,a,b", "µs,no units,%"),
    ],
)  # fmt: skip
def test_a_line_of_units(tmp_path: Path, names: str, units: str) -> None:
    (tmp_path / "a.csv").write_text(f"{names}\n{units}\n" + "".join(f"{i},2,3\n" for i in range(5)))
    table = read_text_table(tmp_path / "a.csv")
    assert (table.names, table.units) == (tuple(names.split(",")), tuple(units.split(",")))


def test_names_with_the_programs_words_tell_sites() -> None:
    names = ["Foot LT", "Foot RT", "Thigh RT", "Pelvis"]
    for start in ("", "Any Program-Segments-", "Any_Pro_Motion_"):
        sites = likely_sites([start + name for name in names])
        assert list(sites.values()) == ["left_foot", "right_foot", "right_thigh", "pelvis"]
        assert list(sites) == [start + name for name in names]
    assert likely_sites(["left_foot", "left_shank"]) == {"left_foot": "left_foot", "left_shank": "left_shank"}


@pytest.mark.parametrize(("modulus", "unit"), [(2**16, "ms"), (2**24, "0.1ms"), (2**32, "us"), (2**32, "0.1ms")])
def test_clocks_that_wrap(tmp_path: Path, modulus: int, unit: str) -> None:
    step = round(0.01 / TIME_UNITS[unit])
    ticks = (modulus - 20 * step + step * np.arange(300)) % modulus
    path = write_table(tmp_path, {"ticks": texts(ticks, "{:d}")})
    log = read(tmp_path, path, f'time = "ticks"\ntime_unit = "{unit}"')
    np.testing.assert_allclose(log.imus["pelvis"].time, np.arange(300) / 100, atol=1e-6)


@pytest.mark.parametrize("rate", [0.0, -5.0, 1e6])
def test_rates_that_no_log_has(rate: float) -> None:
    with pytest.raises(InputError, match="expected 1 to 20000 samples a second"):
        ImportOptions(rate_hz=rate)
