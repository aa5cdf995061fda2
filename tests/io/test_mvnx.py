"""MVNX: files of that form written here, and the real ones against MVN's own numbers."""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from mvnx_samples import FRAMES, R_SEGMENT_BONE, SEGMENTS, SENSORS, motion, poses, write

from vip_factors.body.skeleton import JOINT_NAMES, joint_index
from vip_factors.errors import FileFormatError
from vip_factors.geometry.rotations import angle_between
from vip_factors.io.importers import mvnx
from vip_factors.sensors.calibration import SITES


@pytest.mark.parametrize("version", [3, 4])
def test_sensors_and_segments_arrive_in_our_frames(tmp_path: Path, version: int) -> None:
    path, R = tmp_path / "walk.mvnx", motion()
    R_sensor, force = write(path, R, version)
    assert mvnx.matches(path)
    log = mvnx.read(path)
    assert list(log.imus) == list(SENSORS)
    for row, stream in enumerate(log.imus.values()):
        np.testing.assert_allclose(stream.time, np.arange(FRAMES) / 60)
        assert stream.R_inertial_sensor is not None
        assert np.max(angle_between(stream.R_inertial_sensor, R_sensor[:, row])) < 1e-7
        np.testing.assert_allclose(stream.specific_force, force[:, row], atol=1e-6)
    assert log.start_ns == 1542082631842 * 10**6
    assert log.default_sites == {"Pelvis": "pelvis", "T8": "sternum", "LeftForeArm": "left_forearm"}
    truth = log.truth_motion
    assert truth is not None
    names, p = list(SEGMENTS), poses(R)
    for bone, segment in {"pelvis": "Pelvis", "left_elbow": "LeftForeArm", "right_ankle": "RightFoot"}.items():
        row = names.index(segment)
        assert np.max(angle_between(truth.state.R_world_bone[:, joint_index(bone)], R[:, row] @ R_SEGMENT_BONE)) < 1e-7
        np.testing.assert_allclose(truth.state.p_world_joint[:, joint_index(bone)], p[:, row], atol=1e-7)
    assert log.stature_m is not None
    assert np.isclose(log.stature_m, 0.1 * 2 + 0.09 * 3 + 0.12 + 0.17 + 0.4 + 0.41 + 0.085)


def test_mountings_are_those_of_mvn(tmp_path: Path) -> None:
    path, R = tmp_path / "walk.mvnx", np.repeat(motion()[:1], FRAMES, axis=0)
    write(path, R)
    text = path.read_text().split("<sensorOrientation>")
    fixed = text[1].split("</sensorOrientation>")[0]  # the sensors keep still as the wearer does
    kept = [fixed + "</sensorOrientation>" + part.split("</sensorOrientation>")[1] for part in text[1:]]
    path.write_text("<sensorOrientation>".join([text[0], *kept]))
    log = mvnx.read(path)
    assert log.placement is not None
    assert log.truth_motion is not None
    site, stream = log.placement.site("LeftForeArm"), log.imus["LeftForeArm"]
    assert site.bone == "left_elbow"
    R_world_bone = log.truth_motion.state.R_world_bone[:, site.bone_index]
    assert np.max(angle_between(R_world_bone @ site.R_bone_sensor, stream.R_inertial_sensor)) < 1e-6


def test_lengths_come_from_the_calibration_where_points_are_missing(tmp_path: Path) -> None:
    path = tmp_path / "walk.mvnx"
    write(path, motion(), 3, points=False)
    log = mvnx.read(path)
    assert log.truth_motion is not None
    assert log.stature_m is None
    assert np.isclose(log.truth_motion.skeleton.bone_length("left_knee"), 0.4)


def test_lost_frames_leave_gaps_and_no_motion(tmp_path: Path) -> None:
    path = tmp_path / "walk.mvnx"
    write(path, motion())
    lines = path.read_text().split("\n")
    path.write_text("\n".join(line for line in lines if 'index="4"' not in line))
    log = mvnx.read(path)
    np.testing.assert_allclose(log.imus["T8"].gaps, [[3 / 60, 5 / 60]])
    assert log.truth_motion is None
    assert any("some frames are missing" in note for note in log.notes)


def test_a_file_that_breaks_off_gives_what_it_holds(tmp_path: Path) -> None:
    path = tmp_path / "walk.mvnx"
    write(path, motion())
    text = path.read_text()
    path.write_text(text[: text.index('index="5"') + 400])
    log = mvnx.read(path)
    assert len(log.imus["Pelvis"]) == 5
    assert any("breaks off" in note for note in log.notes)


@pytest.mark.parametrize("configuration", ["", 'configuration="FullBody" ', 'configuration="UpperBody" '])
@pytest.mark.parametrize("every_limb", [True, False])
def test_limbs_without_sensors_are_no_truth(tmp_path: Path, configuration: str, every_limb: bool) -> None:
    """The configuration says which limbs are measured; without one the sensors do."""
    path = tmp_path / "walk.mvnx"
    write(path, motion(), sensors=tuple(mvnx.SENSOR_SITES) if every_limb else SENSORS)
    path.write_text(path.read_text().replace('frameRate="60"', f'{configuration}frameRate="60"'))
    log = mvnx.read(path)
    assert log.truth_motion is not None
    is_all = "Full" in configuration or (not configuration and every_limb)
    assert (log.truth_bones is None) == is_all
    assert any("limbs without sensors are no truth" in note for note in log.notes) == (not is_all)
    if not is_all and not every_limb:
        assert log.truth_bones is not None
        assert {"left_elbow", "spine3"} <= log.truth_bones
        assert not log.truth_bones & {"left_hip", "right_elbow"}


