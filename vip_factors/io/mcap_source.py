"""A recording or a filmed scene in an MCAP file, whose samples and detections are read window by window."""

import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from mcap.summary import Summary

from vip_factors.errors import RecordingError
from vip_factors.geometry.rotations import Array
from vip_factors.io.codec import NS_PER_S, time_ns_of
from vip_factors.io.mcap_camera import CameraTopics, camera_of, detections_of
from vip_factors.io.mcap_frames import read_streams, sample_time
from vip_factors.io.mcap_messages import Topics, is_ours, naming, parsed
from vip_factors.io.mcap_reader import McapByTime, McapChannel, McapContents, read_summary
from vip_factors.io.mcap_recording import FIRST_CAMERA, IMU, SCENE_INFO, TRUTH_POSE, recording_of, wearer_prefixes
from vip_factors.io.scene_building import read_scenes
from vip_factors.io.schemas.body_pose_pb2 import BodyPose
from vip_factors.io.schemas.detections_2d_pb2 import Detections2D
from vip_factors.io.schemas.imu_sample_pb2 import ImuSample
from vip_factors.io.schemas.recording_info_pb2 import SceneInfo
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.multi_file import join_wearers
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Camera, Scene
from vip_factors.sensors.sources import (
    MARGIN_S,
    RecordingInMemory,
    SceneInMemory,
    SceneSource,
    UnfilmedSource,
    camera_between,
    streams_between,
)

ESTIMATE, CAMERA = "/estimate/", "/camera/"
CAMERA_SCHEMAS = ("foxglove.CameraCalibration", "foxglove.PoseInFrame")  # not its images
COUNTED_S = 60.0  # of detections read at once to count them
INDEXED_S = 1e-5  # between the time of a sample and that of its message, where only rounding sets them apart
CLOCK_SLACK_S = 0.5  # between the time of a sample and that at which it was logged


@dataclass(frozen=True)
class WearerFile(RecordingInMemory):
    """One wearer's recording in an MCAP file; ``recording`` holds the first and the last sample of each sensor.

    Attributes:
        file: the MCAP file.
        prefix: of the wearer's topics.
    """

    file: McapByTime
    prefix: str

    def between(self, start: float = -np.inf, end: float = np.inf) -> Mapping[str, ImuStream]:
        """Samples with ``start <= time <= end``."""
        return self.among(self.file.between(*_logged(self.head.start_ns, start, end)), start, end)

    def among(self, contents: McapContents, start: float, end: float) -> Mapping[str, ImuStream]:
        """Samples with ``start <= time <= end`` among messages that were read."""
        path, topics = self.file.contents.path, self.prefix + IMU
        channels = [messages for messages in contents.messages.values() if messages.channel.topic.startswith(topics)]
        with naming(path):
            streams = read_streams(path, channels, self.head.start_ns)
        return streams_between(streams, self.sensors, start, end)


@dataclass(frozen=True)
class SceneFile(UnfilmedSource):
    """A scene with a camera in an MCAP file.

    Its ``scene`` holds the first and the last video frame of each camera, and such samples of its sensor.

    Attributes:
        file: the MCAP file.
        topics: of the cameras.
    """

    sources: tuple[WearerFile, ...]
    file: McapByTime
    topics: tuple[CameraTopics, ...]

    def between(self, start: float = -np.inf, end: float = np.inf) -> Scene:
        """Measurements with ``start <= time <= end``."""
        reach = start - MARGIN_S, end + MARGIN_S
        contents = self._contents(*reach)
        wearers = tuple(replace(source.head, imus=source.among(contents, *reach)) for source in self.sources)
        with naming(contents.path):
            cameras = tuple(
                self._camera(camera, camera_topics, Topics(contents), start, end)
                for camera, camera_topics in zip(self.scene.cameras, self.topics, strict=True)
            )
        return Scene(self.scene.name, wearers, cameras)

    def detected(self, start: float, end: float, camera: str) -> int:
        """Number of a camera's detections in ``start <= time < end``."""
        number = [candidate.name for candidate in self.scene.cameras].index(camera)
        filmed, topic = self.scene.cameras[number], self.topics[number]("detections")
        time, clock = filmed.timed_detections.time, filmed.clock
        if not len(time):
            return 0
        start, end, count = max(start, float(time[0])), min(end, float(np.nextafter(time[-1], np.inf))), 0
        while start < end:
            piece_end = min(start + COUNTED_S, end)
            for frame in Topics(self._contents(start, piece_end)).all(topic, Detections2D):
                count += len(frame.people) * (start <= frame.seconds + clock.late(frame.seconds) < piece_end)
            start = piece_end
        return count

    def _contents(self, start: float, end: float) -> McapContents:
        return self.file.between(*_logged(self.scene.start_ns, start, end))

    def _camera(self, camera: Camera, camera_topics: CameraTopics, topics: Topics, start: float, end: float) -> Camera:
        """A camera with its frames from ``start`` to ``end`` seconds, and the samples of the sensor on it."""
        frames = topics.all(camera_topics("detections"), Detections2D)
        for frame in reversed(frames):
            frame.frame -= frames[0].frame
        detections, *_ = detections_of(camera.keypoints, frames)
        mount = camera.mount
        if mount is not None:
            streams = read_streams(topics.path, topics.channels(camera_topics("imu"), ImuSample), self.scene.start_ns)
            imu = streams.get(mount.imu.name)
            mount = None if imu is None else replace(mount, imu=imu)
        return camera_between(replace(camera, detections=detections, mount=mount), start, end)


