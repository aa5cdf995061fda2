"""A small scene made by hand: two wearers and a bystander in front of a camera, and an estimate with chosen errors."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.keypoints import keypoint_set
from vip_factors.body.kinematics import Motion
from vip_factors.estimate import CameraEstimate, Estimate, WearerEstimate
from vip_factors.geometry.rotations import exp, rotation_z, transpose
from vip_factors.sensors.calibration import SensorCalibration, preset
from vip_factors.sensors.camera import CameraModel, CameraPath
from vip_factors.sensors.detections import Detections, keypoints_in_image
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.recording import Recording, Subject, Truth
from vip_factors.sensors.scene import Camera, CameraMount, CameraTruth, Scene
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.scene import looking_at

MODEL = CameraModel(1280, 720, (1000.0, 1000.0), (640.0, 360.0))
RATE, VIDEO_RATE = 60.0, 30.0


@dataclass(frozen=True)
class Injected:
    """Errors of the estimate: the gauge (yaw rad, shift m), then what no gauge removes."""

    yaw: float = 0.0
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    heading: float = 0.0  # rad, of the left foot alone
    mounting: float = 0.0  # rad, of every sensor
    camera_m: float = 0.0  # forward, along the optical axis
    camera_rad: float = 0.0  # about the camera's z
    apart_m: float = 0.0  # the second wearer moved away from the first, up
    sigma: float = 0.05


def placed(motion: Motion, at: tuple[float, float], turned: float, name: str) -> Motion:
    """The motion begun elsewhere, facing elsewhere."""
    R = motion.R_parent_child.copy()
    R[:, 0] = rotation_z(turned) @ R[:, 0]
    root = motion.p_world_pelvis @ rotation_z(turned).T + [*at, 0.0]
    return replace(motion, R_parent_child=R, p_world_pelvis=root, name=name)


def camera_path(seconds: float, moving: bool = True) -> CameraPath:
    time = np.arange(round(seconds * RATE) + 1) / RATE
    p = np.stack([-4.5 + 0.15 * np.sin(time), 0.5 * time - 1.0, 1.5 + 0.05 * np.sin(2 * time)], axis=1)
    R = looking_at(p, np.tile([0.3, 0.2, 0.9], (len(time), 1)))
    return CameraPath(time, R, p) if moving else CameraPath(time[:1], R[:1], p[:1])


def recording_of(motion: Motion, name: str, stature: float) -> Recording:
    placement = preset("totalcapture13", motion.skeleton)
    imus, known = {}, {}
    for index, site in enumerate(placement.sites):
        heading = 0.1 * index - 0.5
        R_world_sensor = motion.state.R_world_bone[:, site.bone_index] @ site.R_bone_sensor
        force = np.einsum("tji,j->ti", R_world_sensor, [0.0, 0.0, 9.81])
        imus[site.sensor] = ImuStream(site.sensor, motion.time, force, rotation_z(-heading) @ R_world_sensor)
        known[site.sensor] = SensorCalibration(heading, site.R_bone_sensor)
    return Recording(name, Subject(name, stature), imus, placement, "none", Truth(motion, known))


@cache
def scene_sample(seconds: float = 2.0, moving: bool = True, noise_px: float = 0.0, wearers: int = 2) -> Scene:
    """Three people, all seen in every frame; the first ones wear sensors. Detections are in the order of the three."""
    walkers = {"ann": (1.65, (0.0, -0.9), 0.3), "bob": (1.85, (0.6, 0.7), 2.4), "stranger": (1.75, (1.5, -0.3), 1.2)}
    motions = {
        name: placed(gestures(seconds, RATE, skeleton_from_stature(stature)), at, turned, name)
        for name, (stature, at, turned) in walkers.items()
    }
    path, keypoints = camera_path(seconds, moving), keypoint_set("coco17")
    time = np.arange(round(seconds * VIDEO_RATE) + 1) / VIDEO_RATE
    seen = [keypoints_in_image(motion, keypoints, path, MODEL, time) for motion in motions.values()]
    pixels = np.stack(seen, axis=1).reshape(-1, len(keypoints), 2)
    noise = noise_px * np.random.default_rng(0).standard_normal(pixels.shape)
    detections = Detections(
        keypoints, time, np.repeat(np.arange(len(time)), 3), pixels + noise, np.full(pixels.shape[:2], 0.9)
    )
    recordings = tuple(recording_of(motions[name], name, walkers[name][0]) for name in ("ann", "bob")[:wearers])
    along = path.at(recordings[0].truth.motion.time)
    imu = ImuStream("camera", along.time, None, rotation_z(0.4) @ along.R_world_camera)
    whose = [number if number < wearers else -1 for number in range(3)]
    truth = CameraTruth(path, np.tile(whose, len(time)), pixels, SensorCalibration(-0.4, np.eye(3)))
    camera = Camera("phone", MODEL, detections, moving, CameraMount(imu), truth=truth)
    return Scene("two of three", recordings, (camera,))


def estimate_of(scene: Scene, injected: Injected | None = None) -> Estimate:
    """The truth with some errors."""
    error = injected or Injected()
    R_gauge, shift = rotation_z(error.yaw), np.array(error.shift)
    wearers = []
    for index, wearer in enumerate(scene.wearers):
        motion = wearer.truth.motion
        R = motion.R_parent_child.copy()
        R[:, 0] = R_gauge @ R[:, 0]
        root = (motion.p_world_pelvis + np.array([0, 0, error.apart_m * index])) @ R_gauge.T + shift
        calibration = {
            name: SensorCalibration(
                one.heading + error.yaw + error.heading * (name == "left_foot"),
                one.R_bone_sensor @ exp([error.mounting, 0, 0]),
                error.sigma,
                np.full(3, error.sigma),
            )
            for name, one in wearer.truth.calibration.items()
        }
        residuals = {"orientation_deg": np.full((len(motion), len(calibration)), 3.0)}
        wearers.append(
            WearerEstimate(
                wearer.name, "VIP", replace(motion, R_parent_child=R, p_world_pelvis=root), calibration, None,
                residuals, tuple(calibration),
            )
        )  # fmt: skip
    path = scene.camera.truth.path
    R_true, p_true = path.R_world_camera, path.p_world_camera + error.camera_m * path.R_world_camera[:, :, 2]
    found = CameraPath(path.time, R_gauge @ R_true @ exp([0, 0, error.camera_rad]), p_true @ R_gauge.T + shift)
    camera = CameraEstimate(
        "phone",
        scene.camera.model,
        found,
        SensorCalibration(-0.4 + error.yaw, transpose(exp([error.mounting, 0, 0])), error.sigma),
    )
    camera = replace(camera, wearer_of_detection=scene.camera.truth.wearer.copy())
    return Estimate(scene.name, "VIP", tuple(wearers), (camera,))


def with_labels(estimate: Estimate, labels: np.ndarray) -> Estimate:
    """The estimate with other labels of its first camera's detections."""
    first, *others = estimate.cameras
    return replace(estimate, cameras=(replace(first, wearer_of_detection=labels), *others))
