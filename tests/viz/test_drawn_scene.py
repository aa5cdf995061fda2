"""A scene brought into one world."""

from dataclasses import replace

import numpy as np
import pytest
from scene_sample import Injected, estimate_of, scene_sample, with_labels

from vip_factors.body.keypoints import KEYPOINT_SETS
from vip_factors.sensors.camera import VideoClock
from vip_factors.sensors.scene import Scene
from vip_factors.viz.drawn_scene import drawn_scene
from vip_factors.viz.film import limb_pairs

GAUGE = Injected(yaw=2.5, shift=(3.0, 1.0, -0.4), heading=0.2)


@pytest.fixture(scope="module")
def sample() -> Scene:
    return scene_sample(0.5)


@pytest.mark.parametrize("with_camera", [True, False])
def test_an_estimate_in_another_gauge_lies_on_the_truth(sample: Scene, with_camera: bool) -> None:
    estimate = estimate_of(sample, GAUGE)
    if not with_camera:
        estimate = replace(estimate, cameras=())
    drawn = drawn_scene(sample, estimate)
    for wearer in drawn.wearers:
        assert wearer.motion.p_world_pelvis == pytest.approx(wearer.truth.p_world_pelvis, abs=1e-6)
        assert wearer.error_mm == pytest.approx(0.0, abs=1e-6)
    assert drawn.cameras[0].path.p_world_camera == pytest.approx(sample.camera.truth.path.p_world_camera, abs=1e-6)


def test_bodies_project_onto_their_detections(sample: Scene) -> None:
    drawn = drawn_scene(sample, estimate_of(sample, GAUGE))
    for wearer in drawn.wearers:
        mine = sample.camera.truth.wearer == wearer.index
        assert drawn.cameras[0].reprojected(wearer) == pytest.approx(sample.camera.truth.pixels[mine], abs=1e-5)
        assert drawn.cameras[0].reprojection_px(wearer) == pytest.approx(0.0, abs=1e-5)
    labels = sample.camera.truth.wearer.copy()
    labels[0] = -1  # the first frame's detection of the first wearer
    drawn = drawn_scene(sample, with_labels(estimate_of(sample, GAUGE), labels))
    assert np.isnan(drawn.cameras[0].reprojection_px(drawn.wearers[0])).tolist() == [True] + [False] * 15


def test_every_camera_has_its_own_labels(sample: Scene) -> None:
    estimate = estimate_of(sample, GAUGE)
    left = replace(estimate.camera, name="left", wearer_of_detection=estimate.camera.wearer_of_detection[::-1].copy())
    both = replace(sample, cameras=(sample.camera, replace(sample.camera, name="left")))
    drawn = drawn_scene(both, replace(estimate, cameras=(estimate.camera, left)))
    for camera, labels in zip(drawn.cameras, (estimate.camera, left), strict=True):
        np.testing.assert_array_equal(camera.labels, labels.wearer_of_detection)


def test_the_clock_of_the_video_is_the_estimates(sample: Scene) -> None:
    late = replace(sample, cameras=(replace(sample.camera, detections=sample.camera.detections.shifted(-0.2)),))
    estimate = estimate_of(late, GAUGE)
    drawn = drawn_scene(late, replace(estimate, cameras=(replace(estimate.camera, clock=VideoClock(0.2)),)))
    assert drawn.cameras[0].detections.time == pytest.approx(sample.camera.detections.time)
    assert drawn.cameras[0].reprojection_px(drawn.wearers[1]) == pytest.approx(0.0, abs=1e-5)


@pytest.mark.parametrize("name", KEYPOINT_SETS)
def test_limbs_exist_in_every_keypoint_set(name: str) -> None:
    pairs = limb_pairs(KEYPOINT_SETS[name])
    assert len(pairs) >= 16
    assert pairs.max() < len(KEYPOINT_SETS[name])
