"""Estimate files written as they go."""

import json
import resource
import signal
import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from live_answers import LAG, answer, answers, live_scene, setup_of, truth_of
from live_sender import delimited, sample_message

from vip_factors.errors import FileFormatError, InputError
from vip_factors.findings import sentences
from vip_factors.io.live_mcap import LIVE_CAMERA, LIVE_UPDATE, LiveMcapSink
from vip_factors.io.live_messages import header_message
from vip_factors.io.mcap_estimate import read_estimate
from vip_factors.io.mcap_messages import Topics
from vip_factors.io.mcap_reader import McapWarning, read_contents
from vip_factors.io.schemas.body_pose_pb2 import BodyPose
from vip_factors.io.schemas.camera_estimate_pb2 import CameraPose
from vip_factors.io.schemas.live_update_pb2 import LiveUpdate
from vip_factors.live_estimate import LiveEstimate
from vip_factors.sensors.camera import CameraPath
from vip_factors.sensors.live import live_samples, stream_head
from vip_factors.sensors.scene import Scene


def write(scene: Scene, path: Path, estimates: list[LiveEstimate], **options: object) -> None:
    with LiveMcapSink(path, setup_of(scene), 60.0, **options) as sink:
        for one in estimates:
            sink.write(one)


def test_the_smoothed_poses_are_an_estimate_of_the_scene(tmp_path: Path) -> None:
    scene = live_scene(1.2)
    given = list(answers(scene))
    write(scene, tmp_path / "e.mcap", given, settings={"live.lag": "0.25"})
    assert [path.name for path in tmp_path.iterdir()] == ["e.mcap"]
    with warnings.catch_warnings():
        warnings.simplefilter("error", McapWarning)
        read = read_estimate(tmp_path / "e.mcap")
    assert read.name == scene.name
    assert read.settings == {"live.lag": "0.25"}
    assert sentences(read.findings) == ("the stream has begun",)
    for index, one in enumerate(read.wearers):
        truth = truth_of(scene, index).frames(slice(0, len(given) - LAG))
        np.testing.assert_allclose(one.motion.R_parent_child, truth.R_parent_child, atol=1e-12)
        np.testing.assert_array_equal(one.motion.p_world_pelvis, truth.p_world_pelvis)
        np.testing.assert_allclose(one.motion.time, truth.time, atol=1e-12)
        np.testing.assert_array_equal(one.covariance.root[3], 1e-4 * np.eye(3))
        assert one.calibration["head"].heading_sigma == given[-1].wearers[index].calibration["head"].heading_sigma
    assert len(read.camera.path) == len(given) - LAG
    np.testing.assert_allclose(read.camera.path.time[5], given[5].time, atol=1e-12)
    assert read.camera.covariance.shape == (len(given) - LAG, 6, 6)


def test_newest_poses_and_updates_stand_beside_them(tmp_path: Path) -> None:
    scene = live_scene(1.2)
    given = list(answers(scene))
    write(scene, tmp_path / "e.mcap", given)
    contents = read_contents(tmp_path / "e.mcap")
    topics = Topics(contents)
    poses = topics.all("/estimate/live/wearer/bob/pose", BodyPose)
    assert [one.frame for one in poses] == list(range(len(given)))
    np.testing.assert_allclose(poses[40].p_world_pelvis.x, given[40].wearers[1].newest.p_world_pelvis[0])
    cameras = topics.all(LIVE_CAMERA, CameraPose)
    assert [one.seconds for one in cameras] == [one.time for one in given]
    updates = topics.all(LIVE_UPDATE, LiveUpdate)
    assert [one.frame for one in updates] == list(range(len(given)))
    assert list(updates[0].findings) == ["the stream has begun"]
    assert list(updates[9].detection_of_wearer) == [0, 1]
    assert updates[9].update_s == 0.005
    assert [one.preliminary for one in updates] == [one.preliminary for one in given]
    assert contents.damage == []


def test_existing_files_stay(tmp_path: Path) -> None:
    scene = live_scene(0.1)
    (tmp_path / "e.mcap").write_bytes(b"mine")
    with pytest.raises(InputError, match="exists already"):
        LiveMcapSink(tmp_path / "e.mcap", setup_of(scene), 60.0)
    with pytest.raises(InputError, match="no folder"):
        LiveMcapSink(tmp_path / "none" / "e.mcap", setup_of(scene), 60.0)
    sink = LiveMcapSink(tmp_path / "f.mcap", setup_of(scene), 60.0)
    sink.write(answer(scene, 0))
    (tmp_path / "f.mcap").write_bytes(b"quicker")
    with pytest.raises(InputError, match="exists already"):
        sink.close()
    assert (tmp_path / "f.mcap").read_bytes() == b"quicker"
    assert (tmp_path / "f.partial.mcap").exists()


