"""Visual odometry: how a camera moves from each frame to the next, in a world of its own."""

from dataclasses import dataclass, replace

import numpy as np

from vip_factors.geometry.rotations import Array, angle_between, transpose
from vip_factors.sensors.camera import CameraPath

LONGEST_GAP_S = 0.25  # between two poses of a path; a longer one says nothing about the frames between
FASTEST_TURN = 10.0  # rad/s: a path that turns or moves faster was reset
FASTEST_SHIFT = 5.0  # m/s; in spreads of the path a second where its scale is free


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
        step, shift = np.diff(path.time), np.linalg.norm(np.diff(path.p_world_camera, axis=0), axis=1)
        turn = angle_between(path.R_world_camera[:-1], path.R_world_camera[1:])
        is_broken = (step > LONGEST_GAP_S) | (turn > FASTEST_TURN * step) | (shift > FASTEST_SHIFT * step)
        # A frame is tied to the next where the path covers both and no interval between them is broken.
        broken = np.concatenate([[0], np.cumsum(is_broken)])
        first_pose = np.clip(np.searchsorted(path.time, time[:-1], side="right") - 1, 0, len(broken) - 1)
        end = np.clip(np.searchsorted(path.time, time[1:], side="left"), 0, len(broken) - 1)
        is_covered = (time[:-1] >= path.time[0]) & (time[1:] <= path.time[-1])
        valid = np.append(is_covered & (broken[np.maximum(end, first_pose)] == broken[first_pose]), False)
        return cls(R_camera_next, p_camera_next, valid, is_scale_free)

    def window(self, frames: slice) -> "Odometry":
        """The motion in some consecutive frames."""
        return replace(
            self,
            R_camera_next=self.R_camera_next[frames],
            p_camera_next=self.p_camera_next[frames],
            valid=self.valid[frames],
        )
