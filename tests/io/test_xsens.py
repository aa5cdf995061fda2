"""Xsens tables: every dialect, lost packets, counters and clocks that wrap, and the ways such files are broken."""

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from table_samples import GRAVITY, PREAMBLE, STEP_US, columns_of, turning, write_dot, write_mtw

from vip_factors.errors import FileFormatError
from vip_factors.geometry.rotations import Array, exp
from vip_factors.io.importers.shared import mean_force_inertial, site_of_name
from vip_factors.io.importers.xsens import DOT, MTW


@given(
    separator=st.sampled_from(["\t", ",", ";", " "]),
    kind=st.sampled_from(["quaternion", "matrix", "euler"]),
    blank=st.sampled_from(["", "NaN"]),
    first=st.integers(0, 65535),
    kept=st.lists(st.booleans(), min_size=5, max_size=60).filter(lambda kept: sum(kept) >= 2),
    data=st.data(),
)
@settings(max_examples=40)
def test_every_dialect_reads_back(
    separator: str, kind: str, blank: str, first: int, kept: list[bool], data: st.DataObject
) -> None:
    R, force, rate = turning(len(kept), seed=first)
    rows = np.flatnonzero(kept)
    columns = columns_of(R[rows], force[rows], rate[rows], kind)
    order = data.draw(st.permutations(list(columns)))
    with tempfile.TemporaryDirectory() as folder:
        counter = (first + rows) % 65536
        path = write_mtw(Path(folder) / "walk_00B40000.txt", columns, counter, separator, blank=blank, order=order)
        assert MTW.matches(path)
        log = MTW.read(path)
    stream = log.imus["00B40000"]
    np.testing.assert_allclose(stream.time, (rows - rows[0]) / 100.0, atol=1e-9)
    np.testing.assert_allclose(stream.specific_force, force[rows], atol=1e-5)
    np.testing.assert_allclose(stream.angular_rate, rate[rows], atol=1e-5)
    np.testing.assert_allclose(stream.R_inertial_sensor, R[rows], atol=2e-5)
    assert any("packets lost" in note for note in log.notes) == (rows[-1] - rows[0] + 1 > len(rows))


@given(first=st.integers(0, 65535), late=st.integers(-500, 500))
@settings(max_examples=20)
def test_files_share_the_packet_counter_across_its_wrap(first: int, late: int) -> None:
    R, force, rate = turning(8)
    with tempfile.TemporaryDirectory() as folder:
        for sensor, begin in (("AA", first), ("BB", first + late)):
            counter = (begin + np.arange(8)) % 65536
            write_mtw(Path(folder) / f"run-1_{sensor}.txt", columns_of(R, force, rate), counter)
        log = MTW.read(Path(folder) / "run-1")
    starts = {name: stream.time[0] for name, stream in log.imus.items()}
    assert min(starts.values()) == 0
    assert starts["BB"] - starts["AA"] == pytest.approx(late / 100)


def test_times_follow_the_sensors_clock_where_all_files_have_it(tmp_path: Path) -> None:
    R, force, rate = turning(10)
    for sensor, late in (("A", 0), ("B", 3)):
        clock = (2**32 - 50000 + 16667 * (np.arange(10) + late)) % 2**32
        columns = {"SampleTimeFine": clock, **columns_of(R, force, rate)}
        lines = ["\t".join(["PacketCounter", *columns])]
        lines += ["\t".join([str(i + 1), *(f"{v[i]:.6f}" for v in columns.values())]) for i in range(10)]
        (tmp_path / f"run_{sensor}.txt").write_text(PREAMBLE + "\n".join(lines) + "\n")
    log = MTW.read(tmp_path)
    np.testing.assert_allclose(log.imus["B"].time, 16667e-6 * (np.arange(10) + 3), atol=1e-9)
    assert any("100 Hz" in note and "60.00 Hz" in note for note in log.notes)


def test_repeated_and_late_packets(tmp_path: Path) -> None:
    R, force, rate = turning(6)
    order = [0, 1, 1, 3, 2, 5]
    log = MTW.read(
        write_mtw(tmp_path / "a_S.txt", columns_of(R[order], force[order], rate[order]), 65533 + np.array(order))
    )
    np.testing.assert_allclose(log.imus["S"].time, np.array([0, 1, 2, 3, 5]) / 100)
    np.testing.assert_allclose(log.imus["S"].specific_force, force[[0, 1, 2, 3, 5]], atol=1e-5)
    assert any("came twice" in note for note in log.notes)
    assert any("out of order" in note for note in log.notes)


