"""Several cameras: those of known pose tie everything to their world, others are found, and each may see nobody."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from filmed_gestures import FROM_STRAPS, QUICK, camera_of

from vip_factors.estimate import Estimate
from vip_factors.evaluate.evaluation import evaluate_scene
from vip_factors.findings import sentences
from vip_factors.geometry.rotations import angle_between
from vip_factors.io.mcap_estimate import read_estimate, write_estimate
from vip_factors.pipeline import smooth
from vip_factors.sensors.calibration import preset
from vip_factors.sensors.camera import UNCALIBRATED_FOCAL_SIGMA, VideoClock
from vip_factors.sensors.scene import Camera, Scene
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.scene import Performer, simulate_scene
from vip_factors.simulate.settings import SceneSettings
from vip_factors.simulate.staging import placed


@cache
def filmed(camera: str = "fixed", cameras: int = 1, known_pose: bool | None = None) -> Scene:
    """One wearer of ten sensors, four seconds."""
    motion = placed(gestures(4.0), 0.3, (0.4, -0.2))
    settings = SceneSettings(camera=camera, cameras=cameras, known_camera_pose=known_pose, azimuth_deg=20.0)
    return simulate_scene([Performer("anna", motion, preset("tnt10", motion.skeleton))], settings, seed=1)


def global_mm(scene: Scene, estimate: Estimate) -> float:
    """Mean joint error with nothing aligned."""
    motion, truth = estimate.wearers[0].motion, scene.wearers[0].truth.motion
    nearest = np.rint((motion.time - truth.start) * truth.rate).astype(int)
    off = motion.state.p_world_joint - truth.state.p_world_joint[nearest]
    return float(1e3 * np.linalg.norm(off, axis=2).mean())


def seeing_nobody(camera: Camera) -> Camera:
    found = camera.detections
    return replace(camera, detections=found.select(np.zeros(len(found), bool)), truth=None)


def test_more_known_cameras_tell_more() -> None:
    one, three = filmed(known_pose=True), filmed(cameras=3)
    alone, together = smooth(one, QUICK), smooth(three, QUICK)
    assert global_mm(three, together) < 0.9 * global_mm(one, alone)
    assert global_mm(three, together) < 50
    assert together.findings == ()
    np.testing.assert_array_equal(together.camera.path.p_world_camera, three.camera.known_path.p_world_camera)


def test_a_moving_camera_is_found_in_the_world_of_a_known_one() -> None:
    scene = filmed("hand-held", cameras=3)
    estimate = smooth(scene, FROM_STRAPS)
    assert global_mm(scene, estimate) < 60
    path, truth = estimate.camera.path, scene.camera.truth.path.at(estimate.camera.path.time)
    assert np.median(np.linalg.norm(path.p_world_camera - truth.p_world_camera, axis=1)) < 0.15
    assert np.median(angle_between(path.R_world_camera, truth.R_world_camera)) < np.deg2rad(3.0)


def test_a_standing_camera_of_unknown_pose_is_found_too() -> None:
    scene = filmed(cameras=2, known_pose=False)
    estimate = smooth(scene, FROM_STRAPS)
    assert camera_of(scene).known_path is None
    assert global_mm(scene, estimate) < 80
    off = estimate.camera.path.p_world_camera[0] - scene.camera.truth.path.p_world_camera[0]
    assert np.linalg.norm(off) < 0.25


def test_a_first_camera_that_shows_nobody_is_left_out() -> None:
    scene = filmed("hand-held", cameras=2)
    blind = replace(scene, cameras=(seeing_nobody(camera_of(scene)), *scene.cameras[1:]))
    estimate = smooth(blind, FROM_STRAPS)
    assert [camera.name for camera in estimate.cameras] == ["camera_2"]
    assert list(evaluate_scene(estimate, blind).cameras) == ["camera_2"]
    assert any("'camera' is not used" in sentence for sentence in sentences(estimate.findings))
    assert global_mm(scene, estimate) < 80


@pytest.mark.slow
def test_known_cameras_that_show_nobody_do_no_harm() -> None:
    scene = filmed("hand-held", cameras=2)
    blind = replace(scene, cameras=(camera_of(scene), *map(seeing_nobody, scene.cameras[1:])))
    estimate = smooth(blind, FROM_STRAPS)
    plain = smooth(replace(scene, cameras=scene.cameras[:1]), FROM_STRAPS)
    np.testing.assert_array_equal(estimate.wearers[0].motion.p_world_pelvis, plain.wearers[0].motion.p_world_pelvis)
    assert any("'camera_2' is not used" in sentence for sentence in sentences(estimate.findings))


@cache
def nobody_calibrated(camera: str = "fixed") -> Scene:
    """Two cameras of unknown pose and lens, the second's video half a second late."""
    scene = filmed(camera, cameras=2, known_pose=False)
    first, second = (
        replace(one, model=one.model.zoomed(error), focal_sigma=UNCALIBRATED_FOCAL_SIGMA, known_path=None)
        for one, error in zip(scene.cameras, (-0.15, 0.15), strict=True)
    )
    late = second.clock.offset + 0.02  # of which half a video frame is found with the motion
    return replace(scene, cameras=(first, replace(second, clock=VideoClock(late))))


