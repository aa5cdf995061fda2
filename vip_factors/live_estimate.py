"""What the fixed-lag tracker answers with, frame by frame. Plain data."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import Skeleton
from vip_factors.display import Summarised
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.calibration import Calibration
from vip_factors.sensors.camera import CameraPath


@dataclass(frozen=True, repr=False)
class LivePose(Summarised):
    """One wearer at one instant.

    Attributes:
        time: seconds from the start of the stream.
        R_parent_child: ``(24, 3, 3)`` joint rotations; the first is R_world_pelvis.
        p_world_pelvis: ``(3,)`` metres.
        joint_covariance: ``(24, 3, 3)`` rad², of right perturbations of ``R_parent_child``; None if not asked for.
        root_covariance: ``(3, 3)`` m²; None if not asked for.
    """

    time: float
    R_parent_child: Array
    p_world_pelvis: Array
    joint_covariance: Array | None = None
    root_covariance: Array | None = None


@dataclass(frozen=True, repr=False)
class LiveCameraPose(Summarised):
    """The camera at one instant; ``covariance`` ``(6, 6)`` of right perturbations: rotation (rad), translation (m)."""

    time: float
    R_world_camera: Array
    p_world_camera: Array
    covariance: Array | None = None


def motion_of(poses: Sequence[LivePose], body: Skeleton, rate: float, name: str, start: float | None = None) -> Motion:
    """Poses one frame apart as a motion, from the first one's time on if no other start is given."""
    R, p = np.array([pose.R_parent_child for pose in poses]), np.array([pose.p_world_pelvis for pose in poses])
    return Motion(body, R, p, rate, poses[0].time if start is None else start, name)


def path_of(poses: Sequence[LiveCameraPose]) -> CameraPath:
    """A camera's poses as a path."""
    R, p = np.array([pose.R_world_camera for pose in poses]), np.array([pose.p_world_camera for pose in poses])
    return CameraPath(np.array([pose.time for pose in poses]), R, p)


@dataclass(frozen=True, repr=False)
class LiveWearerEstimate(Summarised):
    """One wearer.

    Attributes:
        name: of the subject.
        newest: the pose at the newest frame (zero lag).
        smoothed: the pose one lag earlier, never to change again; None as long as there is none.
        calibration: headings and mountings as they are believed now, with their standard deviations, by sensor.
        detection: index of the person in the newest video frame who is the wearer; None if not seen.
        skeleton: the body that the poses are of, as it is believed now; None: as the set-up has it.
    """

    name: str
    newest: LivePose
    smoothed: LivePose | None
    calibration: Calibration
    detection: int | None = None
    skeleton: Skeleton | None = None


@dataclass(frozen=True, repr=False)
class LiveEstimate(Summarised):
    """The answer to one frame; every frame gets one, in order.

    Attributes:
        frame: number, from 0.
        time: seconds of the newest frame.
        wearers: in the order of the set-up.
        camera, smoothed_camera: the first camera's pose at the newest frame and one lag earlier; None without one.
        findings: for the user, about what has happened since the frame before.
        seconds: what this update took.
        preliminary: whether the calibration is still that of the start's one second: bones may be turned wrong, and
            will be corrected.
    """

    frame: int
    time: float
    wearers: tuple[LiveWearerEstimate, ...]
    camera: LiveCameraPose | None = None
    smoothed_camera: LiveCameraPose | None = None
    findings: tuple[Finding, ...] = ()
    seconds: float = 0.0
    preliminary: bool = False

    def summary(self) -> list[str]:
        """When it is of, where everybody is, and what was noticed."""
        poses = ((one.name, one.newest) for one in self.wearers)
        wearers = (f"{name}: pelvis at {pose.p_world_pelvis.round(2)} m at {pose.time:.2f} s" for name, pose in poses)
        title = f"answer to frame {self.frame}, {self.time:.2f} s{', preliminary' * self.preliminary}"
        return [title, *wearers, *(f"{one.severity}: {one}" for one in self.findings)]