def _logged(start_ns: int, start: float, end: float) -> tuple[int, int]:
    """Log times in nanoseconds between which all measurements from ``start`` to ``end`` seconds lie."""
    first_ns = 0 if start == -np.inf else start_ns + round((start - CLOCK_SLACK_S) * NS_PER_S)
    last_ns = np.iinfo(np.int64).max if end == np.inf else start_ns + round((end + CLOCK_SLACK_S) * NS_PER_S)
    return max(first_ns, 0), int(last_ns)


def open_source(paths: Sequence[str | os.PathLike[str]], longer_than_s: float) -> SceneSource:
    """Open files that are parts of one recording; one longer than ``longer_than_s`` is read by time where possible.

    It is read at once if a file has no index (``mcap recover`` makes one), if its messages were logged at other times
    than the samples', if its first samples are incomplete, or if one of several parts has a camera.

    Raises:
        InputError: if there is no such file.
        FileFormatError: if it is no MCAP file, holds nothing of a recording, or files are not parts of one recording.
    """
    summaries = [read_summary(path) for path in paths] if np.isfinite(longer_than_s) else []
    source = None
    with warnings.catch_warnings(record=True) as caught_warnings:
        warnings.simplefilter("always")
        if summaries and _logged_s(summaries) > longer_than_s:
            files = [_indexed_file(path, summary) for path, summary in zip(paths, summaries, strict=True)]
            source = _joined_source(files, paths)
    if source is None or not any(wearer.interval[1] - wearer.interval[0] > longer_than_s for wearer in source.wearers):
        return SceneInMemory(read_scenes([Path(path) for path in paths]))
    for warning in caught_warnings:  # reading at once repeats them
        warnings.warn(warning.message, stacklevel=2)
    return source


def _logged_s(summaries: Sequence[Summary | None]) -> float:
    """Seconds from the first to the last message of files, with slack; infinite where a file does not state them."""
    statistics = [summary.statistics for summary in summaries if summary is not None and summary.statistics is not None]
    if len(statistics) < len(summaries):
        return np.inf
    start_ns = min(file.message_start_time for file in statistics)
    end_ns = max(file.message_end_time for file in statistics)
    return (end_ns - start_ns) / NS_PER_S + 2 * CLOCK_SLACK_S


def _indexed_file(path: str | os.PathLike[str], summary: Summary | None) -> McapByTime | None:
    return McapByTime.open(path, summary, _comes_once, _comes_in_time)


def _joined_source(
    files: Sequence[McapByTime | None], paths: Sequence[str | os.PathLike[str]]
) -> UnfilmedSource | None:
    """Parts of one recording as one source; None if a part cannot be read by time, or one of several has a camera."""
    sources = [None if file is None or file.log_times() is None else _source_of(file) for file in files]
    readable = [source for source in sources if source is not None]
    if len(readable) < len(files) or (len(readable) > 1 and any(source.scene.cameras for source in readable)):
        return None
    if len(readable) == 1:
        return readable[0]
    wearers = join_wearers([source.wearers for source in readable], [str(path) for path in paths])
    return UnfilmedSource(Scene(readable[0].scene.name, tuple(wearer.head for wearer in wearers)), wearers)


