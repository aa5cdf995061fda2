"""A recording in an MCAP file, whose samples are read window by window."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from vip_factors.errors import RecordingError
from vip_factors.io.codec import NS_PER_S
from vip_factors.io.mcap_messages import is_ours, naming, of_topic
from vip_factors.io.mcap_reader import McapByTime, McapChannel, McapContents, McapMessages
from vip_factors.io.mcap_recording import IMU, SCENE_INFO, recording_of, wearer_prefixes
from vip_factors.io.mcap_samples import read_streams
from vip_factors.io.schemas.detections_2d_pb2 import Detections2D
from vip_factors.io.schemas.imu_sample_pb2 import ImuSample
from vip_factors.io.schemas.scene_info_pb2 import SceneInfo
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.parts import wearers_in_parts
from vip_factors.sensors.recording import Recording, nothing_placed
from vip_factors.sensors.sampled import LEAST_SAMPLES, SampledRecording

TRUTH = "/truth/"
ESTIMATE, CAMERA = "/estimate/", "/camera/"
CAMERA_SCHEMAS = ("foxglove.CameraCalibration", "foxglove.PoseInFrame")  # not its images
CLOCK_SLACK_S = 0.5  # between the time of a sample and that at which it was logged


@dataclass(frozen=True)
class SampledFile:
    """One wearer's recording in an MCAP file; see :class:`~vip_factors.sensors.sampled.SampledRecording`.

    Attributes:
        file: it.
        ends: the recording, with the first and the last sample of each sensor.
        prefix: what its topics begin with.
    """

    file: McapByTime
    ends: Recording
    prefix: str

    @cached_property
    def head(self) -> Recording:
        """See the protocol."""
        return replace(self.ends, imus={})

    @cached_property
    def sensors(self) -> tuple[str, ...]:
        """See the protocol."""
        return tuple(self.ends.placed)

    @property
    def interval(self) -> tuple[float, float]:
        """See the protocol.

        Raises:
            RecordingError: if no sensor is placed.
        """
        if not self.sensors:
            raise nothing_placed(self.head.name, self.ends.imus)
        streams = [self.ends.imus[name] for name in self.sensors]
        return float(min(one.time[0] for one in streams)), float(max(one.time[-1] for one in streams))

    def channels(self, contents: McapContents) -> list[McapMessages]:
        """The wearer's samples among some messages."""
        return [one for one in contents.messages.values() if one.channel.topic.startswith(self.prefix + IMU)]

    @property
    def is_found_by_time(self) -> bool:
        """Whether the ends are whole, and were logged at their samples' own times."""
        for messages in self.channels(self.file.contents):
            for stream in read_streams(self.file.path, [messages], self.head.start_ns).values():
                if len(stream) < len(messages.data):
                    return False
                logged = np.array([self._seconds(one) for one in messages.log_times])
                if np.max(np.abs(logged - stream.time)) > CLOCK_SLACK_S:
                    return False
        return True

    def _seconds(self, log_time: int) -> float:
        return (log_time - self.head.start_ns) / NS_PER_S

    def between(self, start: float, end: float) -> Mapping[str, ImuStream]:
        """See the protocol.

        Raises:
            RecordingError, FileFormatError: if the samples are unusable.
        """
        first, last = (
            self.head.start_ns + round((one + slack) * NS_PER_S)
            for one, slack in ((start, -CLOCK_SLACK_S), (end, CLOCK_SLACK_S))
        )
        return self.among(self.file.between(max(first, 0), last), start, end)

    def among(self, contents: McapContents, start: float, end: float) -> Mapping[str, ImuStream]:
        """The same among messages that were read already.

        Raises:
            RecordingError, FileFormatError: if the samples are unusable.
        """
        with naming(self.file.path):
            streams = read_streams(self.file.path, self.channels(contents), self.head.start_ns)
        found = {}
        for name in self.sensors:
            if name in streams:
                inside = (streams[name].time >= start) & (streams[name].time <= end)
                if np.count_nonzero(inside) >= LEAST_SAMPLES:
                    found[name] = streams[name].cut(start, end)
        return found


@dataclass(frozen=True)
class SampledScene:
    """The wearers of an MCAP file, or of several that are parts of one recording, and whether there is a camera."""

    name: str
    wearers: tuple[SampledRecording, ...]
    has_camera: bool


def open_sampled(path: str | os.PathLike[str]) -> SampledScene | None:
    """The recordings in an MCAP file, to be read by time; None if it cannot be read so, but as a whole alone.

    That is a file whose messages stand outside of chunks, or were logged at other times than the samples', or whose
    first samples are not whole.

    Raises:
        InputError: if there is no such file.
        FileFormatError: if it is no MCAP file, or holds nothing of a recording.
    """
    file = McapByTime(path, _comes_once, _comes_in_time)
    messages = list(file.contents.messages.values())
    infos = of_topic(file.path, messages, SCENE_INFO, SceneInfo)
    try:
        with naming(file.path):
            wearers = tuple(
                SampledFile(file, recording_of(file.contents, messages, prefix), prefix)
                for prefix in wearer_prefixes(file.contents, messages, infos[-1] if infos else None)
            )
            if not (wearers and file.chunked and all(one.is_found_by_time for one in wearers)):
                return None
    except RecordingError:  # what the ends lack the rest may have
        return None
    camera = any(topic.startswith(CAMERA) for topic in file.contents.topics)
    return SampledScene(infos[-1].name if infos else wearers[0].head.name, wearers, camera)


def open_sampled_parts(paths: Sequence[str | os.PathLike[str]]) -> SampledScene | None:
    """The same of files that follow one another in time; None if one of them cannot be read by time, or has a camera.

    Raises:
        InputError, FileFormatError: as :func:`open_sampled`, and if they are not parts of one recording.
    """
    parts = []
    for path in paths:
        part = open_sampled(path)
        if part is None or (part.has_camera and len(paths) > 1):
            return None
        parts.append(part)
    if len(parts) == 1:
        return parts[0]
    wearers = wearers_in_parts([one.wearers for one in parts], [str(path) for path in paths])
    return SampledScene(parts[0].name, wearers, False)


def _comes_once(channel: McapChannel) -> bool:
    passed = channel.topic.startswith(ESTIMATE) or TRUTH in channel.topic or _comes_in_time(channel)
    of_camera = channel.topic.startswith(CAMERA) and channel.schema_name in CAMERA_SCHEMAS
    return (is_ours(channel) or of_camera) and not passed


def _comes_in_time(channel: McapChannel) -> bool:
    return is_ours(channel, ImuSample) or is_ours(channel, Detections2D)
