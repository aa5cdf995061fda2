"""The 2D detections of a video, and who was who if that is known, to and from messages."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from vip_factors.body.keypoints import KEYPOINT_SETS, KeypointSet
from vip_factors.errors import FileFormatError
from vip_factors.geometry.rotations import Array
from vip_factors.io.mcap_messages import set_timestamp
from vip_factors.io.mcap_writer import MessageWriter, TimedMessage, nanoseconds
from vip_factors.io.schemas.camera_info_pb2 import CameraInfo
from vip_factors.io.schemas.detections_2d_pb2 import Detections2D
from vip_factors.sensors.detections import Detections
from vip_factors.sensors.scene import Camera, SceneTruth


@dataclass(frozen=True)
class DetectionTruth:
    """Of every detection: ``(N,)`` the wearer behind it (−1 for nobody), ``(N, K, 2)`` its true pixels if known."""

    wearer: np.ndarray
    pixels: Array | None


def detection_messages(
    writer: MessageWriter, topic: str, camera: Camera, truth: SceneTruth | None, start_ns: int
) -> Iterator[TimedMessage]:
    """One message a video frame, serialised, in the order of time."""
    channel = writer.channel(topic, Detections2D)
    detections = camera.detections
    pixels = detections.pixels.reshape(len(detections), 2 * len(detections.keypoints))
    true_pixels, colours = None, detections.torso_colour
    if truth is not None and truth.pixels is not None:
        true_pixels = truth.pixels.reshape(len(detections), 2 * len(detections.keypoints))
    times = nanoseconds(camera.timed_detections.time, start_ns)
    for frame, (time_ns, seconds) in enumerate(zip(times, detections.time.tolist(), strict=True)):
        message = Detections2D(frame=frame, seconds=seconds)
        set_timestamp(message.timestamp, time_ns)
        here = detections.of_frame(frame)
        for one in range(here.start, here.stop):
            person = message.people.add(pixels=pixels[one], confidence=detections.confidence[one])
            if colours is not None and np.all(np.isfinite(colours[one])):
                person.torso_colour.extend(colours[one])
            if truth is not None:
                person.truth_wearer = int(truth.wearer[one])
            if true_pixels is not None:
                person.truth_pixels.extend(true_pixels[one])
        yield time_ns, channel, message.SerializeToString()


MOST_FRAMES = 20_000_000  # of a video: nine hours at 600 Hz


def detections_of(info: CameraInfo, messages: Sequence[Detections2D]) -> tuple[Detections, DetectionTruth | None]:
    """The detections of their messages; frames lost in between count as frames without people.

    Raises:
        FileFormatError: for people with another number of keypoints, or frames out of order.
        RecordingError: if times do not increase.
    """
    keypoints = keypoint_set_of(info)
    K = len(keypoints)
    last = max((one.frame for one in messages), default=0)
    if last > MOST_FRAMES:
        raise FileFormatError(f"detections: video frame {last}: expected at most {MOST_FRAMES:,}; is the file damaged?")
    frames = np.array([one.frame for one in messages], dtype=int)
    if np.any(np.diff(frames) <= 0):
        at = int(frames[1:][np.diff(frames) <= 0][0])
        raise FileFormatError(f"detections: video frame {at} comes twice or late: expected increasing frame numbers")
    time = np.array([one.seconds for one in messages])
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
    whole = all(len(person.truth_pixels) == 2 * K for _, person in people)
    pixels = np.array([person.truth_pixels for _, person in people], dtype=float).reshape(-1, K, 2) if whole else None
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
    ours = KEYPOINT_SETS.get(info.keypoint_set)
    if ours is not None and ours.keypoints == tuple(info.keypoints):
        return ours
    return KeypointSet(info.keypoint_set, tuple(info.keypoints))


def _filled(frames: np.ndarray, time: Array, every: np.ndarray) -> Array:
    """Times of all frames: those lost lie between their neighbours', or before the first at the same rate."""
    if len(frames) == len(every):
        return time
    step = float(np.median(np.diff(time) / np.diff(frames))) if len(frames) > 1 else 1.0
    inside = np.interp(every, frames, time)
    return np.where(every < frames[0], time[0] - (frames[0] - every) * step, inside)
