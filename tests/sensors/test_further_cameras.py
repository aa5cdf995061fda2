"""Further cameras of a scene: of any kind, and live streams have them too."""

from dataclasses import replace

import pytest
from scene_sample import scene_sample

from vip_factors.errors import RecordingError
from vip_factors.sensors.live import VideoFrame, live_samples, stream_head
from vip_factors.sensors.scene import Scene


def two_cameras() -> Scene:
    scene = scene_sample(0.5, moving=False)
    second = replace(scene.camera, name="left", known_path=scene.camera.truth.path, mount=None)
    return replace(scene, cameras=(scene.camera, second))


def test_all_cameras_are_listed_and_streamed() -> None:
    scene = two_cameras()
    assert [camera.name for camera in scene.cameras] == ["phone", "left"]
    setup = stream_head(scene)
    assert [camera.name for camera in setup.cameras] == ["phone", "left"]
    assert setup.cameras[1].known_path is scene.camera.truth.path
    frames = [sample for sample in live_samples(scene) if isinstance(sample, VideoFrame)]
    assert sorted({frame.camera for frame in frames}) == ["left", "phone"]
    assert len(frames) == 2 * len(scene.camera.detections.time)


def changed(**changes: object) -> dict:
    first, second = two_cameras().cameras
    return {"cameras": (first, replace(second, **changes))}


@pytest.mark.parametrize(
    ("wrong", "complaint"),
    [
        (changed(name="phone"), "unique name"),
    ],
)
def test_what_no_further_camera_can_be_is_refused(wrong: dict, complaint: str) -> None:
    with pytest.raises(RecordingError, match=complaint):
        replace(two_cameras(), **wrong)


def test_a_truth_belongs_to_its_detections() -> None:
    camera = scene_sample(0.5).camera
    with pytest.raises(RecordingError, match="camera 'phone': its truth does not belong to its detections"):
        replace(camera, detections=camera.detections.select(camera.truth.wearer == 0))
