"""What people's torsos look like in a video, from the file to the recording and back."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scene_samples import filmed_walk

from vip_factors.body.keypoints import keypoint_set
from vip_factors.io.mcap_recording import read_scene, write_scene
from vip_factors.io.video import COLOURS, torso_colour, with_torso_colours
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.scene import Video

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


def test_from_the_side_a_torso_has_a_colour_too() -> None:
    line = np.array([[30.0, 20.0], [30.0, 20.0], [30.0, 60.0], [30.0, 60.0]])
    side = torso_colour(picture((200, 30, 30)), line)
    front = torso_colour(picture((200, 30, 30)), CORNERS)
    assert np.sum(np.minimum(side, front)) > 0.9


@pytest.mark.parametrize("corners", [CORNERS + 500, CORNERS * 0.01])
def test_a_torso_out_of_the_picture_has_none(corners: np.ndarray) -> None:
    assert torso_colour(picture((200, 30, 30)), corners) is None


def test_torsos_of_a_video(tmp_path: Path) -> None:
    path = tmp_path / "shirts.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10, (120, 90))
    for number in range(6):
        writer.write(picture((200, 30, 30) if number < 3 else (30, 30, 200))[..., ::-1])
    writer.release()
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
    write_scene(replace(scene, camera=replace(camera, detections=detections)), tmp_path / "coloured.mcap")
    read = read_scene(tmp_path / "coloured.mcap").camera.detections.torso_colour
    np.testing.assert_allclose(read, colours, rtol=1e-6)
    write_scene(scene, tmp_path / "plain.mcap")
    assert read_scene(tmp_path / "plain.mcap").camera.detections.torso_colour is None
