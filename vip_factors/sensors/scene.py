"""Scene: one or more wearers of sensors and the cameras that filmed them."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from vip_factors.body.keypoints import KeypointOffsets, KeypointSet
from vip_factors.display import Summarised, described
from vip_factors.errors import InputError, RecordingError
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.calibration import SensorCalibration
from vip_factors.sensors.camera import CameraModel, CameraPath, VideoClock
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.recording import Recording

CAMERA_MOUNTING_SIGMA = np.deg2rad(10.0)  # an IMU taped to a phone along its edges
UNKNOWN_MOUNTING_SIGMA = np.pi  # undeclared: estimated from the data


@dataclass(frozen=True, repr=False)
class CameraMount(Summarised):
    """IMU on a camera.

    Attributes:
        imu: samples; none in the head of a stream.
        R_camera_imu: ``(3, 3)`` rough mounting.
        p_camera_imu: ``(3,)`` metres, position in the camera's frame.
        mounting_sigma: standard deviation of the rough mounting about each axis, radians;
            ``UNKNOWN_MOUNTING_SIGMA`` if it is not declared.
    """

    imu: ImuStream
    R_camera_imu: Array = field(default_factory=lambda: np.eye(3))
    p_camera_imu: Array = field(default_factory=lambda: np.zeros(3))
    mounting_sigma: float = CAMERA_MOUNTING_SIGMA

    @property
    def is_declared(self) -> bool:
        """True if the mounting is declared."""
        return self.mounting_sigma < UNKNOWN_MOUNTING_SIGMA


@dataclass(frozen=True)
class Video:
    """Video to display: a file beside the recording, or encoded images (JPEG, PNG) by video frame."""

    path: Path | None = None
    images: Mapping[int, bytes] = field(default_factory=dict)


@dataclass(frozen=True, repr=False)
class CameraTruth(Summarised):
    """Reference of a camera, in the world of the scene's other truths.

    Attributes:
        path: true poses.
        wearer: ``(N,)`` index of the wearer behind each detection, −1 for bystanders and false detections.
        pixels: ``(N, K, 2)`` true keypoints in the (distorted) image; NaN out of view or unknown.
        calibration: heading and mounting of the camera's IMU.
        clock: map from the video's clock to the IMUs'.
        model: intrinsics.
    """

    path: CameraPath
    wearer: np.ndarray
    pixels: Array | None = None
    calibration: SensorCalibration | None = None
    clock: VideoClock = field(default_factory=VideoClock)
    model: CameraModel | None = None


@dataclass(frozen=True, repr=False)
class Camera(Summarised):
    """One camera and the 2D detections in its frames.

    Attributes:
        name: of the camera.
        model: intrinsics.
        detections: with times on the video's clock.
        moving: False for a static camera, which has one pose.
        mount: the IMU on it, if any.
        known_path: given poses, which are not estimated, or None.
        clock: map from the video's clock to the IMUs'.
        video: to display.
        keypoint_offsets: prior on the detector's keypoint offsets from an earlier recording, if any.
        focal_sigma: standard deviation of the logarithm of the focal length; 0 for a calibrated lens.
        odometry: path from visual odometry (ARKit, ARCore, SLAM), in its own world and on the video's clock, if any.
        scale_free_odometry: True if the scale of that path is unknown, as for monocular SLAM.
        truth: reference, if known.

    Raises:
        RecordingError: for a truth of other detections.
    """

    name: str
    model: CameraModel
    detections: Detections
    moving: bool = True
    mount: CameraMount | None = None
    known_path: CameraPath | None = None
    clock: VideoClock = field(default_factory=VideoClock)
    video: Video | None = None
    keypoint_offsets: KeypointOffsets | None = None
    focal_sigma: float = 0.0
    odometry: CameraPath | None = None
    scale_free_odometry: bool = False
    truth: CameraTruth | None = None

    def __post_init__(self) -> None:
        if self.truth is not None and len(self.truth.wearer) != len(self.detections):
            raise RecordingError(f"camera '{self.name}': its truth does not belong to its detections")

    def summary(self) -> list[str]:
        """Describe image, motion and detections."""
        pose_note = "" if self.known_path is None else ", pose known"
        stands = f"{'moves' if self.moving else 'stands still'}{pose_note}"
        image = f"image: {self.model.width} by {self.model.height} pixels, {stands}"
        return [f"camera '{self.name}'", image, *self.detections.summary()[1:]]

    @property
    def keypoints(self) -> KeypointSet:
        """Keypoint set of the detector."""
        return self.detections.keypoints

    @property
    def timed_detections(self) -> Detections:
        """Detections with times on the IMUs' clock."""
        return self.detections.timed(self.clock)

    @property
    def timed_odometry(self) -> CameraPath | None:
        """Odometry with times on the IMUs' clock; a path without scale is divided by its spread."""
        if self.odometry is None:
            return None
        p = self.odometry.p_world_camera
        unit = max(float(np.linalg.norm(np.std(p, axis=0))), 1e-6) if self.scale_free_odometry else 1.0
        return replace(self.odometry, time=self.clock.at(self.odometry.time), p_world_camera=p / unit)


@dataclass(frozen=True, repr=False)
class Scene(Summarised):
    """Everything measured in one session.

    Attributes:
        name: of the scene.
        wearers: recordings on one clock; subject names are unique.
        cameras: of any kind. The scene's world is that of cameras with known poses.

    Raises:
        RecordingError: for inconsistent wearers, cameras or truth.
    """

    name: str
    wearers: tuple[Recording, ...]
    cameras: tuple[Camera, ...] = ()

    def summary(self) -> list[str]:
        """Describe the wearers and cameras in text."""
        lines = [line for wearer in self.wearers for line in (f"wearer: {wearer.subject.name}", *wearer.summary()[2:])]
        cameras = (", ".join(camera.summary()[1:]) for camera in self.cameras)
        return [f"scene '{self.name}'", *lines, *(f"camera: {camera}" for camera in cameras)]

    @property
    def names(self) -> list[str]:
        """Names of the wearers, in order."""
        return [wearer.subject.name for wearer in self.wearers]

    @property
    def camera(self) -> Camera | None:
        """The first camera, the only one of most scenes; None without any."""
        return self.cameras[0] if self.cameras else None

    @property
    def start_ns(self) -> int:
        """Absolute time of t = 0 in nanoseconds, 0 if unknown: that of the first wearer."""
        return self.wearers[0].start_ns

    def __post_init__(self) -> None:
        if not self.wearers:
            raise RecordingError(f"scene '{self.name}' has no wearer: expected at least one recording")
        if len(set(self.names)) < len(self.names):
            raise RecordingError(
                f"scene '{self.name}': subjects {', '.join(self.names)}: give each wearer a unique name"
            )
        names = [camera.name for camera in self.cameras]
        if len(set(names)) < len(names):
            raise RecordingError(f"scene '{self.name}': cameras {', '.join(names)}: give each camera a unique name")


def as_scene(recording: Recording | Scene) -> Scene:
    """Convert a recording to a scene of one wearer without a camera; scenes are returned unchanged.

    Raises:
        InputError: for anything else.
    """
    if not isinstance(recording, Recording | Scene):
        raise InputError(f"{described(recording)}: expected a recording or a scene, as vip.read gives of a file")
    return recording if isinstance(recording, Scene) else Scene(recording.name, (recording,))
