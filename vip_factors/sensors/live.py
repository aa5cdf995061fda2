"""Samples of a stream, and its head: wearers and cameras as declared before the first sample."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.body.keypoints import KeypointSet
from vip_factors.errors import RecordingError
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.recording import nothing_placed
from vip_factors.sensors.scene import Camera, Scene


@dataclass(frozen=True)
class ImuSample:
    """One sample of one IMU; quantities that it does not measure are None.

    Attributes:
        carrier: name of the wearer, or of the camera for the IMU on it.
        sensor: name of the sensor, unique for its carrier.
        time: seconds from the start of the stream.
        R_inertial_sensor: ``(3, 3)`` orientation in the sensor's inertial frame, whose z is up.
        specific_force: ``(3,)`` m/s² in the sensor frame, gravity included.
        angular_rate: ``(3,)`` rad/s in the sensor frame; orientation is computed from it and specific force if missing.
    """

    carrier: str
    sensor: str
    time: float
    R_inertial_sensor: Array | None = None
    specific_force: Array | None = None
    angular_rate: Array | None = None


@dataclass(frozen=True)
class VideoFrame:
    """Detections in one video frame; there may be none.

    Attributes:
        camera: name of the camera.
        time: seconds from the start of the stream, on the IMUs' clock.
        pixels: ``(N, K, 2)``, distorted as in the image; NaN where a keypoint was not found.
        confidence: ``(N, K)`` in [0, 1]; 0 where a keypoint was not found.
        frame: number of the stream's frame nearest in time; −1 if not yet assigned.
    """

    camera: str
    time: float
    pixels: Array
    confidence: Array
    frame: int = -1


def detections_of(frames: Sequence[VideoFrame], keypoints: KeypointSet) -> Detections:
    """Collect the detections of video frames, in their order."""
    count, K = [len(frame.pixels) for frame in frames], len(keypoints)
    pixels = [np.zeros((0, K, 2)), *(np.reshape(frame.pixels, (-1, K, 2)) for frame in frames)]
    confidence = [np.zeros((0, K)), *(np.reshape(frame.confidence, (-1, K)) for frame in frames)]
    return Detections(
        keypoints,
        np.array([frame.time for frame in frames]),
        np.repeat(np.arange(len(frames)), np.array(count, int)),
        np.concatenate(pixels),
        np.concatenate(confidence),
    )


LiveSample = ImuSample | VideoFrame


@dataclass(frozen=True)
class LiveFinding:
    """One sentence for the user about unusable or lost messages."""

    sentence: str


@dataclass(frozen=True)
class LiveLoss(LiveFinding):
    """Samples that were dropped because the tracker did not keep up.

    Attributes:
        is_repeat: True if a similar loss was reported recently; the report of this one is postponed.
    """

    is_repeat: bool = False


LiveItem = LiveSample | LiveFinding


def stream_head(scene: Scene) -> Scene:
    """Remove samples, detections, video and truth from a scene: the head of a stream.

    Cameras have no clock, since times of a stream are on the sensors' clock.

    Raises:
        RecordingError: for a wearer without placed sensors, and for a name that two carriers share.
    """
    for wearer in scene.wearers:
        if not (wearer.placed or (wearer.placement.sites and not wearer.imus)):  # a head without samples is fine
            raise nothing_placed(wearer.name, wearer.imus)
    wearers = tuple(replace(wearer, name=scene.name, imus={}, truth=None, notes="") for wearer in scene.wearers)
    cameras = list[Camera]()
    for camera in scene.cameras:
        mount, none = camera.mount, Detections.none(camera.keypoints)
        if mount is not None:
            mount = replace(mount, imu=ImuStream(mount.imu.name, np.zeros(0)))
        parts = camera.moving, mount, camera.known_path
        cameras.append(Camera(camera.name, camera.model, none, *parts, focal_sigma=camera.focal_sigma))
    return checked_head(Scene(scene.name, wearers, tuple(cameras)))


def checked_head(head: Scene) -> Scene:
    """Check that names of wearers and cameras are unique; returns the head.

    Raises:
        RecordingError: for a name that two of them share.
    """
    names = [*(wearer.subject.name for wearer in head.wearers), *(camera.name for camera in head.cameras)]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise RecordingError(
            f"stream '{head.name}': two wearers or cameras are called {', '.join(twice)}: give each its own name"
        )
    return head


def sensor_columns(head: Scene) -> list[tuple[str, str]]:
    """Carrier and name of each sensor of a stream, those of wearers first."""
    sensors = [(wearer.subject.name, site.sensor) for wearer in head.wearers for site in wearer.placement.sites]
    return sensors + [(camera.name, camera.mount.imu.name) for camera in head.cameras if camera.mount is not None]


def live_samples(scene: Scene) -> Iterable[LiveSample]:
    """Samples of a scene in the order of their times, as a live source sends them."""
    samples: list[LiveSample] = []
    streams = [(wearer.subject.name, stream) for wearer in scene.wearers for stream in wearer.imus.values()]
    streams += [(camera.name, camera.mount.imu) for camera in scene.cameras if camera.mount is not None]
    for carrier, stream in streams:
        for n, time in enumerate(stream.time):
            measured = (stream.R_inertial_sensor, stream.specific_force, stream.angular_rate)
            values_n = (None if values is None else values[n] for values in measured)
            samples.append(ImuSample(carrier, stream.name, float(time), *values_n))
    for camera in scene.cameras:
        detections = camera.timed_detections
        for frame, time in enumerate(detections.time):
            rows = detections.of_frame(frame)
            samples.append(VideoFrame(camera.name, float(time), detections.pixels[rows], detections.confidence[rows]))
    return sorted(samples, key=lambda sample: sample.time)