@cache
def solved(camera: str) -> Estimate:
    return smooth(nobody_calibrated(camera), FROM_STRAPS)


@pytest.mark.parametrize("camera", ["fixed", "hand-held"])
def test_cameras_that_nobody_calibrated_are_found_together(camera: str) -> None:
    scene = filmed(camera, cameras=2, known_pose=False)
    estimate = solved(camera)
    assert [camera.name for camera in estimate.cameras] == [camera.name for camera in scene.cameras]
    first, second = estimate.cameras
    apart = second.path.p_world_camera[0] - first.path.at(second.path.time).p_world_camera[0]
    truths = [camera.truth.path for camera in scene.cameras]
    true_apart = truths[1].p_world_camera[0] - truths[0].at(second.path.time).p_world_camera[0]
    assert np.linalg.norm(apart) == pytest.approx(np.linalg.norm(true_apart), rel=0.1)  # depth and zoom hang together
    for found, true in zip(estimate.cameras, scene.cameras, strict=True):
        assert abs(np.log(found.model.focal[0] / true.model.focal[0])) < 3 * found.focal_sigma
        assert 0 < found.focal_sigma < UNCALIBRATED_FOCAL_SIGMA
    assert second.clock.offset == pytest.approx(scene.cameras[1].clock.offset, abs=0.01)
    assert second.residual_px.shape == (len(estimate.wearers[0].motion), 1)
    for found, true in zip(estimate.cameras, scene.cameras, strict=True):
        assert np.mean(found.wearer_of_detection == true.truth.wearer) > 0.9


def test_cameras_that_have_no_wearer_in_common_are_not_put_into_one_world() -> None:
    scene = nobody_calibrated()
    blind = replace(scene, cameras=(camera_of(scene), *map(seeing_nobody, scene.cameras[1:])))
    estimate = smooth(blind, FROM_STRAPS)
    assert [camera.name for camera in estimate.cameras] == ["camera"]
    assert any("'camera_2' is not used" in sentence for sentence in sentences(estimate.findings))


def test_estimates_of_several_cameras_are_read_as_they_were_written(tmp_path: Path) -> None:
    estimate = solved("hand-held")
    write_estimate(estimate, tmp_path / "e.mcap")
    read = read_estimate(tmp_path / "e.mcap")
    assert [camera.name for camera in read.cameras] == [camera.name for camera in estimate.cameras]
    for one, other in zip(read.cameras, estimate.cameras, strict=True):
        np.testing.assert_allclose(one.path.p_world_camera, other.path.p_world_camera, atol=1e-12)
        np.testing.assert_array_equal(one.residual_px, other.residual_px)
        np.testing.assert_array_equal(one.wearer_of_detection, other.wearer_of_detection)
        assert (one.model, one.clock, one.focal_sigma) == (other.model, other.clock, other.focal_sigma)


def test_windows_have_all_cameras() -> None:
    scene = nobody_calibrated("hand-held")
    windows = replace(FROM_STRAPS.windows, window_s=1.6, overlap_s=0.6, above_s=3.0, calibration_stretches=1,
                      calibration_stretch_s=2.4)  # fmt: skip
    whole, parts = solved("hand-held"), smooth(scene, replace(FROM_STRAPS, windows=windows))
    assert [len(camera.path) for camera in parts.cameras] == [len(camera.path) for camera in whole.cameras]
    for one, other in zip(parts.cameras, whole.cameras, strict=True):
        assert one.model.focal[0] == pytest.approx(other.model.focal[0], rel=0.08)
        assert np.mean(one.wearer_of_detection == other.wearer_of_detection) > 0.9


def test_a_camera_that_was_moved_does_not_take_the_others_along() -> None:
    scene = nobody_calibrated()
    first, second = scene.cameras
    detections = second.detections
    pixels = detections.pixels + np.where(detections.frame[:, None, None] > 60, [300.0, 100.0], 0.0)
    moved = replace(second, detections=replace(detections, pixels=pixels))
    estimate, alone = (
        smooth(replace(scene, cameras=(first, moved)), FROM_STRAPS),
        smooth(replace(scene, cameras=(first,)), FROM_STRAPS),
    )
    assert [camera.name for camera in estimate.cameras] == ["camera"]
    assert any("'camera_2' is not used" in sentence for sentence in sentences(estimate.findings))
    np.testing.assert_allclose(
        estimate.wearers[0].motion.R_parent_child, alone.wearers[0].motion.R_parent_child, atol=0.05
    )
