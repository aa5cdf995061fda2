"""Where a camera was over time, and the gauge of a scene: its free yaw and shift, removed once for everything in it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.errors import InputError
from vip_factors.geometry.poses import Alignment, align_yaw
from vip_factors.geometry.quaternions import interpolate_points, interpolate_rotations
from vip_factors.geometry.rotations import Array, rotation_z, transpose, yaw_of


@dataclass(frozen=True)
class CameraPath:
    """Camera poses ``T_world_camera`` at ``T`` instants; one instant is a camera that stands still.

    Attributes:
        time: ``(T,)`` seconds from the recording's start, increasing.
        R_world_camera: ``(T, 3, 3)``; camera axes are OpenCV's (x right, y down, z forward).
        p_world_camera: ``(T, 3)`` metres.
    """

    time: Array
    R_world_camera: Array
    p_world_camera: Array

    def __post_init__(self) -> None:
        T = len(self.time)
        if T == 0 or self.R_world_camera.shape != (T, 3, 3) or self.p_world_camera.shape != (T, 3):
            raise InputError(
                f"camera path of {T} instants with rotations {self.R_world_camera.shape} and positions "
                f"{self.p_world_camera.shape}: expected (T, 3, 3) and (T, 3)"
            )

    def __len__(self) -> int:
        return len(self.time)

    def frames(self, which: slice) -> "CameraPath":
        """The path at some consecutive instants, one at least."""
        return CameraPath(self.time[which], self.R_world_camera[which], self.p_world_camera[which])

    def at(self, time: Array) -> "CameraPath":
        """Interpolated at other instants ``(N,)``; before the first and after the last, those are kept."""
        time = np.asarray(time, dtype=float)
        if len(self) == 1:
            count = len(time)
            return CameraPath(
                time, np.repeat(self.R_world_camera, count, axis=0), np.repeat(self.p_world_camera, count, axis=0)
            )
        inside = np.clip(time, self.time[0], self.time[-1])
        p = interpolate_points(self.time, self.p_world_camera, inside)
        return CameraPath(time, interpolate_rotations(self.time, self.R_world_camera, inside), p)

    def to_camera(self, p_world: Array) -> Array:
        """World points ``(T, N, 3)`` in the camera's frame at each instant."""
        return np.einsum(
            "tij,tnj->tni", transpose(self.R_world_camera), p_world - self.p_world_camera[:, None], optimize=True
        )


MotionPair = tuple[Motion, Motion]
"""An estimated and the true motion at the same frames."""
PathPair = tuple[CameraPath, CameraPath]
"""An estimated and the true camera path at the same instants."""


def scene_gauge(wearers: Sequence[MotionPair], camera: PathPair | None = None) -> Alignment:
    """One yaw and one translation, estimate to truth, fitted to all joints of all wearers and the camera together.

    In every frame the camera weighs as much as one wearer: it stands far off and says most about the yaw.
    """
    points = [[motion.state.p_world_joint.reshape(-1, 3) for motion in pair] for pair in wearers]
    if camera is not None:
        joints = wearers[0][0].R_parent_child.shape[1] if wearers else 1
        frames = len(wearers[0][0]) if wearers else len(camera[0])
        # A camera that stands still has one instant; it is repeated to weigh the same.
        times = joints * max(1, frames // len(camera[0]))
        points.append([np.repeat(path.p_world_camera, times, axis=0) for path in camera])
    estimated, true = (np.concatenate(side) for side in zip(*points, strict=True))
    return align_yaw(estimated, true)


def anchored_gauge(wearer: MotionPair, heading_error: float) -> Alignment:
    """The gauge as the graph's prior holds it: by one sensor's heading and that wearer's first root position.

    Covariances are relative to what carries the prior; honesty (NEES) has to be judged in the same gauge, or the fitted
    alignment takes part of the error away. ``heading_error`` is estimate minus truth, radians.
    """
    R_true_estimate = rotation_z(-heading_error)
    estimated, true = (motion.p_world_pelvis[0] for motion in wearer)
    return Alignment(R_true_estimate, true - R_true_estimate @ estimated, np.ones(()))


def yaw(gauge: Alignment) -> float:
    """By how much the estimate's world is turned against the true one, radians: what every heading has in excess."""
    return -float(yaw_of(gauge.R_target_source))


def move_motion(motion: Motion, gauge: Alignment) -> Motion:
    """A motion brought into the true world."""
    R_parent_child = motion.R_parent_child.copy()
    R_parent_child[:, 0] = gauge.R_target_source @ R_parent_child[:, 0]
    return replace(motion, R_parent_child=R_parent_child, p_world_pelvis=gauge.apply(motion.p_world_pelvis))


def move_path(path: CameraPath, gauge: Alignment) -> CameraPath:
    """A camera path brought into the true world."""
    return CameraPath(path.time, gauge.R_target_source @ path.R_world_camera, gauge.apply(path.p_world_camera))
