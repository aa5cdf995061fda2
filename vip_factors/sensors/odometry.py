"""Visual odometry: how a camera moves from each frame to the next, in a world of its own."""

from dataclasses import dataclass, replace

import numpy as np

from vip_factors.geometry.rotations import Array, angle_between, transpose
from vip_factors.sensors.camera import CameraPath

LONGEST_GAP_S = 0.25  # between two poses of a path; a longer one says nothing about the frames between
FASTEST_TURN = 20.0  # rad/s: what turns or moves faster is a reset of the odometry
FASTEST_SHIFT = 10.0  # m/s


@dataclass(frozen=True)
class Odometry:
    """Relative poses ``T_camera_next`` between consecutive frames.

    Attributes:
        R_camera_next: ``(T, 3, 3)``; the last one has no next frame.
        p_camera_next: ``(T, 3)`` metres; in units of its own where the scale is free.
        valid: ``(T,)`` where the path has poses.
        is_scale_free: whether the path has an unknown scale, as monocular SLAM has.
    """

    R_camera_next: Array
    p_camera_next: Array
    valid: np.ndarray
    is_scale_free: bool = False

    @classmethod
    def between(cls, path: CameraPath, time: Array, is_scale_free: bool = False) -> "Odometry":
        """The motion along a path, whose times are on the frames' clock, between frames at ``time`` ``(T,)``."""
        poses = path.at(time)
        R, p = poses.R_world_camera, poses.p_world_camera
        R_next, p_next = np.concatenate([R[1:], R[-1:]]), np.concatenate([p[1:], p[-1:]])
        R_camera_next, p_camera_next = transpose(R) @ R_next, np.einsum("tji,tj->ti", R, p_next - p)
        next_index = np.searchsorted(path.time, time, side="right")
        gap = np.diff(path.time, prepend=-np.inf, append=np.inf)[next_index]
        has_pose = (gap <= LONGEST_GAP_S) | np.isin(time, path.time)
        valid = has_pose & np.append(has_pose[1:], False)
        step = np.diff(time, append=np.inf)
        is_reset = np.linalg.norm(p_camera_next, axis=1) > FASTEST_SHIFT * step
        is_reset |= angle_between(R_camera_next, np.eye(3)) > FASTEST_TURN * step
        return cls(R_camera_next, p_camera_next, valid & ~is_reset, is_scale_free)

    def window(self, frames: slice) -> "Odometry":
        """The motion in some consecutive frames."""
        return replace(
            self,
            R_camera_next=self.R_camera_next[frames],
            p_camera_next=self.p_camera_next[frames],
            valid=self.valid[frames],
        )
