"""Clocks of logs of any make, as somebody meets them who types the commands: template, convert, run."""

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from conftest import assert_one_sentence

from vip_factors.geometry.rotations import exp
from vip_factors.io.mcap_recording import read_scene
from vip_factors.io.settings import LogOptions

COUNT = 300


def rows_of_motion(degrees: bool, rate: float = 100.0) -> list[str]:
    """Specific force in m/s² and angular rate of a foot that swings about its x axis, a row of cells each."""
    time = np.arange(COUNT) / rate
    angle = 0.7 * np.sin(5 * time)
    force = np.einsum("nji,j->ni", exp(angle[:, None] * [1.0, 0, 0]), [0, 0, 9.81])
    turning = np.rad2deg(1.0) ** degrees * np.gradient(angle, 1 / rate)
    return [f"{x:.6f},{y:.6f},{z:.6f},{w:.6f},0,0" for (x, y, z), w in zip(force, turning, strict=True)]


AXES = "acc_x,acc_y,acc_z,gyr_x,gyr_y,gyr_z"


def write(path: Path, name: str, cells: list[str], preamble: str = "", degrees: bool = False) -> Path:
    rows = [f"{cell},{row}" for cell, row in zip(cells, rows_of_motion(degrees), strict=False)]
    path.write_text(preamble + "\n".join([f"{name},{AXES}", *rows]) + "\n", encoding="utf-8")
    return path


def converted(run, log: Path, *words: object):
    """The recording from the template's guesses as they are, and what converting said."""
    guess = log.parent / "g"
    told = run("convert", log, "--template", guess, "--overwrite", *words)
    assert told.code == 0, told.err
    columns = (log.parent / "g_columns.toml").read_text()
    options = ("--columns", f"{guess}_columns.toml", "--placement", f"{guess}_placement.toml", "--overwrite")
    told = run("convert", log, log.parent / "a.mcap", *options)
    assert told.code == 0, told.err
    return read_scene(log.parent / "a.mcap").wearers[0].imus["left_foot"], columns, told.out


TIMES = np.arange(COUNT) / 100
UNITS = {
    "seconds": ("time", 1.0, 0.0, "s"), "ms": ("Timestamp", 1e-3, 0.0, "ms"), "us": ("t [us]", 1e-6, 0.0, "us"),
    "ns since 1970": ("epoch", 1e-9, 1.6e9, "ns"), "ticks": ("SampleTimeFine", 1e-4, 34.0, "0.1ms"),
    "us of the same name": ("SampleTimeFine", 1e-6, 1.0, "us"), "days": ("Time", 86_400.0, 45_050 * 86_400, "days"),
    "ms since 1970": ("UnixTimestamp", 1e-3, 1.6e9, "ms"), "named otherwise": ("time_s", 1e-3, 5.0, "ms"),
}  # fmt: skip


@pytest.mark.parametrize("degrees", [False, True])
@pytest.mark.parametrize(("name", "unit", "start", "expected"), UNITS.values(), ids=UNITS)
def test_units_of_time_are_guessed(
    run, tmp_path: Path, name: str, unit: float, start: float, expected: str, degrees: bool
) -> None:
    cells = [f"{(start + time) / unit:.11f}" if unit > 1e3 else f"{(start + time) / unit:.3f}" for time in TIMES]
    stream, columns, _ = converted(run, write(tmp_path / "left_foot.csv", name, cells, degrees=degrees))
    assert f'time_unit = "{expected}"' in columns
    np.testing.assert_allclose(stream.time, TIMES, atol=1e-5)
    assert np.max(np.abs(stream.angular_rate)) == pytest.approx(3.5, rel=0.1)


@pytest.mark.parametrize("form", ["{}", "10:11:{:02d}", "2023-05-04 10:11:{:02d}"])
def test_stamps_of_whole_seconds_and_a_counter_of_a_maker_in_another_table(run, tmp_path: Path, form: str) -> None:
    cells = [f"{i},{form.format((i + 37) // 100)}" for i in range(COUNT)]
    stream, columns, _ = converted(run, write(tmp_path / "left_foot.csv", "PacketCounter,time", cells))
    assert 'time = "time"' in columns
    np.testing.assert_allclose(stream.time, TIMES, atol=1e-6)


