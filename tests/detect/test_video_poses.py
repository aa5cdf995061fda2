"""A video through the tracker into a file that convert reads."""

from pathlib import Path
from typing import ClassVar

import cv2
import numpy as np
import pytest
from detect.stub_people import People
from films import write_video

from vip_factors.body.keypoints import keypoint_set
from vip_factors.detect.models import Box
from vip_factors.detect.settings import DetectSettings
from vip_factors.detect.tracks import Tracker
from vip_factors.detect.video import detect_video, exchanged_sides, write_overlay
from vip_factors.errors import InputError
from vip_factors.io.detections import read_detections, write_mmpose

FRAMES, RATE = 30, 15.0


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_video(tmp_path_factory.mktemp("video") / "walk.mp4", np.zeros((FRAMES, 240, 640, 3), np.uint8), RATE)


def tracker(people: People) -> Tracker:
    return Tracker(people, people, DetectSettings())


def test_everybody_is_in_the_file_that_convert_reads(video: Path, tmp_path: Path) -> None:
    poses = detect_video(video, tracker(People({"a": (150, 120), "b": (450, 120)})))
    assert list(poses.tracks) == [1, 2]
    assert all(len(people) == 2 for people in poses.frames)
    out = tmp_path / "walk.json"
    write_mmpose(out, poses.keypoints, poses.frames, poses.facts.time, {"detector": "none"})
    found = read_detections(out, None)  # the file tells its frames' times
    assert np.allclose(found.time, np.arange(FRAMES) / RATE, atol=1e-3)
    assert found.keypoints.name == "blazepose33"
    assert len(found.time) == FRAMES
    assert found.frame.tolist() == sorted([*range(FRAMES)] * 2)
    first = poses.frames[0][0]
    seen = first.confidence > 0
    assert np.allclose(found.pixels[0][seen], first.pixels[seen], atol=0.006)
    assert np.allclose(found.confidence[0], first.confidence, atol=1e-4)


def test_a_stretch_and_every_third_frame(video: Path) -> None:
    settings = DetectSettings(start_s=0.4, end_s=1.6, every=3)
    poses = detect_video(video, tracker(People({"a": (150, 120)})), settings)
    assert [index for index, people in enumerate(poses.frames) if people] == list(range(6, 25, 3))
    assert len(poses.frames) == FRAMES
    for wrong in (DetectSettings(start_s=5.0), DetectSettings(start_s=1.0, end_s=0.5)):
        with pytest.raises(InputError):
            detect_video(video, tracker(People({})), wrong)


def test_a_short_track_is_left_out_and_the_others_are_numbered_anew(video: Path) -> None:
    class Leaving(People):
        def look(self, image: np.ndarray, square: object) -> object:
            self.count = getattr(self, "count", 0) + 1
            if self.count > 5:
                self.places.pop("a", None)
            return super().look(image, square)  # type: ignore[arg-type]

    people = Leaving({"a": (150, 120), "b": (450, 120)})
    poses = detect_video(video, tracker(people))
    assert list(poses.tracks) == [1]
    assert len([person for people in poses.frames for person in people]) == FRAMES


def test_another_model_sees_the_people_who_are_followed(video: Path) -> None:
    class Model:
        keypoints = keypoint_set("coco17")
        boxes: ClassVar[list[Box]] = []

        def look(self, image: np.ndarray, box: Box) -> tuple[np.ndarray, np.ndarray]:
            self.boxes.append(box)
            return np.full((17, 2), [box.left, box.lower]), np.full(17, 0.7)

    people = People({"a": (150, 120), "b": (450, 120)})
    poses = detect_video(video, tracker(people), DetectSettings(end_s=0.1), Model())  # type: ignore[arg-type]
    assert poses.keypoints.name == "coco17"
    assert [len(frame) for frame in poses.frames[:3]] == [2, 2, 0]
    assert len(Model.boxes) == 4
    for box, x in zip(Model.boxes, (150, 450, 150, 450), strict=True):
        assert box.left < x < box.right
        assert box.upper < 120 < box.lower <= 240  # of what is within the image
    assert np.all(poses.frames[0][0].confidence == 0.7)


def test_the_overlay_shows_them_in_the_frames_looked_at(video: Path, tmp_path: Path) -> None:
    settings = DetectSettings(every=2)
    poses = detect_video(video, tracker(People({"a": (150, 120)})), settings)
    write_overlay(tmp_path / "o.mp4", poses)
    capture = cv2.VideoCapture(str(tmp_path / "o.mp4"))
    good, image = capture.read()
    assert good
    assert image.shape == (240, 640, 3)
    assert image[:, :320].max() > 150
    assert image[:, 400:].max() < 50
    assert capture.get(cv2.CAP_PROP_FRAME_COUNT) == FRAMES / 2
    with pytest.raises(InputError):
        write_overlay(tmp_path / "o.mp4", poses)


@pytest.mark.parametrize("most_bytes", [100, 4000])
def test_a_full_disk_is_told_and_leaves_no_overlay(video: Path, tmp_path: Path, most_bytes: int) -> None:
    resource = pytest.importorskip("resource")
    poses = detect_video(video, tracker(People({"a": (150, 120)})))
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most_bytes, hard))
    try:
        with pytest.raises(OSError, match=r"o\.mp4|frames could be written"):
            write_overlay(tmp_path / "o.mp4", poses)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert list(tmp_path.iterdir()) == []


KEYPOINTS = keypoint_set("coco17")
REACH = 8


def walking(turned: np.ndarray) -> np.ndarray:
    """Pixels ``(F, 17, 2)`` of somebody who is turned about the vertical by so much in each frame, radians."""
    random = np.random.default_rng(1)
    half = {"shoulder": 40.0, "hip": 25.0}
    width = np.array([half.get(name.split("_")[-1], 20.0) for name in KEYPOINTS.keypoints])
    width *= [1 if name.startswith("left") else -1 if name.startswith("right") else 0 for name in KEYPOINTS.keypoints]
    height = {"shoulder": 100.0, "hip": 200.0}
    y = np.array([height.get(name.split("_")[-1], 150.0) for name in KEYPOINTS.keypoints])
    pixels = np.zeros((len(turned), 17, 2))
    pixels[..., 0] = 500 + width * np.cos(turned)[:, None] + 5 * np.sin(np.arange(len(turned)) / 5)[:, None]
    pixels[..., 1] = y
    return pixels + random.normal(0, 2.0, pixels.shape)


CONFIDENCE = np.full((60, 17), 0.9)


@pytest.mark.parametrize("wrong", [[20], [20, 21, 22, 23], range(20, 45), [5, 6, 30, 31, 50], [0, 1]])
def test_exchanged_frames_are_found(wrong: list[int]) -> None:
    pixels = walking(np.zeros(60))
    pixels[list(wrong)] = pixels[list(wrong)][:, KEYPOINTS.mirrored]
    assert np.flatnonzero(exchanged_sides(KEYPOINTS, pixels, CONFIDENCE, REACH)).tolist() == list(wrong)


@pytest.mark.parametrize("frames", [15, 20, 30, 40])
def test_somebody_who_turns_about_keeps_the_sides(frames: int) -> None:
    turned = np.clip((np.arange(60) - 10) / frames, 0, 1) * np.pi
    assert not np.any(exchanged_sides(KEYPOINTS, walking(turned), CONFIDENCE, REACH))
