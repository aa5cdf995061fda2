"""Films: skeletons lie where their joints are seen, over the video or a plain ground, and files play."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scene_sample import MODEL, Injected, estimate_of, scene_sample

from vip_factors.errors import InputError
from vip_factors.sensors.scene import Scene, Video
from vip_factors.viz.colours import wearer_colour
from vip_factors.viz.drawn_scene import DrawnScene, drawn_scene
from vip_factors.viz.film import GROUND, film, overlaid_frames


@pytest.fixture(scope="module")
def sample() -> Scene:
    return scene_sample(0.5)


@pytest.fixture(scope="module")
def drawn(sample: Scene) -> DrawnScene:
    return drawn_scene(sample, estimate_of(sample, Injected(heading=0.2)))


def filmed(sample: Scene, video: Video) -> DrawnScene:
    scene = replace(sample, cameras=(replace(sample.camera, video=video),))
    return drawn_scene(scene, estimate_of(scene))


@pytest.mark.parametrize("camera", [0, 1])
def test_skeletons_lie_where_their_joints_are_seen(camera: int, sample: Scene) -> None:
    estimate, lens = estimate_of(sample), MODEL.zoomed(-0.2)
    wide, found = replace(sample.camera, name="wide", model=lens), replace(estimate.camera, name="wide", model=lens)
    both = replace(sample, cameras=(sample.camera, wide))
    drawn = drawn_scene(both, replace(estimate, cameras=(estimate.camera, found)))
    (picture,) = overlaid_frames(drawn, np.array([6]), (640, 360), camera=camera)
    names = wide.detections.keypoints.keypoints
    for wearer in drawn.wearers:
        pixels = drawn.cameras[camera].reprojected(wearer)[6] * 0.5
        for side in ("left", "right"):
            shank = [names.index(f"{side}_{joint}") for joint in ("knee", "ankle")]
            x, y = np.round(pixels[shank].mean(axis=0)).astype(int)
            near = picture[y - 3 : y + 4, x - 3 : x + 4].reshape(-1, 3).astype(int)
            assert np.abs(near - wearer_colour(wearer.index)).max(axis=1).min() < 40
    assert (picture[:20] == GROUND).all()


def test_skeletons_are_laid_over_the_video(sample: Scene) -> None:
    blue = np.full((90, 160, 3), (200, 60, 20), np.uint8)
    images = {number: cv2.imencode(".png", blue)[1].tobytes() for number in range(3)}
    pictures = list(overlaid_frames(filmed(sample, Video(None, images)), np.arange(4), (160, 90)))
    for picture in pictures[:3]:
        assert np.abs(picture[:3].astype(int) - [20, 60, 200]).max() <= 1
        assert np.abs(picture.astype(int) - [20, 60, 200]).max() > 100
    assert (pictures[3][:3] == GROUND).all()  # no picture there


def test_a_film_opens_with_its_number_of_pictures(drawn: DrawnScene, tmp_path: Path) -> None:
    path, told = tmp_path / "a.mp4", []
    times, rate = film(drawn, path, 97, (0.1, 0.4), on_progress=lambda _, share: told.append(share))
    assert told[-1] == 1
    reader, pictures = cv2.VideoCapture(str(path)), []
    while (got := reader.read())[0]:
        pictures.append(got[1])
    assert (times[0], times[-1]) == pytest.approx((0.1, 0.4), abs=0.02)
    assert rate == pytest.approx(30)
    assert reader.get(cv2.CAP_PROP_FPS) == pytest.approx(rate)
    assert len(pictures) == len(times) == 10
    assert pictures[0].shape == (96, 172, 3)  # 16 : 9, both even
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(InputError, match="exists"):
        film(drawn, path, 96)
