"""A recording that is read, solved and written window by window, from the command line."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vip_factors.cli.workers import windows_elsewhere
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.io.mcap_estimate import read_estimate
from vip_factors.io.mcap_recording import read_scene, write_recording
from vip_factors.io.mcap_source import WearerFile, open_source
from vip_factors.sensors.sources import RecordingInMemory

WINDOWS = [
    "--no-covariance", "--frame-rate", "20", "--solve.max-iterations", "3", "--windows.above-s", "2",
    "--windows.window-s", "2", "--windows.overlap-s", "0.8", "--windows.calibration-stretches", "2",
    "--windows.calibration-stretch-s", "1.5",
]  # fmt: skip

COLUMNS = """
time = "t"
sensor_column = "who"
acceleration = ["ax", "ay", "az"]
quaternion = ["qw", "qx", "qy", "qz"]
"""


def test_windows_make_one_estimate(run, files, tmp_path: Path) -> None:
    """The same to the last bit, whatever process solves its windows."""
    out, there = tmp_path / "e.mcap", tmp_path / "there.mcap"
    told = run("smooth", files.recording, "--out", out, *WINDOWS, "--covariance")
    assert told.code == 0, told.err
    estimate, recording = read_estimate(out).wearer(), read_scene(files.recording).wearers[0]
    windows = {report.stage for report in estimate.reports if report.stage.startswith("sparse inertial poser")}
    assert windows == {f"sparse inertial poser, window {number}" for number in (1, 2, 3, 4)}
    first, last = RecordingInMemory(recording).interval
    assert estimate.motion.start == first
    assert len(estimate.motion) == int((last - first) * 20 + 1e-6) + 1
    assert f"{len(estimate.motion)} frames at 20 Hz" in told.out
    assert estimate.residuals["acceleration_m_s2"].shape == (len(estimate.motion), 6)
    step = np.linalg.norm(np.diff(estimate.motion.p_world_pelvis, axis=0), axis=1)
    assert step.max() < 0.2  # m: nothing leaps
    assert set(estimate.calibration) == set(recording.placed)
    assert estimate.settings["windows.window_s"] == "2.0"
    assert run("smooth", files.recording, "--out", there, "--jobs", 2, *WINDOWS, "--covariance").code == 0
    other = read_estimate(there).wearer()
    np.testing.assert_array_equal(estimate.motion.R_parent_child, other.motion.R_parent_child)
    np.testing.assert_array_equal(estimate.motion.p_world_pelvis, other.motion.p_world_pelvis)
    assert estimate.covariance is not None
    assert other.covariance is not None
    np.testing.assert_array_equal(estimate.covariance.joints, other.covariance.joints)


def test_an_interrupt_in_the_second_window_leaves_nothing(
    run, files, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked, windows = list[tuple[float, float]](), list[float]()
    between = WearerFile.between

    def interrupted(self: WearerFile, start: float = -np.inf, end: float = np.inf) -> object:
        asked.append((start, end))
        if list(tmp_path.iterdir()):  # under its temporary name
            windows.append(start)
        if len(windows) == 2:
            raise KeyboardInterrupt
        return between(self, start, end)

    monkeypatch.setattr(WearerFile, "between", interrupted)
    told = run("smooth", files.recording, "--out", tmp_path / "e.mcap", *WINDOWS)
    assert told.code == 130
    assert windows[1] > windows[0]
    assert len(asked) == 7  # a look for silences, four stretches that check and calibrate sensors, two windows
    assert list(tmp_path.iterdir()) == []


def test_a_file_read_by_time_gives_the_same_samples(files) -> None:
    recording, source = read_scene(files.recording).wearers[0], open_source([files.recording], 1.0)
    assert source.head.camera is None
    (sampled,) = source.wearers
    assert isinstance(sampled, WearerFile)
    memory = RecordingInMemory(recording)
    assert sampled.sensors == memory.sensors
    assert sampled.interval == memory.interval
    assert sampled.head.placement.name == recording.placement.name
    for start, end in ((-1.0, 0.5), (1.013, 2.4), (4.0, 99.0), (-np.inf, np.inf)):
        own, expected = sampled.between(start, end), memory.between(start, end)
        assert own.keys() == expected.keys()
        for name, stream in own.items():
            np.testing.assert_array_equal(stream.time, expected[name].time)
            np.testing.assert_array_equal(stream.R_inertial_sensor, expected[name].R_inertial_sensor)
            np.testing.assert_array_equal(stream.specific_force, expected[name].specific_force)
    assert sampled.between(100.0, 101.0) == {}


def test_a_session_in_two_files_is_one_recording(run, files, tmp_path: Path) -> None:
    """In windows, at once, and converted; files in the wrong order are put into that of time."""
    recording = read_scene(files.recording).wearers[0]
    paths, tables = [tmp_path / "a.mcap", tmp_path / "b.mcap"], [tmp_path / "a.csv", tmp_path / "b.csv"]
    for path, table, start, end in zip(paths, tables, (-1.0, 2.6), (2.5, 99.0), strict=True):
        imus = {name: one.cut(start, end) for name, one in recording.imus.items()}
        write_recording(replace(recording, imus=imus, truth=None), path)
        rows = [
            f"{t:.6f},{name},{','.join(f'{x:.5f}' for x in force)},{','.join(f'{x:.6f}' for x in q)}"
            for name, one in imus.items()
            for t, force, q in zip(
                one.time + 50.0, one.specific_force, quaternion_from_matrix(one.R_inertial_sensor, Order.WXYZ),
                strict=True,
            )
        ]  # fmt: skip
        table.write_text("\n".join(["t,who,ax,ay,az,qw,qx,qy,qz", *rows]) + "\n")
    settings = [*WINDOWS, "--calibration.start.no-search"]
    told = run("smooth", paths[1], paths[0], "--out", tmp_path / "e.mcap", *settings)
    assert told.code == 0, told.err
    first, last = RecordingInMemory(recording).interval
    estimate = read_estimate(tmp_path / "e.mcap").wearer()
    assert estimate.motion.start == first
    assert len(estimate.motion) == int((last - first) * 20 + 1e-6) + 1
    told = run("convert", paths[0], tmp_path / "all.mcap", "--then", paths[1])
    assert told.code == 0, told.err
    whole = read_scene(tmp_path / "all.mcap").wearers[0]
    map_file = tmp_path / "map.toml"
    map_file.write_text(COLUMNS)
    told = run("convert", tables[0], tmp_path / "t.mcap", "--then", tables[1], "--columns", map_file)
    assert told.code == 0, told.err
    table = read_scene(tmp_path / "t.mcap").wearers[0]
    for name, stream in recording.imus.items():
        kept = (stream.time <= 2.5) | (stream.time >= 2.6)
        np.testing.assert_allclose(whole.imus[name].time, stream.time[kept], atol=1e-9)
        np.testing.assert_allclose(np.diff(table.imus[name].time), np.diff(stream.time[kept]), atol=2e-6)
    told = run("smooth", files.recording, files.recording, "--out", tmp_path / "no.mcap")
    assert (told.code, told.err.count("\n")) == (2, 1)
    assert "files of a recording must follow one another" in told.err
    assert run("smooth").code == 2


def test_a_window_whose_process_is_lost_is_solved_here() -> None:
    with windows_elsewhere(2, None) as each:
        assert list(each(_ends_elsewhere, [os.getpid()] * 3)) == [os.getpid()] * 3


def _ends_elsewhere(number: int) -> int:
    if os.getpid() != number:
        os._exit(9)
    return number
