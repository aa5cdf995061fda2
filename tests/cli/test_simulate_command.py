from pathlib import Path

import numpy as np
import pytest

from vip_factors.io.mcap_recording import read_scene


@pytest.mark.parametrize("camera", ["fixed", "walking"])
def test_a_simulated_scene_is_what_was_asked_for(run, tmp_path: Path, camera: str) -> None:
    path = tmp_path / "scene.mcap"
    told = run(
        "simulate", "gestures", path, "--seconds", "3", "--placement", "sip6", "--camera", camera, "--also", "gestures",
        "--bystanders", "1", "--keypoints", "coco17", "--detector.mixed", "0", "--width", "1280", "--height", "720",
    )  # fmt: skip
    assert told.code == 0
    assert f"2 wearers with 12 sensors, {camera} camera" in told.out
    scene = read_scene(path)
    assert [len(wearer.imus) for wearer in scene.wearers] == [6, 6]
    assert (scene.camera.model.width, scene.camera.moving) == (1280, camera == "walking")
    assert (scene.camera.mount is None) == (camera == "fixed")
    assert scene.camera.detections.keypoints.name == "coco17"
    assert set(np.unique(scene.truth.wearer)) == {-1, 0, 1}


def test_further_people_need_a_camera(run, tmp_path: Path) -> None:
    told = run("simulate", "gestures", tmp_path / "scene.mcap", "--bystanders", "2")
    assert told.code != 0
    assert "--camera" in told.err
    assert not (tmp_path / "scene.mcap").exists()
