"""The samples of IMU streams, and 2D detections, to and from messages, quickly: a recording has a hundred thousand."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path

import numpy as np

from vip_factors.body.keypoints import KEYPOINT_SETS, KeypointSet
from vip_factors.errors import FileFormatError
from vip_factors.geometry.quaternions import Order, matrix_from_quaternion, quaternion_from_matrix
from vip_factors.geometry.rotations import Array
from vip_factors.io.codec import NS_PER_S, time_ns_of
from vip_factors.io.mcap_messages import parsed, warn
from vip_factors.io.mcap_reader import McapMessages
from vip_factors.io.mcap_writer import MessageWriter, TimedMessage, nanoseconds
from vip_factors.io.schemas.camera_info_pb2 import CameraInfo
from vip_factors.io.schemas.detections_2d_pb2 import Detections2D
from vip_factors.io.schemas.imu_sample_pb2 import ImuSample
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.scene import Camera, SceneTruth


def sample_messages(writer: MessageWriter, topic: str, stream: ImuStream, start_ns: int) -> Iterator[TimedMessage]:
    """The samples of a stream, serialised, in the order of time."""
    return writer.stamped(topic, ImuSample, nanoseconds(stream.time, start_ns), _samples(stream))


def _samples(stream: ImuStream) -> Iterator[ImuSample]:
    """One message, filled anew for every sample."""
    absent: list[None] = [None] * len(stream)
    R = stream.R_inertial_sensor
    force = absent if stream.specific_force is None else stream.specific_force.tolist()
    wxyz = absent if R is None else quaternion_from_matrix(R, Order.WXYZ).tolist()
    rate = absent if stream.angular_rate is None else stream.angular_rate.tolist()
    message = ImuSample(sensor=stream.name)
    for seconds, f, q, w in zip(stream.time.tolist(), force, wxyz, rate, strict=True):
        message.seconds = seconds
        fill_sample(message, f, q, w)
        yield message


def fill_sample(
    message: ImuSample, force: list[float] | None, wxyz: list[float] | None, rate: list[float] | None = None
) -> None:
    """What was measured into a message; what is None is left out."""
    for values, vector in ((force, message.specific_force), (rate, message.angular_rate)):
        if values is not None:
            vector.x, vector.y, vector.z = values
            vector.SetInParent()  # present even if all zero
    if wxyz is not None:
        turn = message.orientation_wxyz
        turn.w, turn.x, turn.y, turn.z = wxyz


def read_streams(path: Path, channels: Sequence[McapMessages], start_ns: int) -> dict[str, ImuStream]:
    """The streams of all channels of samples, by sensor.

    Raises:
        FileFormatError: if a sensor has two topics or a topic two sensors.
        RecordingError: if the samples are unusable.
    """
    streams: dict[str, ImuStream] = {}
    for messages in channels:
        samples = parsed(path, messages, ImuSample)
        if not samples:
            continue
        name = samples[0].sensor or messages.channel.topic.rpartition("/")[2]
        if name in streams or any(sample.sensor not in ("", name) for sample in samples):
            raise FileFormatError(
                f"{path}: sensor '{name}' and topic {messages.channel.topic}: expected one topic per sensor and one "
                "sensor per topic"
            )
        streams[name] = _stream(path, name, samples, start_ns)
    return streams


def _stream(path: Path, name: str, samples: Sequence[ImuSample], start_ns: int) -> ImuStream:
    time = np.array([sample_time(sample, start_ns) for sample in samples])
    force = _measured(samples, "specific_force", "xyz")
    rate = _measured(samples, "angular_rate", "xyz")
    R = rotations_where_finite(_measured(samples, "orientation_wxyz", "wxyz"), Order.WXYZ)
    order = np.argsort(time, kind="stable")  # other writers may log out of order
    stream = ImuStream.from_samples(
        name, time[order], *(None if values is None else values[order] for values in (force, R, rate))
    )
    if len(stream) < len(samples):
        warn(path, f"sensor '{name}': {len(samples) - len(stream)} incomplete samples are left out")
    return stream


def sample_time(sample: ImuSample, start_ns: int) -> float:
    """Seconds from the recording's start."""
    return sample.seconds if sample.HasField("seconds") else (time_ns_of(sample.timestamp) - start_ns) / NS_PER_S


def _measured(samples: Sequence[ImuSample], field: str, axes: str) -> Array | None:
    """``(N, axes)``, NaN where a message lacks the field; None where all lack it."""
    present = np.array([sample.HasField(field) for sample in samples])
    if not present.any():
        return None
    numbers, of = attrgetter(*axes), attrgetter(field)
    values = np.array([numbers(of(sample)) for sample in samples])
    values[~present] = np.nan
    return values


def rotations_where_finite(quaternions: Array | None, order: Order) -> Array | None:
    """``(N, 3, 3)`` of ``(N, 4)``, NaN where a quaternion is."""
    if quaternions is None:
        return None
    good = np.all(np.isfinite(quaternions), axis=1)
    R = np.full((len(quaternions), 3, 3), np.nan)
    R[good] = matrix_from_quaternion(quaternions[good], order)
    return R


