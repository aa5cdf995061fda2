"""What a fixed-lag tracker would answer, made of a known scene: the truth, one lag late, with standard deviations."""

from collections.abc import Iterator

import numpy as np
from scene_sample import scene_sample

from vip_factors.body.kinematics import Motion
from vip_factors.findings import bare
from vip_factors.live_estimate import LiveCameraEstimate, LiveCameraPose, LiveEstimate, LivePose, LiveWearerEstimate
from vip_factors.sensors.calibration import SensorCalibration
from vip_factors.sensors.live import stream_head
from vip_factors.sensors.scene import Camera, Scene

LAG = 15  # frames


def live_scene(seconds: float = 1.0, wearers: int = 2, filmed: bool = True) -> Scene:
    scene = scene_sample(seconds)
    return Scene(scene.name, scene.wearers[:wearers], scene.cameras if filmed else ())


def answers(scene: Scene, covariance: bool = True, lag: int = LAG) -> Iterator[LiveEstimate]:
    """One answer a frame of the truth at 60 Hz; its first pose is smoothed once the lag is over."""
    for frame in range(len(truth_of(scene, 0))):
        yield answer(scene, frame, covariance, lag)


def answer(scene: Scene, frame: int, covariance: bool = True, lag: int = LAG) -> LiveEstimate:
    time = float(truth_of(scene, 0).time[frame])
    wearers = []
    for index, wearer in enumerate(scene.wearers):
        sigma = 0.5 / (1 + frame)
        calibration = {
            name: SensorCalibration(one.heading + sigma, one.R_bone_sensor, sigma)
            for name, one in wearer.truth.calibration.items()
        }
        smoothed = pose(scene, index, frame - lag, covariance) if frame >= lag else None
        newest = pose(scene, index, frame, covariance)
        wearers.append(LiveWearerEstimate(wearer.subject.name, newest, smoothed, calibration, index))
    cameras = tuple(
        LiveCameraEstimate(
            camera.name,
            camera.model,
            camera_pose(camera, time),
            camera_pose(camera, time - lag / 60) if frame >= lag else None,
        )
        for camera in scene.cameras
    )
    findings = (bare("the stream has begun"),) if frame == 0 else ()
    return LiveEstimate(frame, time, tuple(wearers), cameras, findings, 0.005, preliminary=frame < 3)


def truth_of(scene: Scene, index: int) -> Motion:
    return scene.wearers[index].truth.motion


def pose(scene: Scene, index: int, frame: int, covariance: bool) -> LivePose:
    motion = truth_of(scene, index)
    joints, root = (np.tile(1e-3 * np.eye(3), (24, 1, 1)), 1e-4 * np.eye(3)) if covariance else (None, None)
    time = float(motion.time[frame])
    return LivePose(time, motion.R_parent_child[frame], motion.p_world_pelvis[frame], joints, root)


def camera_pose(camera: Camera, time: float) -> LiveCameraPose:
    at = camera.truth.path.at(np.array([time]))
    return LiveCameraPose(time, at.R_world_camera[0], at.p_world_camera[0], np.diag(np.repeat([1e-4, 9e-4], 3)))


def setup_of(scene: Scene) -> Scene:
    return stream_head(scene)
