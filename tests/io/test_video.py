"""Videos are gone through frame by frame, embedded small, and refused where they do not belong."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from mcap_samples import walk
from scene_samples import MODEL, filmed_walk

from vip_factors.errors import FileFormatError, InputError
from vip_factors.io.mcap_recording import read_scene, write_scene
from vip_factors.io.video import check_video, embed_video, iterate_frames, video_facts
from vip_factors.sensors.scene import Scene, Video


def write_video(path: Path, frames: int = 20, rate: float = 10.0, size: tuple[int, int] = (640, 480)) -> Path:
    """Frame i is all of red 10 i."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), rate, size)
    for index in range(frames):
        writer.write(np.full((size[1], size[0], 3), (0, 0, 10 * index), np.uint8))
    writer.release()
    return path


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_video(tmp_path_factory.mktemp("video") / "v.mp4")


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
    scene = embed_video(filmed_walk(20), video, every=3, width=64)
    write_scene(scene, tmp_path / "s.mcap")
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
    with pytest.raises(InputError, match="has no camera"):
        embed_video(Scene("s", (walk(3),)), video)
    with pytest.raises(InputError, match="names no video"):
        embed_video(filmed_walk(3))


def test_a_video_that_does_not_belong_is_refused(tmp_path: Path, video: Path) -> None:
    camera = filmed_walk(20).camera
    assert camera is not None
    facts = video_facts(video)
    check_video(facts, camera)
    long = filmed_walk(31)
    assert long.camera is not None
    with pytest.raises(InputError, match=r"v\.mp4 has 20 frames, but the detections have 31"):
        check_video(facts, long.camera)
    with pytest.raises(InputError, match="shorter than its detections"):
        embed_video(long, video)
    with pytest.raises(
        InputError, match="640 by 480 pixels, but the camera was calibrated at 1280 by 960: calibrate at"
    ):
        check_video(facts, replace(camera, model=replace(MODEL, width=1280, height=960)))
    with pytest.raises(InputError, match="held as in the video"):
        check_video(facts, replace(camera, model=replace(MODEL, width=480, height=640)))
    check_video(facts, replace(camera, model=replace(MODEL, height=488)))
