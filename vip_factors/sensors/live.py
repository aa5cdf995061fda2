"""Samples as they arrive, and what must be known of wearers and cameras before the first of them."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from vip_factors.body.keypoints import KeypointSet
from vip_factors.errors import RecordingError
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.calibration import Placement
from vip_factors.sensors.camera_model import CameraModel
from vip_factors.sensors.camera_path import CameraPath
from vip_factors.sensors.recording import Subject, nothing_placed
from vip_factors.sensors.scene import CAMERA_MOUNTING_SIGMA, Scene


@dataclass(frozen=True)
class ImuSample:
    """One sample of one IMU; what it does not measure is None.

    Attributes:
        carrier: name of the wearer, or of the camera for the IMU on it.
        sensor: its name, unique for its carrier.
        time: seconds from the start of the stream.
        R_inertial_sensor: ``(3, 3)`` orientation in this sensor's own inertial frame, whose z is up.
        specific_force: ``(3,)`` m/s² in the sensor frame, gravity included.
    """

    carrier: str
    sensor: str
    time: float
    R_inertial_sensor: Array | None = None
    specific_force: Array | None = None


@dataclass(frozen=True)
class VideoFrame:
    """Everybody whom the detector saw in one video frame; nobody is an answer too.

    Attributes:
        camera: its name.
        time: seconds from the start of the stream, on the IMUs' clock.
        pixels: ``(N, K, 2)``, distorted as in the image; NaN where a keypoint was not found.
        confidence: ``(N, K)`` in [0, 1]; 0 where a keypoint was not found.
    """

    camera: str
    time: float
    pixels: Array
    confidence: Array


LiveSample = ImuSample | VideoFrame


@dataclass(frozen=True)
class LiveFinding:
    """One sentence for the user about messages that could not be used, or that were lost."""

    sentence: str


@dataclass(frozen=True)
class LiveLoss(LiveFinding):
    """Samples that were sent and then dropped on the way to the tracker, which did not keep up.

    Attributes:
        again: whether people were told of such losses a moment ago, and will be told of these later.
    """

    again: bool = False


LiveItem = LiveSample | LiveFinding


@dataclass(frozen=True)
class LiveWearer:
    """One wearer: body, where each sensor sits, and the pose declared for the start."""

    subject: Subject
    placement: Placement
    initial_pose: str = "none"

    @property
    def name(self) -> str:
        """The subject's name."""
        return self.subject.name


@dataclass(frozen=True)
class LiveMount:
    """The IMU on a camera: its name and rough mounting, as :class:`~vip_factors.sensors.scene.CameraMount` has them."""

    sensor: str
    R_camera_imu: Array = field(default_factory=lambda: np.eye(3))
    p_camera_imu: Array = field(default_factory=lambda: np.zeros(3))
    mounting_sigma: float = CAMERA_MOUNTING_SIGMA


@dataclass(frozen=True)
class LiveCamera:
    """One camera.

    Attributes:
        name: of the camera.
        model: its intrinsics.
        keypoints: that its detector answers with.
        moving: False for a camera that stands still.
        known_path: where it is, if that is known: a single pose for a camera that stands still.
        mount: the IMU on it, if any.
    """

    name: str
    model: CameraModel
    keypoints: KeypointSet
    moving: bool = True
    known_path: CameraPath | None = None
    mount: LiveMount | None = None


@dataclass(frozen=True)
class LiveSetup:
    """What a stream is about.

    Attributes:
        name: of the session.
        wearers: at least one; their names are unique, and no camera has one of them.
        cameras: the first may move; further ones stand still at known poses.
        start_ns: absolute time of t = 0 in nanoseconds, 0 if unknown.

    Raises:
        RecordingError: without a wearer, and for a name that two carriers share.
    """

    name: str
    wearers: tuple[LiveWearer, ...]
    cameras: tuple[LiveCamera, ...] = ()
    start_ns: int = 0

    def __post_init__(self) -> None:
        if not self.wearers:
            raise RecordingError(f"stream '{self.name}' has no wearer: expected at least one")
        names = [*(wearer.name for wearer in self.wearers), *(camera.name for camera in self.cameras)]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise RecordingError(f"stream '{self.name}': two carriers are called {', '.join(twice)}: name them apart")

    @property
    def camera(self) -> LiveCamera | None:
        """The first camera, which may move; None without one."""
        return self.cameras[0] if self.cameras else None

    @classmethod
    def of(cls, scene: Scene) -> "LiveSetup":
        """What is known of a scene before its first sample.

        Raises:
            RecordingError: for a wearer none of whose sensors is placed.
        """
        for one in scene.wearers:
            if not one.placed:
                raise nothing_placed(one.name, one.imus)
        wearers = tuple(LiveWearer(one.subject, one.placement, one.initial_pose) for one in scene.wearers)
        cameras = []
        for camera in scene.cameras:
            mount = camera.mount
            live = None
            if mount is not None:
                live = LiveMount(mount.imu.name, mount.R_camera_imu, mount.p_camera_imu, mount.mounting_sigma)
            keypoints = camera.detections.keypoints
            cameras.append(LiveCamera(camera.name, camera.model, keypoints, camera.moving, camera.known_path, live))
        return cls(scene.name, wearers, tuple(cameras), scene.wearers[0].start_ns)


def live_samples(scene: Scene) -> Iterable[LiveSample]:
    """The samples of a scene in the order of their times, as a live source would send them."""
    samples: list[LiveSample] = []
    streams = [(one.subject.name, stream) for one in scene.wearers for stream in one.imus.values()]
    streams += [(camera.name, camera.mount.imu) for camera in scene.cameras if camera.mount is not None]
    for carrier, stream in streams:
        for n, time in enumerate(stream.time):
            R = None if stream.R_inertial_sensor is None else stream.R_inertial_sensor[n]
            force = None if stream.specific_force is None else stream.specific_force[n]
            samples.append(ImuSample(carrier, stream.name, float(time), R, force))
    for camera in scene.cameras:
        detections = camera.timed_detections
        for frame, time in enumerate(detections.time):
            rows = detections.of_frame(frame)
            samples.append(VideoFrame(camera.name, float(time), detections.pixels[rows], detections.confidence[rows]))
    return sorted(samples, key=lambda sample: sample.time)
