"""A scene: one or more wearers of sensors, and the camera or cameras that filmed them."""

from collections.abc import Mapping, Sequence
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
UNKNOWN_MOUNTING_SIGMA = np.pi  # nobody said how it sits: the data have to tell


@dataclass(frozen=True, repr=False)
class CameraMount(Summarised):
    """The IMU on the camera.

    Attributes:
        imu: its stream; in the head of a stream without samples.
        R_camera_imu: ``(3, 3)`` rough mounting.
        p_camera_imu: ``(3,)`` metres, its position in the camera's frame.
        mounting_sigma: radians, of the rough mounting about each axis; ``UNKNOWN_MOUNTING_SIGMA`` if nobody told it.
    """

    imu: ImuStream
    R_camera_imu: Array = field(default_factory=lambda: np.eye(3))
    p_camera_imu: Array = field(default_factory=lambda: np.zeros(3))
    mounting_sigma: float = CAMERA_MOUNTING_SIGMA

    @property
    def is_declared(self) -> bool:
        """Whether anybody told how the sensor sits."""
        return self.mounting_sigma < UNKNOWN_MOUNTING_SIGMA


@dataclass(frozen=True)
class Video:
    """Frames to look at: a file beside the recording, or encoded images (JPEG, PNG) embedded in it, by video frame."""

    path: Path | None = None
    images: Mapping[int, bytes] = field(default_factory=dict)


@dataclass(frozen=True, repr=False)
class Camera(Summarised):
    """One camera and what a detector found in its frames.

    Attributes:
        name: of the camera.
        model: its intrinsics.
        detections: with times on the video's own clock.
        moving: False for a camera that stands still: one pose for the whole recording.
        mount: the IMU on it, if any.
        known_path: poses to be believed instead of estimated, if any.
        clock: what lies between the video's clock and the IMUs'.
        video: to look at.
        keypoint_offsets: where its detector puts its keypoints, if that was found before.
        focal_sigma: standard deviation of the logarithm of the focal length; 0 of a calibrated lens.
        odometry: its path from visual odometry (ARKit, ARCore, SLAM), in a world of its own and with times on the
            video's own clock, if any.
        scale_free_odometry: whether that path has an unknown scale, as monocular SLAM has.
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

    def summary(self) -> list[str]:
        """What it is, and what was detected in its video."""
        known = "" if self.known_path is None else ", pose known"
        stands = f"{'moves' if self.moving else 'stands still'}{known}"
        image = f"image: {self.model.width} by {self.model.height} pixels, {stands}"
        return [f"camera '{self.name}'", image, *self.detections.summary()[1:]]

    @property
    def keypoints(self) -> KeypointSet:
        """Those that its detector answers with."""
        return self.detections.keypoints

    @property
    def timed_detections(self) -> Detections:
        """What was detected, with times on the IMUs' clock."""
        return self.detections.timed(self.clock)

    @property
    def timed_odometry(self) -> CameraPath | None:
        """The odometry with times on the IMUs' clock; a path without scale in units of its spread."""
        if self.odometry is None:
            return None
        p = self.odometry.p_world_camera
        unit = max(float(np.linalg.norm(np.std(p, axis=0))), 1e-6) if self.scale_free_odometry else 1.0
        return replace(self.odometry, time=self.clock.at(self.odometry.time), p_world_camera=p / unit)


@dataclass(frozen=True, repr=False)
class SceneTruth(Summarised):
    """What a simulator knows of a scene beyond the wearers' own truths (which share one world).

    Attributes:
        camera: the true path.
        wearer: ``(N,)`` index of the wearer behind each detection, −1 for bystanders and false detections.
        pixels: ``(N, K, 2)`` where the keypoints really are in the image (distorted), NaN out of view or unknown.
        camera_calibration: heading and mounting of the camera's IMU.
        clock: what lies between the video's clock and the IMUs'.
        further: of each further camera, in the scene's order.
    """

    camera: CameraPath
    wearer: np.ndarray
    pixels: Array | None = None
    camera_calibration: SensorCalibration | None = None
    clock: VideoClock = field(default_factory=VideoClock)
    further: tuple["SceneTruth", ...] = ()


@dataclass(frozen=True, repr=False)
class Scene(Summarised):
    """Everything measured at one time.

    Attributes:
        name: of the scene.
        wearers: their recordings, on one clock; subject names are unique.
        camera: what filmed them, or None.
        truth: if known.
        further_cameras: beside the first one, of any kind. The world of cameras of known pose becomes the scene's.

    Raises:
        RecordingError: for a scene whose parts do not belong together.
    """

    name: str
    wearers: tuple[Recording, ...]
    camera: Camera | None = None
    truth: SceneTruth | None = None
    further_cameras: tuple[Camera, ...] = ()

    def summary(self) -> list[str]:
        """Its wearers and cameras, a line each."""
        told = [line for one in self.wearers for line in (f"wearer: {one.subject.name}", *one.summary()[2:])]
        cameras = (", ".join(one.summary()[1:]) for one in self.cameras)
        return [f"scene '{self.name}'", *told, *(f"camera: {one}" for one in cameras)]

    @property
    def names(self) -> list[str]:
        """Of the wearers, in their order."""
        return [one.subject.name for one in self.wearers]

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """All of them, the first one first."""
        return (*((self.camera,) if self.camera is not None else ()), *self.further_cameras)

    def with_cameras(self, cameras: Sequence[Camera]) -> "Scene":
        """The same filmed by other cameras; with its truth if there are as many."""
        truth = self.truth if len(cameras) == len(self.cameras) else None
        return replace(self, camera=next(iter(cameras), None), further_cameras=tuple(cameras[1:]), truth=truth)

    @property
    def start_ns(self) -> int:
        """Absolute time of t = 0 in nanoseconds, 0 if unknown: that of the first wearer."""
        return self.wearers[0].start_ns

    def __post_init__(self) -> None:
        if not self.wearers:
            raise RecordingError(f"scene '{self.name}' has no wearer: expected at least one recording")
        if len(set(self.names)) < len(self.names):
            raise RecordingError(
                f"scene '{self.name}': subjects {', '.join(self.names)}: give each wearer a name of its own"
            )
        self._check_further_cameras()
        if self.truth is None:
            return
        truths = (self.truth, *self.truth.further)
        if [len(one.wearer) for one in truths] != [len(camera.detections) for camera in self.cameras]:
            raise RecordingError(f"scene '{self.name}': its truth does not belong to its detections")

    def _check_further_cameras(self) -> None:
        if self.further_cameras and self.camera is None:
            raise RecordingError(f"scene '{self.name}' has further cameras but no first one: name one of them first")
        names = [camera.name for camera in self.cameras]
        if len(set(names)) < len(names):
            raise RecordingError(f"scene '{self.name}': cameras {', '.join(names)}: give each a name of its own")


def as_scene(recording: Recording | Scene) -> Scene:
    """The scene itself, or that of one wearer without a camera.

    Raises:
        InputError: for anything else.
    """
    if not isinstance(recording, Recording | Scene):
        raise InputError(f"{described(recording)}: expected a recording or a scene, as vip.read gives of a file")
    return recording if isinstance(recording, Scene) else Scene(recording.name, (recording,))