@pytest.mark.parametrize(
    "words", [("Leg", "Foot", "Toe"), ("L5", "L3", "T12", "T8", "Neck", "Head", "Shoulder", "Arm", "Hand")]
)
def test_segments_of_half_a_body_leave_the_sensors(tmp_path: Path, words: tuple[str, ...]) -> None:
    path = tmp_path / "walk.mvnx"
    kept = ["Pelvis", *(name for name in SEGMENTS if name.endswith(words))]
    R_sensor, _ = write(path, motion(), segments=kept)
    log = mvnx.read(path)
    assert any("no motion of MVN's own: segment" in note for note in log.notes)
    assert log.truth_motion is None
    assert log.default_sites == {"Pelvis": "pelvis", "T8": "sternum", "LeftForeArm": "left_forearm"}
    assert np.max(angle_between(log.imus["T8"].R_inertial_sensor, R_sensor[:, 1])) < 1e-7


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("sensorOrientation", "nothing", "no sensorOrientation in any frame: export"),
        ('type="normal"', 'type="npose"', "no frame of type 'normal'"),
        ('<sensor label="Prop1"/>', "", "<sensorOrientation> of frame 0 has 16 numbers: expected 12"),
        ('frameRate="60"', 'frameRate="fast"', "frameRate = 'fast': expected a number"),
        ("<position>0.1", "<position>x", "could not convert"),
        ("<mvnx ", "<mvnx <", "not readable as XML"),
    ],
)
def test_mistakes_are_named(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    path = tmp_path / "walk.mvnx"
    write(path, motion())
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(FileFormatError, match=sentence):
        mvnx.read(path)


def test_other_files_are_not_taken_for_mvnx(tmp_path: Path) -> None:
    (tmp_path / "a.xml").write_text("<OpenSimDocument/>")
    assert not mvnx.matches(tmp_path / "a.xml")
    assert not mvnx.matches(tmp_path)
    assert not mvnx.matches(tmp_path / "absent")


REAL = [("full_body_240hz_v3.mvnx", 17, 4, 240), ("upper_body_60hz_v4.mvnx", 11, 112, 60)]


@pytest.mark.data
@pytest.mark.parametrize(("name", "sensors", "frames", "rate"), REAL)
def test_real_files_hold_an_upright_person(data_folder: Path, name: str, sensors: int, frames: int, rate: int) -> None:
    path = data_folder / "mvnx" / name
    log = mvnx.read(path)
    assert len(log.imus) == len(log.default_sites) == sensors
    assert set(log.default_sites.values()) <= set(SITES)
    for stream in log.imus.values():
        assert len(stream) == frames
        assert frames == 1 or np.isclose(stream.rate, rate)
        assert stream.specific_force is not None
        assert stream.R_inertial_sensor is not None
        # On average gravity is all a sensor feels, and it points up.
        up = np.mean(stream.R_inertial_sensor @ stream.specific_force[:, :, None], axis=0)[:, 0]
        np.testing.assert_allclose(up, [0, 0, 9.8], atol=1.5)
    truth = log.truth_motion
    assert truth is not None
    at = {joint: truth.state.p_world_joint[:, row] for row, joint in enumerate(JOINT_NAMES)}
    assert np.all(at["head"][:, 2] > at["pelvis"][:, 2] + 0.4)
    assert np.all(at["left_ankle"][:, 2] < at["pelvis"][:, 2] - 0.5)
    leftwards = truth.state.R_world_bone[:, 0, :, 0]
    assert np.all(np.sum((at["left_hip"] - at["right_hip"]) * leftwards, axis=1) > 0.1)
    forwards = truth.state.R_world_bone[:, 0, :, 2]
    assert np.all(np.sum((at["left_foot"] - at["left_ankle"]) * forwards, axis=1) > 0.1)
    assert log.stature_m is not None
    assert 1.6 < log.stature_m < 1.7
    _assert_joints_are_mvns(path, at)


def _assert_joints_are_mvns(path: Path, at: dict[str, np.ndarray]) -> None:
    root = ElementTree.parse(path).getroot()
    labels = [element.get("label") for element in root.iter() if element.tag.endswith("}segment")]
    normal = [e for e in root.iter() if e.tag.endswith("}frame") and e.get("type") == "normal"]
    texts = [next(c.text or "" for c in f if c.tag.endswith("}position")) for f in normal]
    p = np.array([text.split() for text in texts], float).reshape(len(normal), -1, 3)
    pairs = {"left_wrist": "LeftHand", "right_elbow": "RightForeArm", "right_foot": "RightToe", "head": "Head"}
    for joint, segment in pairs.items():
        assert np.max(np.linalg.norm(at[joint] - p[:, labels.index(segment)], axis=1)) < 0.01