def _source_of(file: McapByTime, has_truth: bool = False) -> UnfilmedSource | None:
    """The scene in a file, without the frames of a truth; None if it cannot be read by time."""
    contents, topics = file.contents, Topics(file.contents)
    info = topics.last(SCENE_INFO, SceneInfo)
    try:
        with naming(contents.path):
            wearers = tuple(
                WearerFile(recording_of(contents, prefix, has_truth), file, prefix)
                for prefix in wearer_prefixes(contents, info)
            )
            if not wearers or not _is_logged_in_time(contents, wearers[0].head.start_ns):
                return None
    except RecordingError:  # the first and the last sample of a sensor may be incomplete
        return None
    heads = tuple(wearer.head for wearer in wearers)
    name = heads[0].name if info is None else info.name
    if not any(topic.startswith(CAMERA) for topic in contents.topics):
        return UnfilmedSource(Scene(name, heads), wearers)
    prefixes = () if info is None else info.further_camera_topics
    camera_topics = (FIRST_CAMERA, *map(CameraTopics, prefixes))
    with warnings.catch_warnings(), naming(contents.path):
        warnings.simplefilter("ignore")  # about video frames, of which two were read
        cameras = [camera_of(topics, topic_of, heads[0].start_ns, has_truth=False) for topic_of in camera_topics]
    complete = tuple(camera for camera in cameras if camera is not None)
    if len(complete) < len(cameras):
        return None
    return SceneFile(Scene(name, heads, complete), wearers, file, camera_topics)


def _is_logged_in_time(contents: McapContents, start_ns: int) -> bool:
    """Whether the first and last samples and video frames of all channels are usable, and were logged when measured."""
    for messages in contents.messages.values():
        if is_ours(messages.channel, ImuSample):
            usable = sum(map(len, read_streams(contents.path, [messages], start_ns).values()))
            samples = parsed(contents.path, messages, ImuSample)
            measured_ns = [start_ns + sample_time(sample, start_ns) * NS_PER_S for sample in samples]
        elif is_ours(messages.channel, Detections2D):
            measured_ns = [time_ns_of(frame.timestamp) for frame in parsed(contents.path, messages, Detections2D)]
            usable = len(measured_ns)
        else:
            continue
        late = (abs(measured - logged) for measured, logged in zip(measured_ns, messages.log_times, strict=True))
        if usable < len(messages.data) or max(late, default=0) > CLOCK_SLACK_S * NS_PER_S:
            return False
    return True


@dataclass(frozen=True)
class RecordingIndex:
    """A recording whose samples were not read, by the index of its file.

    Attributes:
        head: the recording, with the first and the last sample of each sensor, and a truth without frames.
        time: by sensor, of its samples ``(N,)``, seconds.
        truth_frames: number of the truth's frames.
    """

    head: Recording
    time: Mapping[str, Array]
    truth_frames: int


def indexed_recording(path: str | os.PathLike[str], longer_than_s: float) -> RecordingIndex | None:
    """One wearer's recording without a camera by its file's index, if it is longer than ``longer_than_s``.

    None if the file has no index, was logged at other times than the samples', or holds more.

    Raises:
        InputError: if there is no such file.
    """
    summary = read_summary(path)
    file = _indexed_file(path, summary) if _logged_s([summary]) > longer_than_s else None
    log_times = None if file is None else file.log_times()
    if file is None or log_times is None:
        return None
    contents = file.contents
    if any(topic.startswith((ESTIMATE, CAMERA)) for topic in contents.topics):
        return None
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".* frames are left")  # of the truth, whose frames were not read
        source = _source_of(file, has_truth=True)
    wearers = () if source is None else source.wearers
    if len(wearers) != 1 or not isinstance(wearers[0], WearerFile):
        return None
    head, time, truth_frames = wearers[0].recording, dict[str, Array](), 0
    for number, times_ns in log_times.items():
        messages = contents.messages[number]
        if messages.channel.topic.endswith(TRUTH_POSE):
            truth_frames = len(times_ns)
        if not is_ours(messages.channel, ImuSample):
            continue
        (stream,) = read_streams(contents.path, [messages], head.start_ns).values()
        logged_s = (times_ns - head.start_ns) / NS_PER_S
        ends = logged_s[[0, -1]][-len(stream) :]
        if np.any(np.diff(logged_s) <= 0) or not np.allclose(stream.time, ends, 0, INDEXED_S):
            return None
        time[stream.name] = logged_s
    return RecordingIndex(head, time, truth_frames)


def _comes_once(channel: McapChannel) -> bool:
    is_of_camera = channel.topic.startswith(CAMERA) and channel.schema_name in CAMERA_SCHEMAS
    is_of_frames = _comes_in_time(channel) or is_ours(channel, BodyPose)
    return (is_ours(channel) or is_of_camera) and not is_of_frames and not channel.topic.startswith(ESTIMATE)


def _comes_in_time(channel: McapChannel) -> bool:
    return is_ours(channel, ImuSample) or is_ours(channel, Detections2D)
