"""Film without noise, solve, and everything must come back: bodies, camera, headings and mountings."""

from dataclasses import replace

import numpy as np
import pytest
from test_recovery import EXACT

from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.estimate import Estimate
from vip_factors.evaluate.evaluation import evaluate_scene
from vip_factors.evaluate.metrics import common_frames, mpjpe
from vip_factors.factor_settings import (
    CameraAccelerationSettings,
    CameraFactorSettings,
    CameraOrientationSettings,
    CameraVelocitySettings,
    ReprojectionSettings,
    RobustLoss,
)
from vip_factors.geometry.rotations import Array, angle_between, transpose
from vip_factors.pipeline import smooth
from vip_factors.sensors.calibration import Placement, SensorSite
from vip_factors.sensors.scene import Scene
from vip_factors.settings import CalibrationSettings, Settings
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.scene import Performer, simulate_scene
from vip_factors.simulate.settings import SceneSettings, SimulateSettings

# The picture believed, what is assumed of cameras all but switched off.
EXACT_CAMERA = CameraFactorSettings(
    ReprojectionSettings(persistence=1.0, spread=1e-3, adaptive=False, least_px=0.2, loss=RobustLoss()),
    CameraOrientationSettings(sigma_deg=0.05, loss=RobustLoss()),
    CameraAccelerationSettings(sigma=0.05, loss=RobustLoss()),
    CameraVelocitySettings(turn_sigma_deg_s=1e5, speed_sigma=1e4),
)
LIMBS_AND_TRUNK = (
    "pelvis", "left_hip", "right_hip", "left_knee", "right_knee", "left_shoulder", "right_shoulder", "left_elbow",
    "right_elbow", "spine3", "head",
)  # fmt: skip


def filmed(camera: str, bones: tuple[str, ...], mounting_error_deg: float) -> Scene:
    """Somebody with a sensor on each of some bones, five centimetres off the joint, in front of a perfect detector."""
    motion = gestures(2.0)
    sites = [SensorSite(name, name, np.array([0.03, -0.02, 0.04]), np.eye(3), 1.0) for name in bones]
    imu = SimulateSettings.noise_free(imu_rate=400.0, heading_offset_deg=15.0, mounting_error_deg=mounting_error_deg)
    settings = SceneSettings.noise_free(camera=camera, imu=imu)
    return simulate_scene([Performer("anna", motion, Placement(tuple(sites)))], settings, seed=1)


def solved(scene: Scene, free_mountings: bool) -> Estimate:
    calibration = CalibrationSettings(estimate_mountings=free_mountings)
    settings = Settings(
        frame_rate=30.0,
        calibration_rate=30.0,
        covariance=False,
        calibration=calibration,
        factors=EXACT,
        camera=EXACT_CAMERA,
    )
    return smooth(scene, replace(settings, fusion=replace(settings.fusion, relative_decrease=1e-6)))


def camera_seen_from_the_pelvis(estimate: Estimate, scene: Scene) -> tuple[Array, Array]:
    """Errors of the camera's pose relative to the wearer's: metres and radians, whatever the world's gauge.

    A world without contacts is free not only to turn and shift but to drift at a constant speed.
    """
    assert estimate.camera is not None
    assert scene.camera.truth is not None
    assert scene.wearers[0].truth is not None
    ours, truth, _ = common_frames(estimate.wearers[0].motion, scene.wearers[0].truth.motion)
    relative = []
    for motion, path in ((ours, estimate.camera.path), (truth, scene.camera.truth.path)):
        camera, pelvis = path.at(motion.time), motion.R_parent_child[:, 0]
        p = np.einsum("tji,tj->ti", pelvis, camera.p_world_camera - motion.p_world_pelvis)
        relative.append((transpose(pelvis) @ camera.R_world_camera, p))
    (R, p), (R_true, p_true) = relative
    return np.linalg.norm(p - p_true, axis=1), angle_between(R, R_true)


@pytest.mark.parametrize("camera", ["fixed", "hand-held"])
def test_bodies_and_camera_come_back(camera: str) -> None:
    scene = filmed(camera, JOINT_NAMES, 0.0)
    estimate = solved(scene, free_mountings=False)
    assert scene.wearers[0].truth is not None
    ours, truth, _ = common_frames(estimate.wearers[0].motion, scene.wearers[0].truth.motion)
    assert mpjpe(ours, truth) < 1.0  # mm
    shift, turn = camera_seen_from_the_pelvis(estimate, scene)
    inside = slice(5, -5)  # the ends of a path have accelerations on one side only
    assert shift[inside].max() < 1e-3
    assert np.rad2deg(turn[inside].max()) < 0.05
    headings = [one.heading for one in estimate.wearers[0].calibration.values()]
    assert scene.wearers[0].truth.calibration is not None
    true = [one.heading for one in scene.wearers[0].truth.calibration.values()]
    error = np.rad2deg(np.array(headings) - np.array(true))
    assert np.ptp(error) < 0.05  # the world's own yaw is a choice


@pytest.mark.slow
def test_mountings_come_back() -> None:
    """Each starts 8° off about each axis. How far the pelvis and the chest are tilted, keypoints hardly show."""
    scene = filmed("fixed", LIMBS_AND_TRUNK, 8.0)
    evaluation = evaluate_scene(solved(scene, free_mountings=True), scene)
    assert evaluation["mpjpe"] < 1.0
    assert evaluation["heading_error"] < 0.05
    assert evaluation["camera_translation"] < 1e-3
    assert evaluation["camera_rotation"] < 0.05
    mountings = {name: row["mounting_deg"] for name, row in evaluation.wearers["anna"].sensors.items()}
    trunk = {mountings.pop("pelvis"), mountings.pop("spine3")}
    assert max(mountings.values()) < 0.05
    assert max(trunk) < 1.0
