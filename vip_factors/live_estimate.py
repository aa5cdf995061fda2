"""Answers of the fixed-lag tracker: one frame each, with the frame of one lag earlier beside it. Plain data.

:func:`estimate_of` makes an :class:`~vip_factors.estimate.Estimate` of consecutive answers, which is written and drawn
as that of a recording.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import Skeleton
from vip_factors.display import Summarised
from vip_factors.estimate import CameraEstimate, Estimate, PoseCovariance, WearerEstimate
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.calibration import Calibration
from vip_factors.sensors.camera import CameraModel, CameraPath
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene

METHOD = "fixed lag"


@dataclass(frozen=True, repr=False)
class LivePose(Summarised):
    """Pose of one wearer at one instant.

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
    """Pose of a camera at one instant.

    Attributes:
        time: seconds from the start of the stream.
        R_world_camera: ``(3, 3)``.
        p_world_camera: ``(3,)`` metres.
        covariance: ``(6, 6)`` of right perturbations: rotation (rad), translation (m); None if not asked for.
    """

    time: float
    R_world_camera: Array
    p_world_camera: Array
    covariance: Array | None = None


@dataclass(frozen=True, repr=False)
class LiveCameraEstimate(Summarised):
    """Estimate of one camera.

    Attributes:
        name: of the camera.
        model: lens with the current focal length.
        newest: the pose at the newest frame (zero lag).
        smoothed: the pose one lag earlier, which is final; None before the first.
    """

    name: str
    model: CameraModel
    newest: LiveCameraPose
    smoothed: LiveCameraPose | None = None


@dataclass(frozen=True, repr=False)
class LiveWearerEstimate(Summarised):
    """Estimate of one wearer.

    Attributes:
        name: of the subject.
        newest: the pose at the newest frame (zero lag).
        smoothed: the pose one lag earlier, which is final; None before the first.
        calibration: current headings and mountings with their standard deviations, by sensor.
        detection: index of the wearer's detection in the newest video frame of the set-up's first camera; None if not
            seen.
        skeleton: current estimate of the body; None if it is that of the set-up.
    """

    name: str
    newest: LivePose
    smoothed: LivePose | None
    calibration: Calibration
    detection: int | None = None
    skeleton: Skeleton | None = None


@dataclass(frozen=True, repr=False)
class LiveEstimate(Summarised):
    """Answer to one frame; every frame gets one, in order.

    Attributes:
        frame: number, from 0.
        time: seconds of the newest frame.
        wearers: in the order of the set-up.
        cameras: cameras that are used, in the order of the set-up.
        findings: since the previous frame.
        seconds: duration of this update.
        preliminary: whether the calibration is still that of the first second: bones may be turned wrong, and will be
            corrected.
    """

    frame: int
    time: float
    wearers: tuple[LiveWearerEstimate, ...]
    cameras: tuple[LiveCameraEstimate, ...] = ()
    findings: tuple[Finding, ...] = ()
    seconds: float = 0.0
    preliminary: bool = False

    @property
    def smoothed_time(self) -> float | None:
        """Seconds of the smoothed frame, the same for all wearers; None before the first."""
        smoothed = self.wearers[0].smoothed
        return None if smoothed is None else smoothed.time

    def summary(self) -> list[str]:
        """Frame and time, the position of every wearer, and findings."""
        poses = ((wearer.name, wearer.newest) for wearer in self.wearers)
        wearers = (f"{name}: pelvis at {pose.p_world_pelvis.round(2)} m at {pose.time:.2f} s" for name, pose in poses)
        title = f"answer to frame {self.frame}, {self.time:.2f} s{', preliminary' * self.preliminary}"
        return [title, *wearers, *(f"{finding.severity}: {finding}" for finding in self.findings)]


def motion_of(poses: Sequence[LivePose], body: Skeleton, rate: float, name: str, start: float | None = None) -> Motion:
    """Motion of poses that are one frame apart; it starts at ``start`` seconds, by default at the first pose."""
    R, p = np.array([pose.R_parent_child for pose in poses]), np.array([pose.p_world_pelvis for pose in poses])
    return Motion(body, R, p, rate, poses[0].time if start is None else start, name)


def estimate_of(
    live_estimates: Sequence[LiveEstimate],
    setup: Scene,
    rate: float,
    is_smoothed: bool = False,
    start: float | None = None,
) -> Estimate:
    """Estimate of consecutive answers.

    Args:
        live_estimates: answers to consecutive frames, at least one.
        setup: wearers and cameras of the stream.
        rate: frames per second.
        is_smoothed: whether to take the smoothed poses of one lag earlier, which all must have, instead of the newest.
        start: seconds of the first frame; by default those of its pose.
    """
    wearers = []
    for index, recording in enumerate(setup.wearers):
        rows = [answer.wearers[index] for answer in live_estimates]
        poses = [pose for row in rows if (pose := row.smoothed if is_smoothed else row.newest) is not None]
        wearers.append(_wearer_estimate(recording, rows[-1], poses, rate, start))
    cameras = (_camera_estimate(camera.name, live_estimates, is_smoothed) for camera in setup.cameras)
    return Estimate(setup.name, METHOD, tuple(wearers), tuple(camera for camera in cameras if camera is not None))


def _wearer_estimate(
    recording: Recording, row: LiveWearerEstimate, poses: Sequence[LivePose], rate: float, start: float | None
) -> WearerEstimate:
    """Estimate of one wearer; body and calibration are those of the last answer's ``row``."""
    name, sensors = recording.subject.name, tuple(site.sensor for site in recording.placement.sites)
    motion = motion_of(poses, row.skeleton or recording.subject.body(), rate, name, start)
    joints = _stacked([pose.joint_covariance for pose in poses])
    roots = _stacked([pose.root_covariance for pose in poses])
    covariance = None if joints is None or roots is None else PoseCovariance(joints, roots)
    return WearerEstimate(name, METHOD, motion, row.calibration, covariance, sensors=sensors)


def _camera_estimate(name: str, live_estimates: Sequence[LiveEstimate], is_smoothed: bool) -> CameraEstimate | None:
    """Estimate of a camera, with its last lens; None where it has no pose."""
    rows = [camera for answer in live_estimates for camera in answer.cameras if camera.name == name]
    poses = [pose for row in rows if (pose := row.smoothed if is_smoothed else row.newest) is not None]
    if not poses:
        return None
    R, p = np.array([pose.R_world_camera for pose in poses]), np.array([pose.p_world_camera for pose in poses])
    path = CameraPath(np.array([pose.time for pose in poses]), R, p)
    return CameraEstimate(name, rows[-1].model, path, covariance=_stacked([pose.covariance for pose in poses]))


def _stacked(covariances: Sequence[Array | None]) -> Array | None:
    """Covariances of frames as one array; None if one of them is unknown."""
    return None if any(covariance is None for covariance in covariances) else np.array(covariances, float)
