"""What a fixed-lag tracker answers, on its way into an estimate file: numbered without gaps, and in batches."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import JOINT_COUNT, Skeleton
from vip_factors.estimate import PoseCovariance
from vip_factors.geometry.rotations import Array
from vip_factors.live_estimate import LiveCameraPose, LivePose
from vip_factors.sensors.camera_path import CameraPath


@dataclass
class GaplessPoses:
    """Poses that wait to be written; the frames of a motion have a constant rate, so a gap is filled with what was
    before it, and a pose that comes a second time is left out.

    Attributes:
        rate: frames per second.
        start: time of the first frame; None before it.
        taken: number of frames so far.
    """

    rate: float
    start: float | None = None
    taken: int = 0
    _waiting: list[LivePose] = field(default_factory=list)
    _last: LivePose | None = None

    def take(self, pose: LivePose) -> int:
        """Take in a pose; returns how many frames before it had to be filled."""
        if self.start is None or self._last is None:
            self.start, self._last = pose.time, pose
        number = round((pose.time - self.start) * self.rate)
        if number < self.taken:
            return 0
        missing = number - self.taken
        self._waiting += [self._last] * missing + [pose]
        self.taken, self._last = number + 1, pose
        return missing

    def waiting(self) -> tuple[int, list[LivePose]]:
        """Number of the first waiting frame, and the poses; they wait no longer."""
        poses, self._waiting = self._waiting, []
        return self.taken - len(poses), poses


def motion_of_poses(
    poses: Sequence[LivePose], skeleton: Skeleton, rate: float, start: float, name: str
) -> tuple[Motion, PoseCovariance | None]:
    """Poses, one frame apart, as a motion that begins at ``start`` seconds, and their covariance if all have one."""
    R = np.array([one.R_parent_child for one in poses], float).reshape(-1, JOINT_COUNT, 3, 3)
    p = np.array([one.p_world_pelvis for one in poses], float).reshape(-1, 3)
    motion = Motion(skeleton, R, p, rate, start, name)
    joints = [one.joint_covariance for one in poses]
    roots = [one.root_covariance for one in poses]
    if any(one is None for one in (*joints, *roots)):
        return motion, None
    return motion, PoseCovariance(np.array(joints, float), np.array(roots, float))


def path_of_poses(poses: Sequence[LiveCameraPose]) -> tuple[CameraPath, Array | None]:
    """Poses of a camera as a path, and their covariances ``(T, 6, 6)`` if all have one."""
    path = CameraPath(
        np.array([one.time for one in poses], float),
        np.array([one.R_world_camera for one in poses], float),
        np.array([one.p_world_camera for one in poses], float),
    )
    covariances = [one.covariance for one in poses]
    return path, None if any(one is None for one in covariances) else np.array(covariances, float)
