"""Filmstrips of wearers and scenes: what is drawn is there, in its colour."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from films import write_video
from scene_sample import Injected, estimate_of, scene_sample

from vip_factors.body.mannequin import ESTIMATE_COLOURS, Side
from vip_factors.errors import InputError
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.scene import Scene, Video
from vip_factors.viz.drawn_scene import drawn_scene, drawn_wearer
from vip_factors.viz.film import video_stream
from vip_factors.viz.picture import filmstrip

ERRORS = Injected(yaw=0.8, heading=0.2, camera_m=0.05)


@pytest.fixture(scope="module")
def sample() -> Scene:
    return scene_sample(0.5)


def test_every_wearer_is_on_the_picture_in_its_colour(sample: Scene, tmp_path: Path) -> None:
    png = tmp_path / "a.png"
    filmstrip(drawn_scene(sample, estimate_of(sample, ERRORS)), png, frames=3)
    shown = cv2.imread(str(png))[..., ::-1].astype(int)[130:430]  # the frames
    assert 1000 < np.sum(shown[..., 0] - shown[..., 2] > 60) < 50_000  # orange
    assert 1000 < np.sum(shown[..., 2] - shown[..., 0] > 60) < 50_000  # blue
    short = tmp_path / "b.png"
    bare = replace(
        sample,
        cameras=(replace(sample.camera, truth=None),),
        wearers=tuple(replace(one, truth=None) for one in sample.wearers),
    )
    filmstrip(drawn_scene(bare, None), short, frames=3)  # no camera pose, no curves: detections alone
    assert cv2.imread(str(short)).shape[0] < cv2.imread(str(png)).shape[0]


def test_frames_are_found_in_files_and_rubbish_is_left_out(tmp_path: Path) -> None:
    path = write_video(tmp_path / "v.avi", [np.full((48, 64, 3), level, np.uint8) for level in range(0, 250, 25)])
    found = list(video_stream(Video(path), [2, 7, 99]))
    assert [one is not None for one in found] == [True, True, False]
    assert found[1].mean() == pytest.approx(175, abs=3)
    one = {2: cv2.imencode(".png", np.full((48, 64, 3), 240, np.uint8))[1].tobytes()}
    assert [round(picture.mean(), -1) for picture in video_stream(Video(path, one), [2])] == [240]
    assert [round(picture.mean(), -1) for picture in video_stream(Video(path, one), [2, 8])] == [50, 200]  # not both
    assert list(video_stream(Video(None, {0: b"no image"}), [0])) == [None]
    assert list(video_stream(None, [0])) == [None]


def test_what_cannot_be_drawn_is_said(sample: Scene, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no camera"):
        filmstrip(drawn_scene(replace(sample, cameras=()), None), tmp_path / "a.png")
    (tmp_path / "b.png").write_text("precious")
    with pytest.raises(InputError, match="exists"):
        filmstrip(drawn_scene(sample, None), tmp_path / "b.png")
    assert (tmp_path / "b.png").read_text() == "precious"


def test_a_camera_without_frames_is_refused(sample: Scene, tmp_path: Path) -> None:
    seen = sample.camera.detections
    none = Detections(seen.keypoints, np.zeros(0), np.zeros(0, int), seen.pixels[:0], seen.confidence[:0])
    blind = replace(sample, cameras=(replace(sample.camera, detections=none, truth=None),))
    with pytest.raises(InputError, match="no video frames to draw"):
        filmstrip(drawn_scene(blind, None), tmp_path / "a.png")


def test_a_truth_without_frames_is_none_and_an_estimate_without_is_refused(sample: Scene) -> None:
    first = sample.wearers[0]
    cut = replace(first, truth=replace(first.truth, motion=first.truth.motion.frames(slice(0, 0))))
    scene, estimate = replace(sample, wearers=(cut, *sample.wearers[1:])), estimate_of(sample, ERRORS)
    assert drawn_scene(scene, estimate).wearers[0].truth is None
    assert drawn_scene(scene, None).wearers[0].shown is None
    none = replace(estimate.wearers[0], motion=estimate.wearers[0].motion.frames(slice(0, 0)))
    with pytest.raises(InputError, match=r"has no poses.*cut off"):
        drawn_scene(sample, replace(estimate, wearers=(none, *estimate.wearers[1:])))


def share_like(image: np.ndarray, colour: tuple[int, int, int], tolerance: int = 12) -> float:
    return float((np.abs(image[..., ::-1].astype(int) - colour).max(axis=-1) <= tolerance).mean())


def test_both_sides_and_the_curve_are_on_the_picture(scene, tmp_path: Path) -> None:
    filmstrip(drawn_wearer(scene.recording, scene.estimate, scene.truth), tmp_path / "a.png")
    image = cv2.imread(str(tmp_path / "a.png"))
    assert image.shape[1] == 1600
    strip = image[150:560].astype(int)  # light and shadow keep the hue
    for side in (Side.LEFT, Side.RIGHT):
        red, _, blue = ESTIMATE_COLOURS[side]
        assert 0.01 < np.mean((strip[..., 2] - strip[..., 0]) / (red - blue) > 0.5) < 0.2
    assert 0.6 < share_like(image, (255, 255, 255), 0) < 0.95
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]


def test_a_truth_alone_and_a_short_motion_can_be_drawn(scene, tmp_path: Path) -> None:
    filmstrip(drawn_wearer(scene.recording, None), tmp_path / "a.png")
    filmstrip(drawn_wearer(None, None, scene.truth.frames(slice(0, 1))), tmp_path / "b.png")