def test_a_restarted_counter_is_an_error(tmp_path: Path) -> None:
    R, force, rate = turning(4)
    path = write_mtw(tmp_path / "a_S.txt", columns_of(R, force, rate), np.array([5000, 5001, 1, 2]))
    with pytest.raises(FileFormatError, match=r"line 7: the packet counter 'PacketCounter' falls from 5001 to 1"):
        MTW.read(path)


def test_free_acceleration_gets_gravity_back(tmp_path: Path) -> None:
    R, _, _ = turning(5)
    free = np.tile([1.0, -2.0, 0.5], (5, 1))
    columns = columns_of(R, None, None) | {f"FreeAcc_{axis}": free[:, i] for i, axis in enumerate("XYZ")}
    stream = MTW.read(write_mtw(tmp_path / "a_S.txt", columns, np.arange(5))).imus["S"]
    np.testing.assert_allclose(
        np.einsum("nij,nj->ni", R, stream.specific_force), free + np.array([0, 0, 9.80665]), atol=1e-4
    )


def test_acceleration_without_gravity_is_noticed(tmp_path: Path) -> None:
    R, _, rate = turning(5)
    log = MTW.read(write_mtw(tmp_path / "a_S.txt", columns_of(R, np.full((5, 3), 0.1), rate), np.arange(5)))
    assert any("gravity had been removed" in note for note in log.notes)
    np.testing.assert_allclose(np.linalg.norm(log.imus["S"].specific_force, axis=1), 9.9, atol=0.1)


@pytest.mark.parametrize("turn", ["comment", "data"])
def test_a_frame_with_z_down_is_turned_over(tmp_path: Path, turn: str) -> None:
    R, force, rate = turning(5)
    R_ned_enu = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
    preamble = PREAMBLE + ("// Coordinate system: NED\n" if turn == "comment" else "")
    log = MTW.read(
        write_mtw(tmp_path / "a_S.txt", columns_of(R_ned_enu @ R, force, rate), np.arange(5), "\t", preamble)
    )
    stream = log.imus["S"]
    assert mean_force_inertial(stream.R_inertial_sensor, stream.specific_force)[2] > 9.7
    if turn == "comment":
        np.testing.assert_allclose(stream.R_inertial_sensor, R, atol=1e-5)
    assert any("down" in note for note in log.notes)


def test_samples_with_holes_are_dropped_and_counted(tmp_path: Path) -> None:
    R, force, rate = turning(6)
    columns = columns_of(R, force, rate)
    columns["Acc_X"][1] = np.nan
    columns["Quat_q0"][3], columns["Quat_q1"][3] = 0.0, 3.0
    log = MTW.read(write_mtw(tmp_path / "a_S.txt", columns, np.arange(6)))
    np.testing.assert_allclose(log.imus["S"].time, [0, 0.02, 0.04, 0.05])
    assert any("2 samples with missing values" in note for note in log.notes)
    assert any("not of unit length" in note for note in log.notes)


@pytest.mark.parametrize("cut", [3, 20])
def test_a_truncated_last_line_is_dropped(tmp_path: Path, cut: int) -> None:
    path = write_mtw(tmp_path / "a_S.txt", columns_of(*turning(6)), np.arange(6))
    path.write_text(path.read_text()[: -cut - 1])
    log = MTW.read(path)
    assert len(log.imus["S"]) == 5
    assert any("breaks off" in note for note in log.notes)


def test_rates_that_disagree_are_an_error_with_both(tmp_path: Path) -> None:
    for sensor, rate in (("A", "100.0"), ("B", "60.0")):
        preamble = PREAMBLE.replace("100.0", rate)
        write_mtw(tmp_path / f"a_{sensor}.txt", columns_of(*turning(3)), np.arange(3), preamble=preamble)
    with pytest.raises(FileFormatError, match=r"60 Hz and a_A\.txt 100"):
        MTW.read(tmp_path)