def test_a_stream_without_smoothed_poses_says_so(tmp_path: Path) -> None:
    scene = live_scene(0.1)
    write(scene, tmp_path / "e.mcap", list(answers(scene)))
    with pytest.raises(FileFormatError, match="live/update"):
        read_estimate(tmp_path / "e.mcap")


def test_frames_that_are_missing_or_come_twice(tmp_path: Path) -> None:
    scene = live_scene(1.0)
    given = []
    for one in answers(scene):
        smoothed = [wearer.smoothed for wearer in one.wearers]
        if 40 <= one.frame < 43:
            smoothed = [None, None]
        if one.frame == 44:
            smoothed = [wearer.smoothed for wearer in given[-1].wearers]  # said twice
        wearers = zip(one.wearers, smoothed, strict=True)
        given.append(replace(one, wearers=tuple(replace(wearer, smoothed=pose) for wearer, pose in wearers)))
    write(scene, tmp_path / "e.mcap", given)
    for index, wearer in enumerate(read_estimate(tmp_path / "e.mcap").wearers):
        motion, truth = wearer.motion, truth_of(scene, index).p_world_pelvis
        assert len(motion) == len(given) - LAG
        np.testing.assert_array_equal(motion.p_world_pelvis[24], truth[24])
        np.testing.assert_array_equal(motion.p_world_pelvis[25:28], truth[[24] * 3])  # held as it is read
        np.testing.assert_array_equal(motion.p_world_pelvis[30:], truth[30 : len(motion)])
        poses = Topics(read_contents(tmp_path / "e.mcap")).all(f"/estimate/wearer/{motion.name}/pose", BodyPose)
        assert [one.frame for one in poses] == [*range(25), 28, *range(30, len(motion))]
    findings = sentences(read_estimate(tmp_path / "e.mcap").findings)
    for name in scene.names:
        assert any(f"wearer '{name}': no poses in 3 frames" in one for one in findings)


MOST_BYTES = 2 << 30


def test_a_clock_that_jumps_by_a_day_leaves_a_gap(tmp_path: Path) -> None:
    scene, out, jump = live_scene(5.0, 1, filmed=False), tmp_path / "e.mcap", 100_000.0
    command = [sys.executable, "-m", "vip_factors", "stream", "-", "--json", "--frame-rate", "30", "--out", str(out)]
    command += ["--recalibration.no-use", "--calibration.start.no-search"]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_DATA, (MOST_BYTES, MOST_BYTES)),
    ) as stream:  # fmt: skip
        assert stream.stdin is not None
        assert stream.stdout is not None
        stream.stdin.write(delimited(header_message(stream_head(scene)).SerializeToString()))
        for sample in live_samples(scene):
            later = jump if sample.time > 2.5 else 0.0
            stream.stdin.write(delimited(sample_message(replace(sample, time=sample.time + later)).SerializeToString()))
        stream.stdin.flush()
        assert any(json.loads(line)["time"] > jump + 4.5 for line in stream.stdout)
        stream.send_signal(signal.SIGINT)
        assert stream.wait(20) == 130
    assert out.stat().st_size < 2_000_000
    frames = [one.frame for one in Topics(read_contents(out)).all("/estimate/pose", BodyPose)]
    assert frames[-1] > 30 * jump
    assert len(frames) < 150
    with pytest.warns(McapWarning, match="ends after"):
        motion = read_estimate(out).wearer().motion
    assert len(motion) < 75


def test_a_camera_known_to_stand_still_has_one_pose(tmp_path: Path) -> None:
    scene = live_scene(1.0)
    first = scene.camera.truth.path
    known = CameraPath(first.time[:1], first.R_world_camera[:1], first.p_world_camera[:1])
    scene = replace(scene, cameras=(replace(scene.camera, moving=False, known_path=known),))
    write(scene, tmp_path / "e.mcap", list(answers(scene)))
    assert len(read_estimate(tmp_path / "e.mcap").camera.path) == 1


def test_every_camera_is_written_with_its_newest_lens(tmp_path: Path) -> None:
    scene = live_scene(1.0)
    scene = replace(scene, cameras=(scene.camera, replace(scene.camera, name="side/left")))
    given = list(answers(scene))
    lens = scene.camera.model.zoomed(0.2)
    for frame in range(len(given) // 2, len(given)):
        cameras = tuple(replace(camera, model=lens) for camera in given[frame].cameras)
        given[frame] = replace(given[frame], cameras=cameras)
    write(scene, tmp_path / "e.mcap", given)
    read = read_estimate(tmp_path / "e.mcap")
    assert [camera.name for camera in read.cameras] == [camera.name for camera in scene.cameras]
    for camera in read.cameras:
        np.testing.assert_allclose(camera.model.focal, lens.focal)
        assert len(camera.path) == len(given) - LAG
    side = Topics(read_contents(tmp_path / "e.mcap")).all("/estimate/live/cameras/side_left/pose", CameraPose)
    assert [pose.frame for pose in side] == list(range(len(given)))
