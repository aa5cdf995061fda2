"""``convert`` makes scenes of recordings, 2D poses and a camera; ``info`` says what is in them."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vip_factors.body.keypoints import KEYPOINT_SETS
from vip_factors.io.mcap_recording import read_scene, write_recording


@pytest.fixture
def poses(tmp_path: Path) -> Path:
    rng = np.random.default_rng(0)
    entries = []
    for frame in (0, 0, 1, 40):
        points = rng.uniform(0.2, 1, (17, 3)) * [600, 400, 1]
        entries.append({"image_id": frame, "category_id": 1, "keypoints": points.ravel().tolist()})
    (tmp_path / "poses.json").write_text(json.dumps(entries))
    (tmp_path / "camera.toml").write_text("width = 640\nheight = 480\nfx = 500\nfy = 500\ncx = 320\ncy = 240\n")
    return tmp_path / "poses.json"


def test_two_wearers_and_a_camera(run, files, tmp_path: Path, poses: Path) -> None:
    ada, bea = tmp_path / "ada.mcap", tmp_path / "bea.mcap"
    recording = read_scene(files.recording).wearers[0]
    for name, path in (("Ada", ada), ("Bea", bea)):
        write_recording(replace(recording, subject=replace(recording.subject, name=name)), path)
    told = run(
        "convert", ada, tmp_path / "both.mcap", "--join", bea, "--detections", poses, "--video-rate", "10",
        "--camera", tmp_path / "camera.toml", "--static-camera", "--name", "both",
        "--camera-imu-wxyz", "1", "0", "0", "0",
    )  # fmt: skip
    assert told.code == 0, told.err
    assert told.out.endswith("both.mcap\n")
    scene = read_scene(tmp_path / "both.mcap")
    assert [wearer.subject.name for wearer in scene.wearers] == ["Ada", "Bea"]
    assert scene.camera is not None
    assert scene.camera.detections.keypoints == KEYPOINT_SETS["coco17"]
    info = run("info", tmp_path / "both.mcap")
    assert info.code == 0, info.err
    for words in (
        r"scene 'both'\n  2 wearers: +Ada, Bea\n", r"standing still\n  image: +640 by 480 pixels",
        r"keypoints: +coco17 \(17\)", r"detections: +4; people per frame: nobody in 38, 1 in 2, 2 in 1",
    ):  # fmt: skip
        assert re.search(words, info.out), words
    assert "left_forearm" in info.out


def test_a_camera_that_nobody_calibrated(run, files, tmp_path: Path, poses: Path) -> None:
    converted = run("convert", files.recording, tmp_path / "a.mcap", "--detections", poses, "--video-rate", "10")
    assert converted.code == 0, converted.err
    assert "no camera file is given: the focal length is estimated" in converted.err
    camera = read_scene(tmp_path / "a.mcap").camera
    assert camera is not None
    assert (camera.model.width, camera.model.height, camera.focal_sigma) == (640, 480, 0.25)
    info = run("info", tmp_path / "a.mcap")
    assert re.search(r"image: +640 by 480 pixels, focal length 554, 554 px ± 25.0 %", info.out)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--static-camera", "--video-rate", "10"], "--video-rate, --static-camera given without --detections"),
        (["--detections", "poses.json", "--video-rate", "9", "--known-camera-pose"], "without its camera file"),
        (["--detections", "poses.json", "--camera", "camera.toml"], "without times"),
        (["--detections", "none.json", "--camera", "camera.toml", "--video-rate", "9"], "none.json: no such file"),
        (["--detections", "poses.json", "--camera", "none.toml", "--video-rate", "9"], "none.toml"),
        (["--detections", "poses.json", "--camera", "camera.toml", "--video", "none.mp4"], "none.mp4: no such video"),
        (["--join", "none.mcap"], "none.mcap"),
    ],
)
def test_what_does_not_fit_is_one_sentence(run, files, tmp_path: Path, monkeypatch, poses, options, words) -> None:
    monkeypatch.chdir(tmp_path)
    told = run("convert", files.recording, "out.mcap", *options)
    assert told.code == 2
    assert words in told.err
    assert told.err.count("\n") == 1
    assert not (tmp_path / "out.mcap").exists()


FLOOR = "[floor]\nR_floor_camera = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]\np_floor_camera = [{0}, -4, 1.2]\n"


def test_cameras_stand_where_their_files_say(run, files, tmp_path: Path, poses: Path) -> None:
    plain = (tmp_path / "camera.toml").read_text()
    for number, name in enumerate(("left", "right")):
        (tmp_path / f"{name}.toml").write_text(plain + FLOOR.format(number))
    words = ["--video-rate", "10", "--static-camera", "--known-camera-pose"]
    for name, offset in (("camera", "0"), ("left", "0"), ("right", "-0.5")):
        words += ["--detections", poses, "--camera", tmp_path / f"{name}.toml", "--time-offset-s", offset]
        words += ["--camera-name", name]
    told = run("convert", files.recording, tmp_path / "out.mcap", *words)
    assert told.code == 0, told.err
    scene = read_scene(tmp_path / "out.mcap")
    assert [camera.name for camera in scene.cameras] == ["camera", "left", "right"]
    assert [camera.clock.offset for camera in scene.cameras] == [0.0, 0.0, -0.5]
    assert scene.cameras[0].known_path is None  # its file tells none
    np.testing.assert_allclose(scene.cameras[2].known_path.p_world_camera, [[1, -4, 1.2]], atol=1e-12)
    info = run("info", tmp_path / "out.mcap")
    assert len(re.findall("pose known at: +1 instant", info.out)) == 2


def test_what_is_said_once_is_of_all_cameras(run, files, tmp_path: Path, poses: Path) -> None:
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / poses.name).write_bytes(poses.read_bytes())
    words = ["--detections", poses, "--detections", tmp_path / "b" / poses.name, "--video-rate", "10"]
    told = run("convert", files.recording, tmp_path / "out.mcap", *words, "--static-camera", "--carried-camera", "b")
    assert told.code == 0, told.err
    cameras = read_scene(tmp_path / "out.mcap").cameras
    assert [camera.name for camera in cameras] == [poses.parent.name, "b"]
    assert [camera.moving for camera in cameras] == [False, True]
    assert [camera.detections.rate for camera in cameras] == pytest.approx([10.0, 10.0])
    told = run(
        "convert", files.recording, tmp_path / "no.mcap", *words, "--camera", "a", "--camera", "b", "--camera", "c"
    )
    assert told.code == 2
    assert "--camera is said 3 times of 2 cameras (--detections): expected one for all, or one for each" in told.err
    told = run("convert", files.recording, tmp_path / "no.mcap", *words, "--carried-camera", "c")
    assert told.code == 2
    assert "--carried-camera c: expected the name of a camera" in told.err


def test_a_carried_camera_has_a_path_from_elsewhere(run, files, tmp_path: Path, poses: Path) -> None:
    rows = "".join(f"{1700000000 + 0.1 * n:.1f} {0.01 * n} 0 0 0 0 0 1\n" for n in range(41))
    (tmp_path / "slam.txt").write_text("# timestamp tx ty tz qx qy qz qw\n" + rows)
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / poses.name).write_bytes(poses.read_bytes())
    words = ["--detections", poses, "--detections", tmp_path / "b" / poses.name, "--video-rate", "10"]
    words += ["--static-camera", "--carried-camera", "b", "--camera-path", tmp_path / "slam.txt", "--scale-free-path"]
    converted = run("convert", files.recording, tmp_path / "out.mcap", *words)
    assert converted.code == 0, converted.err
    assert "its first pose is taken as that of the first video frame" in converted.err
    standing, carried = read_scene(tmp_path / "out.mcap").cameras
    assert standing.odometry is None
    assert carried.odometry is not None
    assert carried.scale_free_odometry
    np.testing.assert_allclose(carried.odometry.time, carried.detections.time[0] + 0.1 * np.arange(41), atol=1e-6)
    np.testing.assert_allclose(carried.odometry.p_world_camera[:, 0], 0.01 * np.arange(41), atol=1e-12)
    assert "odometry: 41 poses, of unknown scale" in re.sub(" +", " ", run("info", tmp_path / "out.mcap").out)
    refused = run("convert", files.recording, tmp_path / "no.mcap", *words, "--carried-camera", poses.parent.name)
    assert refused.code == 2
    assert "expected one path for each camera that is carried, of which there are 2" in refused.err