@pytest.mark.parametrize(("rate", "unit"), [(20.0, "ms"), (500.0, "0.1ms")])
def test_the_motion_decides_between_units(run, tmp_path: Path, rate: float, unit: str) -> None:
    """Steps of 50 ms or 20 ticks of 0.1 ms may be either; only one has gravity turn as fast as the gyroscope says."""
    rows = rows_of_motion(False, rate)
    step = {"ms": 1000, "0.1ms": 10_000}[unit] / rate
    lines = [f"{round(i * step)},{row}" for i, row in enumerate(rows)]
    log = tmp_path / "left_foot.csv"
    log.write_text("\n".join([f"time,{AXES}", *lines]) + "\n")
    stream, columns, _ = converted(run, log)
    assert "as gravity's direction turns" in columns
    assert stream.rate == pytest.approx(rate)


@pytest.mark.parametrize(
    ("preamble", "step", "unit"),
    [("Sample rate: 500 Hz\n", 20, "0.1ms"), ("Update Rate: 50 Hz\n", 20, "ms"), ("OutputRate:,10Hz\n", 100, "ms")],
)
def test_a_stated_rate_decides_between_units(run, tmp_path: Path, preamble: str, step: int, unit: str) -> None:
    cells = [str(step * i) for i in range(COUNT)]
    log = write(tmp_path / "left_foot.csv", "time", cells, preamble)
    assert run("convert", log, "--template", tmp_path / "g").code == 0
    assert f'time_unit = "{unit}"' in (tmp_path / "g_columns.toml").read_text()


def test_what_cannot_be_decided_is_to_be_declared(run, tmp_path: Path) -> None:
    lines = [f"{25 * i},0.1,0.2,9.8,0,0,0" for i in range(COUNT)]
    (tmp_path / "left_foot.csv").write_text("\n".join([f"time,{AXES}", *lines]) + "\n")
    told = run("convert", tmp_path / "left_foot.csv", "--template", tmp_path / "g")
    assert (told.code, "PLEASE DECLARE time_unit" in told.err) == (0, True)
    text = (tmp_path / "g_columns.toml").read_text()
    assert "ms (40 Hz) or 0.1ms (400 Hz): PLEASE DECLARE time_unit" in text


@pytest.mark.parametrize("preamble", ["Acquisition frequency: 100 Hz\n", "Device: 7\n// Update Rate: 100.0Hz\n", ""])
@pytest.mark.parametrize("modulus", [256, 65_536])
def test_a_counter_is_the_clock_and_a_rate_may_be_given(run, tmp_path: Path, preamble: str, modulus: int) -> None:
    kept = np.delete(np.arange(COUNT), np.arange(50, 250, 4))
    cells = [str((modulus - 20 + i) % modulus) for i in kept]
    log = write(tmp_path / "left_foot.csv", "Packet Counter", cells, preamble)
    if not preamble:
        assert run("convert", log, "--template", tmp_path / "g").code == 0
        told = run("convert", log, tmp_path / "a.mcap", "--columns", tmp_path / "g_columns.toml")
        assert_one_sentence(told, "neither time nor rate_hz is given", "--rate-hz")
    stream, columns, out = converted(run, log, *(() if preamble else ("--rate-hz", 100)))
    assert 'counter = "Packet Counter"' in columns
    assert "rate_hz = 100" in columns
    np.testing.assert_allclose(stream.time, kept / 100, atol=1e-9)
    assert "50 of 300 packets lost" in out


FAULTS = {
    "header": (lambda lines: [*lines[:100], lines[0], *lines[100:]], "line 101: the header stands there again"),
    "short row": (lambda lines: [*lines[:100], lines[100][:20], *lines[101:]], "line 101: 3 cells where the header"),
    "restart": (lambda lines: [*lines, *lines[1:50]], "line 302: time 'time' falls from 2.99 s to 0 s"),
    "no number": (lambda lines: [*lines[:100], "oops" + lines[100][4:], *lines[101:]], "column 'time' is 'oops"),
    "no value": (lambda lines: [*lines[:100], lines[100] + "x", *lines[101:]], "line 101: column 'gyr_z' is '0x'"),
}  # fmt: skip


@pytest.mark.parametrize(("fault", "words"), FAULTS.values(), ids=FAULTS)
@pytest.mark.parametrize("folder", [False, True])
def test_a_fault_of_rows_is_named_by_the_template_as_by_convert(run, tmp_path: Path, fault, words, folder) -> None:
    (tmp_path / "log").mkdir()
    log = write(tmp_path / "log" / "left_foot.csv", "time", [f"{time:.3f}" for time in TIMES])
    write(tmp_path / "log" / "pelvis.csv", "time", [f"{time:.3f}" for time in TIMES])
    source = log.parent if folder else log
    assert run("convert", source, "--template", tmp_path / "g").code == 0
    log.write_text("\n".join(fault(log.read_text().splitlines())) + "\n")
    by_template = run("convert", source, "--template", tmp_path / "h")
    assert_one_sentence(by_template, "left_foot.csv", words)
    assert not (tmp_path / "h_columns.toml").exists()
    by_convert = run("convert", source, tmp_path / "a.mcap", "--columns", tmp_path / "g_columns.toml")
    assert by_convert.err == by_template.err


