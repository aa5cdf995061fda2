"""Frames of videos, from files and out of recordings, and what people's torsos look like in them."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from films import write_video
from mcap_samples import walk
from scene_samples import MODEL, filmed_walk

from vip_factors.body.keypoints import keypoint_set
from vip_factors.errors import FileFormatError, InputError
from vip_factors.io.mcap_recording import read_scene, write_recording
from vip_factors.io.video import (
    COLOURS,
    check_video,
    embed_video,
    iterate_frames,
    torso_colour,
    video_facts,
    with_torso_colours,
    with_videos,
)
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.scene import Scene, Video

REDS = [np.full((480, 640, 3), (0, 0, 10 * index), np.uint8) for index in range(20)]  # frame i is all of red 10 i


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_video(tmp_path_factory.mktemp("video") / "v.mp4", REDS)


def reds(frames) -> list[int]:
    return [round(float(frame.image[..., 0].mean()) / 10) for frame in frames]


def test_facts_are_those_of_the_frames(video: Path) -> None:
    facts = video_facts(video)
    assert (facts.width, facts.height, len(facts)) == (640, 480, 20)
    assert facts.rate == pytest.approx(10.0)
    np.testing.assert_allclose(facts.time, np.arange(20) / 10, atol=1e-3)


def test_frames_come_in_order_with_their_times(video: Path) -> None:
    assert reds(iterate_frames(video)) == list(range(20))
    some = list(iterate_frames(Video(video), time=np.arange(20) * 2.0, every=4, start=2, stop=13, width=160))
    assert [frame.number for frame in some] == [2, 6, 10] == reds(some)
    assert [frame.time for frame in some] == [4.0, 12.0, 20.0]
    assert some[0].image.shape == (120, 160, 3)


def test_an_embedded_video_is_seen_without_its_file(video: Path, tmp_path: Path) -> None:
    scene = embed_video(with_videos(filmed_walk(20), [video]))
    write_recording(scene, tmp_path / "s.mcap")
    camera = read_scene(tmp_path / "s.mcap").camera
    assert camera is not None
    assert camera.video == scene.camera.video
    assert camera.video is not None
    frames = list(iterate_frames(Video(None, camera.video.images), camera.detections.time))
    assert [frame.number for frame in frames] == list(range(0, 20, 3)) == reds(frames)
    assert frames[2].time == pytest.approx(0.6)
    gone = replace(camera.video, path=tmp_path / "moved.mp4")
    assert len(list(iterate_frames(gone))) == 7


def test_what_is_no_video_is_refused(tmp_path: Path, video: Path) -> None:
    (tmp_path / "x.mp4").write_text("no video")
    with pytest.raises(FileFormatError, match=r"x\.mp4: not a video"):
        video_facts(tmp_path / "x.mp4")
    with pytest.raises(InputError, match="no such video"):
        list(iterate_frames(tmp_path / "none.mp4"))
    with pytest.raises(InputError, match="neither a file nor embedded"):
        list(iterate_frames(Video()))
    with pytest.raises(FileFormatError, match="image of video frame 3 cannot be decoded"):
        list(iterate_frames(Video(None, {3: b"\xff\xd8 no image"})))
    for scene in (Scene("s", (walk(3),)), filmed_walk(3)):
        with pytest.raises(InputError, match="names no video"):
            embed_video(scene)


def test_a_video_that_does_not_belong_is_refused(video: Path) -> None:
    camera, facts = filmed_walk(20).camera, video_facts(video)
    assert camera is not None
    check_video(facts, replace(camera, model=replace(MODEL, height=488)))
    with pytest.raises(InputError, match="shorter than its detections"):
        with_videos(filmed_walk(31), [video])
    with pytest.raises(InputError, match=r"2 video files for 1 cameras \(.*\): expected one for each"):
        with_videos(filmed_walk(20), [video, video])
    with pytest.raises(InputError, match="held as in the video"):
        check_video(facts, replace(camera, model=replace(MODEL, width=480, height=640)))


CORNERS = np.array([[40.0, 20.0], [20.0, 20.0], [22.0, 60.0], [38.0, 60.0]])


def picture(torso: tuple[int, int, int], light: float = 1.0) -> np.ndarray:
    """A torso before a grey wall, red first."""
    image = np.full((90, 120, 3), 128, np.uint8)
    cv2.fillConvexPoly(image, CORNERS.astype(np.int32), tuple(round(light * one) for one in torso))
    return image


def test_colours_of_shirts_differ() -> None:
    red, dark_red, blue, grey = (
        torso_colour(picture(*one), CORNERS)
        for one in (((200, 30, 30), 1.0), ((200, 30, 30), 0.9), ((30, 30, 200), 1.0), ((110, 110, 112), 1.0))
    )
    assert red is not None
    assert red.sum() == pytest.approx(1)
    assert np.sum(np.minimum(red, dark_red)) > 0.9
    assert np.sum(np.minimum(red, blue)) < 0.1
    assert np.sum(np.minimum(red, grey)) < 0.1


def test_torsos_of_a_video(tmp_path: Path) -> None:
    shirts = [picture((200, 30, 30) if number < 3 else (30, 30, 200))[..., ::-1] for number in range(6)]
    path = write_video(tmp_path / "shirts.avi", shirts)
    keypoints = keypoint_set("coco17")
    pixels = np.full((6, 17, 2), 5.0)
    for name, at in zip(("left_shoulder", "right_shoulder", "right_hip", "left_hip"), CORNERS, strict=True):
        pixels[:, keypoints.keypoints.index(name)] = at
    confidence = np.full((6, 17), 0.9)
    confidence[4, keypoints.keypoints.index("left_hip")] = 0.0
    d = with_torso_colours(Detections(keypoints, np.arange(6) / 10, np.arange(6), pixels, confidence), Video(path))
    assert d.torso_colour is not None
    assert np.isfinite(d.torso_colour[:, 0]).tolist() == [True, False, True, False, False, False]  # every 0.2 s; hidden
    assert np.sum(np.minimum(d.torso_colour[0], d.torso_colour[2])) > 0.9
    assert len(d.select(np.array([0, 2])).torso_colour) == 2


def test_they_are_kept_in_the_recording(tmp_path: Path) -> None:
    scene = filmed_walk()
    camera = scene.camera
    assert camera is not None
    colours = np.random.default_rng(0).random((len(camera.detections), COLOURS))
    colours[::2] = np.nan
    detections = replace(camera.detections, torso_colour=colours)
    write_recording(replace(scene, cameras=(replace(camera, detections=detections),)), tmp_path / "coloured.mcap")
    read = read_scene(tmp_path / "coloured.mcap").camera.detections.torso_colour
    np.testing.assert_allclose(read, colours, rtol=1e-6)
    write_recording(scene, tmp_path / "plain.mcap")
    assert read_scene(tmp_path / "plain.mcap").camera.detections.torso_colour is None
