"""The set-up of a scene, gathered from the first messages of an MCAP file."""

from typing import Any

import numpy as np

from vip_factors.errors import FileFormatError
from vip_factors.geometry.quaternions import Order, matrix_from_quaternion
from vip_factors.io.live.growing_channels import CAMERA, Route
from vip_factors.io.live.messages import camera_of, wearer_of
from vip_factors.io.mcap_messages import time_ns_of
from vip_factors.io.mcap_writer import NS_PER_S
from vip_factors.io.schemas.camera_info_pb2 import CameraInfo
from vip_factors.io.schemas.detections_2d_pb2 import Detections2D
from vip_factors.io.schemas.imu_sample_pb2 import ImuSample
from vip_factors.io.schemas.scene_info_pb2 import SceneInfo
from vip_factors.sensors.camera_model import VideoClock
from vip_factors.sensors.camera_path import CameraPath
from vip_factors.sensors.live import LiveCamera, LiveSetup

SAMPLES = (ImuSample, Detections2D)
# What comes once, by the names of the messages.
INFO, SUBJECT, PLACEMENT = "RecordingInfo", "Subject", "SensorPlacement"
CAMERA_INFO, CALIBRATION, POSE = "CameraInfo", "CameraCalibration", "PoseInFrame"


class GatheredSetup:
    """Takes the messages that come once, and says when the set-up is whole."""

    def __init__(self) -> None:
        self._scene: SceneInfo | None = None
        self._of: dict[str, dict[str, Any]] = {}  # by owner, then by the message's name; the first pose of a camera
        self._samples = False

    def take(self, route: Route, message: Any) -> None:
        """One message, a sample's too."""
        if route.kind is SceneInfo:
            self._scene = message
        elif route.kind in SAMPLES:
            self._samples = True
            self._of.setdefault(route.owner, {})
        else:
            self._of.setdefault(route.owner, {}).setdefault(route.kind.DESCRIPTOR.name, message)

    @property
    def missing(self) -> list[str]:
        """What a set-up needs still, in words; without a SceneInfo, nobody knows before the first sample."""
        lacks = [
            f"{kind} of {owner or 'the wearer'}"
            for owner in self._wearers
            for kind in (INFO, SUBJECT, PLACEMENT)
            if not self._has(owner, kind)
        ]
        lacks += [
            f"{kind} on {owner}"
            for owner in self._cameras
            for kind in (CAMERA_INFO, CALIBRATION)
            if not self._has(owner, kind)
        ]
        if not lacks and self._scene is None and not self._samples:
            lacks.append("SceneInfo, or a sample")
        return lacks

    @property
    def awaits_poses(self) -> bool:
        """Whether the known pose of a camera that stands still is to come yet."""
        return any(
            info.known_poses == 1 and not info.moving and POSE not in self._of[owner]
            for owner, info in self._infos().items()
        )

    @property
    def start_ns(self) -> int:
        """Absolute time of t = 0."""
        return time_ns_of(self._of[self._wearers[0]][INFO].start)

    def setup(self) -> LiveSetup:
        """The set-up.

        Raises:
            InputError: for what no wearer or camera can be, or if something is missing.
        """
        if self.missing:
            raise FileFormatError(f"expected a recording or a scene; there is no {', no '.join(self.missing)}")
        infos = [self._of[owner][INFO] for owner in self._wearers]
        wearers = tuple(
            wearer_of(self._of[owner][SUBJECT], self._of[owner][PLACEMENT], info.initial_pose)
            for owner, info in zip(self._wearers, infos, strict=True)
        )
        name = self._scene.name if self._scene is not None else infos[0].name
        return LiveSetup(name, wearers, tuple(self._camera(owner) for owner in self._cameras), self.start_ns)

    def names(self, setup: LiveSetup) -> dict[str, str]:
        """Names of wearers and cameras by what their topics begin with."""
        wearers = {owner: wearer.name for owner, wearer in zip(self._wearers, setup.wearers, strict=True)}
        return wearers | {owner: camera.name for owner, camera in zip(self._cameras, setup.cameras, strict=True)}

    def clocks(self) -> dict[str, VideoClock]:
        """What lies between each camera's clock and the IMUs', by what its topics begin with."""
        return {owner: VideoClock(info.time_offset_s, info.time_drift) for owner, info in self._infos().items()}

    def findings(self) -> list[str]:
        """What of the file's cameras cannot be used ahead of time."""
        return [
            f"camera '{info.name}' is said to move on a known path, which a growing file does not hold yet: its poses "
            "are estimated instead"
            for info in self._infos().values()
            if info.moving and info.known_poses
        ]

    @property
    def _wearers(self) -> list[str]:
        if self._scene is not None and self._scene.wearer_topics:
            return list(self._scene.wearer_topics)
        return [owner for owner in self._of if not owner.startswith(CAMERA)] or [""]

    @property
    def _cameras(self) -> list[str]:
        if self._scene is not None:
            return [*([CAMERA] if self._scene.has_camera else []), *self._scene.further_camera_topics]
        found = [owner for owner in self._of if owner.startswith(CAMERA)]
        return sorted(found, key=lambda owner: owner != CAMERA)  # the first camera first, then as they came

    def _has(self, owner: str, kind: str) -> bool:
        return kind in self._of.get(owner, {})

    def _infos(self) -> dict[str, CameraInfo]:
        return {owner: self._of[owner][CAMERA_INFO] for owner in self._cameras if self._has(owner, CAMERA_INFO)}

    def _camera(self, owner: str) -> LiveCamera:
        of = self._of[owner]
        info = of[CAMERA_INFO]
        pose = of.get(POSE) if info.known_poses == 1 and not info.moving else None
        return camera_of(info, of[CALIBRATION], None if pose is None else _standing(pose, self.start_ns))


def _standing(pose: Any, start_ns: int) -> CameraPath:
    """A ``foxglove.PoseInFrame`` as the path of a camera that stands still."""
    at, q = pose.pose.position, pose.pose.orientation
    R_world_camera = matrix_from_quaternion([q.x, q.y, q.z, q.w], Order.XYZW)
    time = (time_ns_of(pose.timestamp) - start_ns) / NS_PER_S
    return CameraPath(np.array([time]), R_world_camera[None], np.array([[at.x, at.y, at.z]]))