@pytest.mark.parametrize("device", ["D7_0001_", ""])
@pytest.mark.parametrize("range_of", ["LN_", "WR_", ""])
def test_device_names_units_and_utf16(run, tmp_path: Path, device: str, range_of: str) -> None:
    names = [f"{device}Timestamp_Unix_CAL", *(f"{device}Accel_{range_of}{axis}_CAL" for axis in "XYZ")]
    names += [f"{device}Gyro_{axis}_CAL" for axis in "XYZ"]
    units = ["ms", *["m/(s^2)"] * 3, *["deg/s"] * 3]
    rows = [f"{1.6e12 + 10 * i:.3f}," + row for i, row in enumerate(rows_of_motion(True))]
    text = "\n".join(['"sep=\t"', *("\t".join(row) + "\t" for row in (names, units, *(r.split(",") for r in rows)))])
    log = tmp_path / "left_foot.csv"
    log.write_text(text + "\n", encoding="utf-16")
    stream, columns, _ = converted(run, log)
    assert 'angular_rate_unit = "deg/s"' in columns
    np.testing.assert_allclose(stream.time, TIMES, atol=1e-5)
    assert np.max(np.abs(stream.angular_rate)) == pytest.approx(3.5, rel=0.1)


@pytest.mark.parametrize("name", ["walk_{}.txt", "{}_20250711_200600.csv"])
def test_an_export_without_a_rate_takes_one(run, tmp_path: Path, name: str) -> None:
    head = "// Firmware Version: 4.6.0\n" if name.endswith("txt") else "sep=,\nDeviceTag:,x\n\n"
    header = "PacketCounter," + AXES.replace("acc_", "Acc_").replace("gyr_", "Gyr_").replace("_x", "_X")
    header = header.replace("_y", "_Y").replace("_z", "_Z")
    rows = [f"{i},{row}" for i, row in enumerate(rows_of_motion(name.endswith("csv")))]
    (tmp_path / "log").mkdir()
    (tmp_path / "log" / name.format("LeftFoot")).write_text(head + "\n".join([header, *rows]) + "\n")
    told = run("convert", tmp_path / "log", tmp_path / "a.mcap")
    assert "100 Hz assumed; say it with --rate-hz" in told.out
    assert run("convert", tmp_path / "log", tmp_path / "b.mcap", "--rate-hz", "60").code == 0
    (stream,) = read_scene(tmp_path / "b.mcap").wearers[0].imus.values()
    assert stream.rate == pytest.approx(60)
    recording = run("convert", tmp_path / "a.mcap", tmp_path / "c.mcap", "--rate-hz", "60")
    assert_one_sentence(recording, "recording of this package already")


def test_run_takes_what_convert_takes_of_a_log(run, tmp_path: Path) -> None:
    counter = [str(i) for i in np.delete(np.arange(COUNT), np.arange(50, 250, 4))]
    log = write(tmp_path / "left_foot.csv", "Counter", counter)
    (tmp_path / "columns.toml").write_text(
        'acceleration = ["acc_x", "acc_y", "acc_z"]\nangular_rate = ["gyr_x", "gyr_y", "gyr_z"]\n[sensors.left_foot]\n'
    )
    words = (
        "--columns",
        tmp_path / "columns.toml",
        "--rate-hz",
        50,
        "--stature-m",
        1.71,
        "--subject",
        "Ada",
        "--no-report",
    )
    quick = "--smooth-options=--frame-rate 20 --solve.max-iterations 2"
    told = run("run", "--log", log, *words, quick, "--out", tmp_path / "o")
    assert told.code == 0, told.err
    wearer = read_scene(tmp_path / "o" / "recording.mcap").wearers[0]
    assert wearer.imus["left_foot"].time[-1] == pytest.approx(299 / 50)
    assert (wearer.subject.name, wearer.subject.stature_m) == ("Ada", 1.71)
    help_of = {command: run(command, "--help").out for command in ("convert", "run")}
    for field in fields(LogOptions):
        assert all(f"--{field.name.replace('_', '-')}" in text for text in help_of.values())
    assert_one_sentence(run("run", "--log", log, "--log", log, "--then", log), "2 --log and --then are given")
