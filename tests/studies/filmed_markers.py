"""A camera beside real sensors: what a detector would have seen of somebody whose markers were recorded.

The motion is the person's own, and so are the joint centres; the lens, how the camera is held and what the detector
does wrong are the simulator's (:mod:`~vip_factors.simulate.detector_settings`).
"""

from typing import Literal

import numpy as np

from tests.studies.marker_body import MarkerBody, posed
from vip_factors.body.keypoints import keypoint_set
from vip_factors.body.kinematics import BodyState
from vip_factors.sensors.camera_path import CameraPath
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Camera, Scene, SceneTruth
from vip_factors.simulate.camera_motion import camera_motion
from vip_factors.simulate.detector import detect
from vip_factors.simulate.detector_view import Person
from vip_factors.simulate.scene import camera_mount
from vip_factors.simulate.scene_settings import SceneSettings

CameraName = Literal["standing", "carried"]
# A tripod of unknown pose, or a phone with a sensor in somebody's hands; feet are looked at, as gait is.
FILMING: dict[CameraName, SceneSettings] = {
    "standing": SceneSettings(camera="fixed", keypoints="body25", video_rate=25.0),
    "carried": SceneSettings(camera="hand-held", keypoints="body25", video_rate=25.0),
}


def filmed(recording: Recording, body: MarkerBody, camera: CameraName, seed: int) -> Scene:
    """The recording as a scene with one camera, which films while markers were recorded.

    Args:
        recording: of the same person's sensors.
        body: as optical markers show it, on the recording's clock; every so many-th of its frames is filmed.
        camera: stands at an unknown place, or is held in somebody's hands and has a sensor of its own.
        seed: of the camera's place and movement, and of the detector's errors.
    """
    settings = FILMING[camera]
    skeleton, state = posed(body, recording.subject.body())
    path = camera_motion(state.p_world_joint[None, :, 0], body.time, settings, np.random.default_rng([seed, 0xCA3E7A]))
    every = round(1 / (settings.video_rate * float(np.median(np.diff(body.time)))))
    time = body.time[::every]
    poses = path.bone(0, time)
    lens = CameraPath(time, poses.R_world_bone, poses.position)
    seen = BodyState(state.R_world_bone[::every], state.p_world_joint[::every])
    person = Person(skeleton, seen, np.ones(len(time), bool))
    found, owner, pixels = detect(
        [person], lens, settings.model, keypoint_set(settings.keypoints), settings.detector, seed
    )
    mount, calibration = camera_mount(path, settings, seed) if settings.has_camera_imu else (None, None)
    moving = camera == "carried"
    truth = SceneTruth(lens if moving else _standing(lens), owner, pixels, calibration)
    return Scene(recording.name, (recording,), Camera(camera, settings.model, found, moving, mount), truth)


def _standing(path: CameraPath) -> CameraPath:
    return CameraPath(path.time[:1], path.R_world_camera[:1], path.p_world_camera[:1])
