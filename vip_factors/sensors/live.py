"""Samples as they arrive, and what must be known of wearers and cameras before the first of them."""

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
    """One sample of one IMU; what it does not measure is None.

    Attributes:
        carrier: name of the wearer, or of the camera for the IMU on it.
        sensor: its name, unique for its carrier.
        time: seconds from the start of the stream.
        R_inertial_sensor: ``(3, 3)`` orientation in this sensor's own inertial frame, whose z is up.
        specific_force: ``(3,)`` m/s² in the sensor frame, gravity included.
        angular_rate: ``(3,)`` rad/s in the sensor frame; with specific force it stands in for an orientation.
    """

    carrier: str
    sensor: str
    time: float
    R_inertial_sensor: Array | None = None
    specific_force: Array | None = None
    angular_rate: Array | None = None


@dataclass(frozen=True)
class VideoFrame:
    """Everybody whom the detector saw in one video frame; nobody is an answer too.

    Attributes:
        camera: its name.
        time: seconds from the start of the stream, on the IMUs' clock.
        pixels: ``(N, K, 2)``, distorted as in the image; NaN where a keypoint was not found.
        confidence: ``(N, K)`` in [0, 1]; 0 where a keypoint was not found.
        frame: number of the stream's frame nearest in time, half a frame off at most; −1 before that is known.
    """

    camera: str
    time: float
    pixels: Array
    confidence: Array
    frame: int = -1


def detections_of(frames: Sequence[VideoFrame], keypoints: KeypointSet) -> Detections:
    """What was detected in video frames, in their order."""
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


def stream_head(scene: Scene) -> Scene:
    """What is known of a scene before its first sample: all but samples, detections, video and truth.

    The sensor on a camera has its name alone. Times are on the sensors' clock, so cameras have no clock of their own.

    Raises:
        RecordingError: for a wearer none of whose sensors is placed, and for a name that two carriers share.
    """
    for one in scene.wearers:
        if not (one.placed or (one.placement.sites and not one.imus)):  # without a sample yet, who wears what is known
            raise nothing_placed(one.name, one.imus)
    wearers = tuple(replace(one, name=scene.name, imus={}, truth=None, notes="") for one in scene.wearers)
    cameras = [_camera_head(one) for one in scene.cameras]
    return checked_head(Scene(scene.name, wearers, cameras[0] if cameras else None, None, tuple(cameras[1:])))


def checked_head(head: Scene) -> Scene:
    """The head, whose wearers and cameras are told apart by their names, and of which one camera at most moves.

    Raises:
        RecordingError: for a name that two of them share, or for a second camera that moves.
    """
    names = [*(wearer.subject.name for wearer in head.wearers), *(camera.name for camera in head.cameras)]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise RecordingError(f"stream '{head.name}': two carriers are called {', '.join(twice)}: name them apart")
    carried = [camera.name for camera in head.cameras if camera.moving]
    if len(carried) > 1:
        raise RecordingError(
            f"stream '{head.name}': cameras {', '.join(carried)} move: expected one at most, beside any number that "
            "stand still; leave the others out, or smooth the recording, which takes all of them"
        )
    return head


def sensor_columns(head: Scene) -> list[tuple[str, str]]:
    """Carrier and name of each sensor of a stream, those on cameras behind the wearers'."""
    worn = [(wearer.subject.name, site.sensor) for wearer in head.wearers for site in wearer.placement.sites]
    return worn + [(camera.name, camera.mount.imu.name) for camera in head.cameras if camera.mount is not None]


def _camera_head(camera: Camera) -> Camera:
    mount = camera.mount
    if mount is not None:
        mount = replace(mount, imu=ImuStream(mount.imu.name, np.zeros(0)))
    none = Detections.none(camera.detections.keypoints)
    return Camera(
        camera.name, camera.model, none, camera.moving, mount, camera.known_path, focal_sigma=camera.focal_sigma
    )


def live_samples(scene: Scene) -> Iterable[LiveSample]:
    """The samples of a scene in the order of their times, as a live source would send them."""
    samples: list[LiveSample] = []
    streams = [(one.subject.name, stream) for one in scene.wearers for stream in one.imus.values()]
    streams += [(camera.name, camera.mount.imu) for camera in scene.cameras if camera.mount is not None]
    for carrier, stream in streams:
        for n, time in enumerate(stream.time):
            measured = (stream.R_inertial_sensor, stream.specific_force, stream.angular_rate)
            own = (None if values is None else values[n] for values in measured)
            samples.append(ImuSample(carrier, stream.name, float(time), *own))
    for camera in scene.cameras:
        detections = camera.timed_detections
        for frame, time in enumerate(detections.time):
            rows = detections.of_frame(frame)
            samples.append(VideoFrame(camera.name, float(time), detections.pixels[rows], detections.confidence[rows]))
    return sorted(samples, key=lambda sample: sample.time)
