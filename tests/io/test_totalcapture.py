"""TotalCapture: sequences of that form written here, from a motion that is known."""

from pathlib import Path

import numpy as np
import pytest
from totalcapture_samples import BODY, FRAMES, JOINTS, SENSORS, write

from vip_factors.body.skeleton import joint_index
from vip_factors.errors import FileFormatError
from vip_factors.geometry.rotations import angle_between
from vip_factors.io.importers import totalcapture

AXES = {
    "body axes": np.eye(3),
    "facing backwards": np.diag([-1.0, 1.0, -1.0]),
    "z up": np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]),
}


@pytest.mark.parametrize("axes", AXES)
def test_truth_and_mountings_arrive_in_our_axes(tmp_path: Path, axes: str) -> None:
    made = write(tmp_path, AXES[axes])
    assert totalcapture.matches(tmp_path)
    log = totalcapture.read(tmp_path)
    truth = log.truth_motion
    assert truth is not None
    seen = [joint_index(bone) for bone in JOINTS.values()]
    np.testing.assert_allclose(truth.state.p_world_joint[:, seen], made.state.p_world_joint[:, seen], atol=1e-6)
    assert np.max(angle_between(truth.R_parent_child, made.R)) < 1e-6
    ends = [joint_index(f"{side}_{name}") for side in ("left", "right") for name in ("hand", "foot")]  # from the legs
    apart = np.abs(truth.skeleton.p_parent_joint - BODY.p_parent_joint)
    assert np.max(np.delete(apart, ends, axis=0)) < 1e-6
    assert np.max(apart[ends]) < 0.003
    assert np.isclose(log.stature_m, 1.8, atol=0.01)
    assert log.placement is not None
    for sensor, bone in SENSORS.items():
        site = log.placement.site(sensor)
        assert site.bone == bone
        assert angle_between(site.R_bone_sensor, made.mountings[sensor]) < 1e-6
    assert "calibrated sensors turn their bones 0.0° (median) from the optical ones" in log.notes


def test_streams_are_as_recorded(tmp_path: Path) -> None:
    made = write(tmp_path)
    log = totalcapture.read(tmp_path / "s1_walking2_Xsens.sensors")
    assert list(log.imus) == list(SENSORS)
    for k, (name, stream) in enumerate(log.imus.items()):
        np.testing.assert_allclose(stream.time, np.arange(FRAMES) / 60)
        assert stream.R_inertial_sensor is not None
        assert np.max(angle_between(stream.R_inertial_sensor, made.streams[name])) < 1e-6
        np.testing.assert_allclose(stream.specific_force, made.force[:, k], atol=1e-6)
        assert stream.angular_rate is None
    assert set(log.default_sites) == set(SENSORS)


def test_truth_begins_with_the_sensors(tmp_path: Path) -> None:
    write(tmp_path, lost_head=3)
    log = totalcapture.read(tmp_path)
    assert log.truth_motion is not None
    assert log.truth_motion.start == 0.0
    assert not any("turn their bones 0.0°" in note for note in log.notes)  # so a shifted sequence is told


def test_without_its_companions_a_log_still_gives_streams(tmp_path: Path) -> None:
    write(tmp_path)
    for file in (*tmp_path.glob("gt_*"), *tmp_path.glob("*calib*")):
        file.unlink()
    log = totalcapture.read(tmp_path)
    assert len(log.imus) == 13
    assert log.truth_motion is None
    assert log.placement is None
    assert any("no optical truth" in note for note in log.notes)


def test_a_sensors_file_that_breaks_off_gives_its_whole_frames(tmp_path: Path) -> None:
    write(tmp_path)
    path = tmp_path / "s1_walking2_Xsens.sensors"
    lines = path.read_text().split("\n")
    path.write_text("\n".join(lines[: 1 + 14 * 10 + 5]))
    log = totalcapture.read(tmp_path)
    assert len(log.imus["Head"]) == 10
    assert any("announces 40 frames and holds 10 whole ones" in note for note in log.notes)
    assert log.truth_motion is not None


def test_missing_frame_numbers_are_gaps_and_zero_quaternions_lost_samples(tmp_path: Path) -> None:
    write(tmp_path)
    path = tmp_path / "s1_walking2_Xsens.sensors"
    lines = path.read_text().split("\n")
    lines[1 + 14 * 5 + 1] = "Head\t0 0 0 0 0 0 0"
    del lines[1 + 14 * 20 : 1 + 14 * 21]
    path.write_text("\n".join(lines))
    log = totalcapture.read(tmp_path)
    np.testing.assert_allclose(log.imus["Head"].gaps, [[4 / 60, 6 / 60], [19 / 60, 21 / 60]])
    np.testing.assert_allclose(log.imus["R_Foot"].gaps, [[19 / 60, 21 / 60]])


def test_truth_without_rotations_at_its_end_is_trimmed(tmp_path: Path) -> None:
    write(tmp_path)
    path = tmp_path / "gt_skel_gbl_ori.txt"
    lines = path.read_text().rstrip().split("\n")
    lines[-1] = "\t".join(["0 0 0 0"] * 21)
    lines[1] = lines[-1]
    path.write_text("\n".join(lines))
    truth = totalcapture.read(tmp_path).truth_motion
    assert truth is not None
    assert len(truth) == FRAMES - 2
    assert np.isclose(truth.start, 1 / 60)


@pytest.mark.parametrize(
    ("file", "old", "new", "sentence"),
    [
        ("s1_walking2_Xsens.sensors", "13\t40", "40", "line 1 is '40': expected the numbers of sensors and of frames"),
        ("s1_walking2_Xsens.sensors", "\n7\n", "\nx\n", "line 86 is 'x': expected a frame's number"),
        (
            "s1_walking2_Xsens.sensors",
            "\n7\n",
            "\n" + "9" * 400 + "\n",
            "line 86 is '9{40}': expected a frame's number",
        ),
        ("s1_walking2_calib_imu_bone.txt", "Pelvis ", "Pelvis x", "line 4 .*expected Name qx qy qz qw"),
        ("gt_skel_gbl_pos.txt", "Hips\t", "Hip\t", "its joints are not those of gt_skel_gbl_pos.txt"),
        ("gt_skel_gbl_pos.txt", "Neck\t", "", "expected 60 numbers"),
    ],
)
def test_mistakes_are_named(tmp_path: Path, file: str, old: str, new: str, sentence: str) -> None:
    write(tmp_path)
    path = tmp_path / file
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(FileFormatError, match=sentence):
        totalcapture.read(tmp_path / "s1_walking2_Xsens.sensors")


def test_several_sequences_in_a_folder_need_a_choice(tmp_path: Path) -> None:
    write(tmp_path)
    write(tmp_path, prefix="s1_acting3_")
    with pytest.raises(FileFormatError, match="holds several sequences"):
        totalcapture.read(tmp_path)
    log = totalcapture.read(tmp_path / "s1_acting3_Xsens.sensors")
    assert log.placement is not None


def test_other_things_are_refused(tmp_path: Path) -> None:
    assert not totalcapture.matches(tmp_path)
    with pytest.raises(FileFormatError, match=r"no \.sensors file"):
        totalcapture.read(tmp_path)
    (tmp_path / "a.sensors").write_text("time,x\n0,1\n1,2\n")
    assert not totalcapture.matches(tmp_path / "a.sensors")
