"""The variables of a filmed scene as arrays, and as GTSAM values."""

from dataclasses import dataclass, field

import gtsam
import numpy as np

from vip_factors.factors.camera_pose import CameraPoses
from vip_factors.geometry.rotations import Array, exp
from vip_factors.graph.keys import camera_heading_key, camera_key, camera_mounting_key, clock_key
from vip_factors.graph.state import GraphState

POSE, HEADING, MOUNTING, CLOCK = slice(0, 6), 6, slice(7, 10), 10  # columns of the camera's tangent
CAMERA = 11  # their number


@dataclass(frozen=True)
class CameraState:
    """Values of the camera's variables.

    Attributes:
        poses: one for each frame, or a single one.
        heading: radians, of the IMU on it.
        R_camera_imu: ``(3, 3)``.
        clock: seconds by which the video's clock must still be put forward.
    """

    poses: CameraPoses
    heading: float = 0.0
    R_camera_imu: Array = field(default_factory=lambda: np.eye(3))
    clock: float = 0.0

    def at_frames(self, frames: slice) -> CameraPoses:
        """The poses at a stretch of frames."""
        if len(self.poses) > 1:
            return CameraPoses(self.poses.R_world_camera[frames], self.poses.p_world_camera[frames])
        count = frames.stop - frames.start
        return CameraPoses(
            np.broadcast_to(self.poses.R_world_camera, (count, 3, 3)),
            np.broadcast_to(self.poses.p_world_camera, (count, 3)),
        )

    def retract(self, poses: Array, static: Array) -> "CameraState":
        """Move by tangent steps: ``poses`` ``(T or 1, 6)``, and ``static`` ``(11,)`` of which the pose is not used."""
        return CameraState(
            self.poses.retract(poses),
            self.heading + float(static[HEADING]),
            self.R_camera_imu @ exp(static[MOUNTING]),
            self.clock + float(static[CLOCK]),
        )


@dataclass(frozen=True)
class SceneState:
    """Values of all variables of a scene."""

    wearers: tuple[GraphState, ...]
    camera: CameraState

    def to_values(self) -> gtsam.Values:
        """As GTSAM values, under the keys of :mod:`vip_factors.graph.keys`."""
        values = gtsam.Values()
        for number, wearer in enumerate(self.wearers):
            values.insert(wearer.to_values(number))
        camera = self.camera
        for t, (R, p) in enumerate(zip(camera.poses.R_world_camera, camera.poses.p_world_camera, strict=True)):
            values.insert(camera_key(t), gtsam.Pose3(gtsam.Rot3(R), p))
        values.insert(camera_heading_key(), camera.heading)
        values.insert(camera_mounting_key(), gtsam.Rot3(camera.R_camera_imu))
        values.insert(clock_key(), camera.clock)
        return values