def test_broken_files_say_what_and_where(tmp_path: Path) -> None:
    R, force, rate = turning(4)
    columns, counter = columns_of(R, force, rate), np.arange(4)
    gyro_only = {name: values for name, values in columns.items() if name.startswith("Gyr")}
    with pytest.raises(FileFormatError, match="neither orientation"):
        MTW.read(write_mtw(tmp_path / "a_S.txt", gyro_only, counter))
    path = write_mtw(tmp_path / "a_S.txt", columns, counter)
    whole = path.read_text()
    path.write_text(whole.replace("00002\t\t\t", "00002\t\t\tx"))
    with pytest.raises(FileFormatError, match="line 7: column 'Acc_X' is 'x"):
        MTW.read(path)
    path.write_text(whole.replace("00002\t\t\t", "00002\t"))
    with pytest.raises(FileFormatError, match="line 7: 11 cells"):
        MTW.read(path)
    path.write_text(whole.split("00000")[0])
    with pytest.raises(FileFormatError, match="no samples"):
        MTW.read(path)
    write_mtw(tmp_path / "a_S.txt", columns | {f"Quat_q{i}": np.full(4, 2.0) for i in range(4)}, counter)
    with pytest.raises(FileFormatError, match="not of unit length"):
        MTW.read(path)


def test_two_recordings_in_a_folder_must_be_told_apart(tmp_path: Path) -> None:
    for name in ("walk-1_A", "walk-2_A"):
        write_mtw(tmp_path / f"{name}.txt", columns_of(*turning(3)), np.arange(3))
    with pytest.raises(FileFormatError, match=r"walk-1.*such as"):
        MTW.read(tmp_path)
    assert list(MTW.read(tmp_path / "walk-2").imus) == ["A"]


def test_other_texts_do_not_match(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("// a comment\nnothing to see\n")
    (tmp_path / "other.csv").write_text("a,b\n1,2\n")
    assert not MTW.matches(tmp_path)
    with pytest.raises(FileFormatError, match="none of its 2"):
        MTW.read(tmp_path)


@pytest.mark.data
def test_real_walk_with_eleven_sensors(data_folder: Path) -> None:
    log = MTW.read(data_folder / "xsens_vicon_walk" / "raw_mtw")
    assert len(log.imus) == 11
    for stream in log.imus.values():
        assert len(stream) == 2503
        assert stream.rate == pytest.approx(100)
        assert not len(stream.gaps)
        rest = stream.cut(0, 1)
        np.testing.assert_allclose(np.linalg.norm(rest.specific_force, axis=1).mean(), 9.81, atol=0.15)
        force = mean_force_inertial(rest.R_inertial_sensor, rest.specific_force)
        np.testing.assert_allclose(force, GRAVITY, atol=0.3)


def sample(count: int) -> tuple[Array, Array]:
    R = exp(np.array([0.3, -0.2, 1.0])) @ exp(0.02 * np.arange(count)[:, None] * np.array([1.0, 0.5, 0.2]))
    return R, np.tile([0.4, -0.3, 0.2], (count, 1))


@pytest.mark.parametrize("kind", ["quaternion", "euler"])
def test_one_clock_over_its_wrap(tmp_path: Path, kind: str) -> None:
    R, free = sample(20)
    begin = 2**32 - 5 * STEP_US
    write_dot(
        tmp_path / "Pelvis_20210820_202113_836.csv", R, free, (begin + STEP_US * np.arange(20)) % 2**32, 836, kind
    )
    later = (begin + STEP_US * (np.arange(20) + 7)) % 2**32
    write_dot(tmp_path / "RTibia_20210820_202114_001.csv", R, free, later, 839, kind)
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
    write_dot(tmp_path / "A_20210820_202113_836.csv", R, free, 1000 + STEP_US * np.arange(5))
    write_dot(tmp_path / "B_20210820_202113_836.csv", R, free, 4 * 10**9 // 2 + STEP_US * np.arange(5))
    log = DOT.read(tmp_path)
    np.testing.assert_allclose(log.imus["B"].time, np.arange(5) / 60)
    assert any("not set together" in note for note in log.notes)


def test_two_files_of_one_sensor_are_an_error(tmp_path: Path) -> None:
    R, free = sample(5)
    for second in (13, 50):
        write_dot(tmp_path / f"Pelvis_20210820_2021{second}_836.csv", R, free, STEP_US * np.arange(5))
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
