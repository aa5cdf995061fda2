"""Cameras of known pose beside the first one: they tie everything to their world, and each may see nobody."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from filmed_gestures import QUICK, camera_of

from vip_factors.estimate import Estimate
from vip_factors.findings import sentences
from vip_factors.geometry.rotations import angle_between
from vip_factors.pipeline import smooth
from vip_factors.sensors.calibration import preset
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
    return replace(camera, detections=found.select(np.zeros(len(found), bool)))


def test_more_known_cameras_tell_more() -> None:
    one, three = filmed(known_pose=True), filmed(cameras=3)
    alone, together = smooth(one, QUICK), smooth(three, QUICK)
    assert global_mm(three, together) < 0.9 * global_mm(one, alone)
    assert global_mm(three, together) < 50
    assert together.findings == ()
    np.testing.assert_array_equal(together.camera.path.p_world_camera, three.camera.known_path.p_world_camera)


def test_a_moving_camera_is_found_in_the_world_of_a_known_one() -> None:
    scene = filmed("hand-held", cameras=3)
    estimate = smooth(scene, QUICK)
    assert global_mm(scene, estimate) < 60
    path, truth = estimate.camera.path, scene.truth.camera.at(estimate.camera.path.time)
    assert np.median(np.linalg.norm(path.p_world_camera - truth.p_world_camera, axis=1)) < 0.15
    assert np.median(angle_between(path.R_world_camera, truth.R_world_camera)) < np.deg2rad(3.0)


def test_a_standing_camera_of_unknown_pose_is_found_too() -> None:
    scene = filmed(cameras=2, known_pose=False)
    estimate = smooth(scene, QUICK)
    assert camera_of(scene).known_path is None
    assert global_mm(scene, estimate) < 80
    off = estimate.camera.path.p_world_camera[0] - scene.truth.camera.p_world_camera[0]
    assert np.linalg.norm(off) < 0.25


def test_a_first_camera_that_shows_nobody_is_left_out() -> None:
    scene = filmed("hand-held", cameras=2)
    blind = replace(scene, camera=seeing_nobody(camera_of(scene)), truth=None)
    estimate = smooth(blind, QUICK)
    assert estimate.camera is None
    assert any("'camera' is left out" in one for one in sentences(estimate.findings))
    assert global_mm(scene, estimate) < 80


@pytest.mark.slow
def test_known_cameras_that_show_nobody_do_no_harm() -> None:
    scene = filmed("hand-held", cameras=2)
    blind = replace(scene, further_cameras=tuple(map(seeing_nobody, scene.further_cameras)), truth=None)
    estimate = smooth(blind, QUICK)
    plain = smooth(replace(scene, further_cameras=(), truth=None), QUICK)
    np.testing.assert_array_equal(estimate.wearers[0].motion.p_world_pelvis, plain.wearers[0].motion.p_world_pelvis)
    assert any("'camera_2' is left out" in one for one in sentences(estimate.findings))