@dataclass(frozen=True)
class DetectionTruth:
    """Of every detection: ``(N,)`` the wearer behind it (−1 for nobody), ``(N, K, 2)`` its true pixels if known."""

    wearer: np.ndarray
    pixels: Array | None


def detection_messages(
    writer: MessageWriter, topic: str, camera: Camera, truth: SceneTruth | None, start_ns: int
) -> Iterator[TimedMessage]:
    """One message a video frame, serialised, in the order of time."""
    times_ns = nanoseconds(camera.timed_detections.time, start_ns)
    return writer.stamped(topic, Detections2D, times_ns, _frames(camera.detections, truth))


def _frames(detections: Detections, truth: SceneTruth | None) -> Iterator[Detections2D]:
    pixels = detections.pixels.reshape(len(detections), 2 * len(detections.keypoints))
    true_pixels, colours = None, detections.torso_colour
    if truth is not None and truth.pixels is not None:
        true_pixels = truth.pixels.reshape(len(detections), 2 * len(detections.keypoints))
    for frame, seconds in enumerate(detections.time.tolist()):
        message = Detections2D(frame=frame, seconds=seconds)
        rows = detections.of_frame(frame)
        for row in range(rows.start, rows.stop):
            person = message.people.add(pixels=pixels[row], confidence=detections.confidence[row])
            if colours is not None and np.all(np.isfinite(colours[row])):
                person.torso_colour.extend(colours[row])
            if truth is not None:
                person.truth_wearer = int(truth.wearer[row])
            if true_pixels is not None:
                person.truth_pixels.extend(true_pixels[row])
        yield message


MOST_FRAMES = 20_000_000  # of a video: nine hours at 600 Hz


def detections_of(info: CameraInfo, messages: Sequence[Detections2D]) -> tuple[Detections, DetectionTruth | None]:
    """The detections of their messages; frames lost in between count as frames without people.

    Raises:
        FileFormatError: for people with another number of keypoints, or frames out of order.
        RecordingError: if times do not increase.
    """
    keypoints = keypoint_set_of(info)
    K = len(keypoints)
    last_frame = max((message.frame for message in messages), default=0)
    if last_frame > MOST_FRAMES:
        raise FileFormatError(
            f"detections: video frame {last_frame}: expected at most {MOST_FRAMES:,}; is the file damaged?"
        )
    frames = np.array([message.frame for message in messages], dtype=int)
    if np.any(np.diff(frames) <= 0):
        frame = int(frames[1:][np.diff(frames) <= 0][0])
        raise FileFormatError(f"detections: video frame {frame} comes twice or late: expected increasing frame numbers")
    time = np.array([message.seconds for message in messages])
    if len(frames):
        every = np.arange(frames[-1] + 1)
        time = _filled(frames, time, every)
    people = [(message.frame, person) for message in messages for person in message.people]
    for frame, person in people:
        if len(person.pixels) != 2 * K or len(person.confidence) != K:
            raise FileFormatError(
                f"video frame {frame}: a person with {len(person.pixels) // 2} keypoints and {len(person.confidence)} "
                f"confidences: expected {K} of each, as keypoint set {keypoints.name} has"
            )
    detections = Detections(
        keypoints,
        time,
        np.array([frame for frame, _ in people], dtype=int),
        np.array([person.pixels for _, person in people], dtype=float).reshape(-1, K, 2),
        np.array([person.confidence for _, person in people], dtype=float).reshape(-1, K),
        _torso_colours([person for _, person in people]),
    )
    if not all(person.HasField("truth_wearer") for _, person in people):
        return detections, None
    wearer = np.array([person.truth_wearer for _, person in people], dtype=int)
    is_complete = all(len(person.truth_pixels) == 2 * K for _, person in people)
    pixels = (
        np.array([person.truth_pixels for _, person in people], dtype=float).reshape(-1, K, 2) if is_complete else None
    )
    return detections, DetectionTruth(wearer, pixels)


def _torso_colours(people: Sequence[Detections2D.Person]) -> Array | None:
    """Shares ``(N, B)``, NaN where not seen; None if nobody has any.

    Raises:
        FileFormatError: for people with different numbers of colours.
    """
    sizes = {len(person.torso_colour) for person in people} - {0}
    if not sizes:
        return None
    if len(sizes) > 1:
        raise FileFormatError(f"detections: torsos with {' and '.join(map(str, sorted(sizes)))} colours: expected one")
    unseen = np.full(sizes.pop(), np.nan)
    return np.array([person.torso_colour if person.torso_colour else unseen for person in people], dtype=float)


def keypoint_set_of(info: CameraInfo) -> KeypointSet:
    """The keypoints that a camera's detector answers with."""
    declared = KEYPOINT_SETS.get(info.keypoint_set)
    if declared is not None and declared.keypoints == tuple(info.keypoints):
        return declared
    return KeypointSet(info.keypoint_set, tuple(info.keypoints))


def _filled(frames: np.ndarray, time: Array, every: np.ndarray) -> Array:
    """Times of all frames: those lost lie between their neighbours', or before the first at the same rate."""
    if len(frames) == len(every):
        return time
    step = float(np.median(np.diff(time) / np.diff(frames))) if len(frames) > 1 else 1.0
    inside = np.interp(every, frames, time)
    return np.where(every < frames[0], time[0] - (frames[0] - every) * step, inside)
