"""A filmed scene in an MCAP file, whose samples and detections are read window by window."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from vip_factors.io.codec import NS_PER_S
from vip_factors.io.mcap_camera import CameraTopics, camera_of
from vip_factors.io.mcap_messages import naming, of_topic
from vip_factors.io.mcap_reader import McapByTime, McapContents, McapMessages
from vip_factors.io.mcap_recording import FIRST_CAMERA, SCENE_INFO
from vip_factors.io.mcap_sampled import CLOCK_SLACK_S, SampledFile, SampledScene
from vip_factors.io.mcap_samples import detections_of, read_streams
from vip_factors.io.schemas.camera_info_pb2 import CameraInfo
from vip_factors.io.schemas.detections_2d_pb2 import Detections2D
from vip_factors.io.schemas.scene_info_pb2 import SceneInfo
from vip_factors.sensors.long_scene import cut, mount_of, without_frames
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.sampled import MARGIN_S
from vip_factors.sensors.scene import Camera, Scene

COUNTED_S = 60.0  # of detections read at once where they are only counted


@dataclass(frozen=True)
class LongSceneFile:
    """A scene with a camera in an MCAP file; see :class:`~vip_factors.sensors.long_scene.LongScene`.

    Attributes:
        file: it.
        name: of the scene.
        wearers: their recordings.
        ends: its cameras, with the first and the last video frame, and such samples of the sensors on them.
        topics: of the cameras.
    """

    file: McapByTime
    name: str
    wearers: tuple[SampledFile, ...]
    ends: tuple[Camera, ...]
    topics: tuple[CameraTopics, ...]

    @cached_property
    def head(self) -> Scene:
        """See the protocol."""
        return self._scene([without_frames(one) for one in self.ends], [one.head for one in self.wearers])

    @property
    def video_start(self) -> float:
        """See the protocol."""
        time = self.ends[0].timed_detections.time
        return float(time[0]) if len(time) else np.inf

    def between(self, start: float, end: float) -> Scene:
        """See the protocol.

        Raises:
            RecordingError, FileFormatError: if what was measured is unusable.
        """
        reach = start - MARGIN_S, end + MARGIN_S
        contents = self._contents(*reach)
        messages = list(contents.messages.values())
        wearers = [replace(one.head, imus=one.among(contents, *reach)) for one in self.wearers]
        with naming(self.file.path):
            cameras = [self._camera(number, messages, start, end) for number in range(len(self.ends))]
        return self._scene(cameras, wearers)

    def detected(self, start: float, end: float) -> int:
        """See the protocol."""
        time, clock = self.ends[0].timed_detections.time, self.ends[0].clock
        if not len(time):
            return 0
        start, end, count = max(start, float(time[0])), min(end, float(np.nextafter(time[-1], np.inf))), 0
        while start < end:
            until = min(start + COUNTED_S, end)
            messages = list(self._contents(start, until).messages.values())
            for one in of_topic(self.file.path, messages, self._detections(0), Detections2D):
                count += len(one.people) * (start <= one.seconds + clock.late(one.seconds) < until)
            start = until
        return count

    @property
    def is_found_by_time(self) -> bool:
        """Whether video frames were logged at their own times, and all that is said of the cameras is there."""
        messages = list(self.file.contents.messages.values())
        for number, camera in enumerate(self.ends):
            for logged in (one for one in messages if one.channel.topic == self._detections(number)):
                seen = of_topic(self.file.path, [logged], self._detections(number), Detections2D)
                own = camera.clock.at(np.array([one.seconds for one in seen]))
                there = np.array([(one - self._start_ns) / NS_PER_S for one in logged.log_times])
                if len(own) and np.max(np.abs(own - there)) > CLOCK_SLACK_S:
                    return False
        return True

    @property
    def _start_ns(self) -> int:
        return self.wearers[0].head.start_ns

    def _detections(self, number: int) -> str:
        return self.topics[number]("detections")

    def _scene(self, cameras: Sequence[Camera], wearers: Sequence[Recording]) -> Scene:
        return Scene(self.name, tuple(wearers), cameras[0], None, tuple(cameras[1:]))

    def _contents(self, start: float, end: float) -> McapContents:
        first, last = (
            self._start_ns + round((one + slack) * NS_PER_S)
            for one, slack in ((start, -CLOCK_SLACK_S), (end, CLOCK_SLACK_S))
        )
        return self.file.between(max(first, 0), last)

    def _camera(self, number: int, messages: Sequence[McapMessages], start: float, end: float) -> Camera:
        """One camera with what it filmed between two instants, and what the sensor on it measured."""
        whole, topics, path = self.ends[number], self.topics[number], self.file.path
        info = of_topic(path, list(self.file.contents.messages.values()), topics("info"), CameraInfo)[-1]
        seen = of_topic(path, messages, topics("detections"), Detections2D)
        for one in reversed(seen):
            one.frame -= seen[0].frame
        detections, _ = detections_of(info, seen)
        mount = whole.mount
        if mount is not None:
            streams = read_streams(
                path, [one for one in messages if one.channel.topic == topics("imu")], self._start_ns
            )
            imu = streams.get(mount.imu.name)
            mount = None if imu is None else mount_of(mount, imu.cut(start - MARGIN_S, end + MARGIN_S))
        return replace(whole, detections=cut(detections, start, end, whole.clock), mount=mount, video=None)


def filmed_scene(sampled: SampledScene) -> LongSceneFile | None:
    """The scene of a file with its cameras; None if it has none, cannot be read by time, or is in several files.

    Raises:
        InputError, RecordingError: for a camera that cannot be used.
    """
    wearers = tuple(one for one in sampled.wearers if isinstance(one, SampledFile))
    if len(wearers) < len(sampled.wearers):
        return None
    file = wearers[0].file
    messages = list(file.contents.messages.values())
    infos = of_topic(file.path, messages, SCENE_INFO, SceneInfo)
    topics = [FIRST_CAMERA, *(CameraTopics(one) for one in (infos[-1].further_camera_topics if infos else ()))]
    with warnings.catch_warnings(), naming(file.path):
        warnings.simplefilter("ignore")  # of video frames there are two; whoever reads all of it says what is lost
        cameras = [camera_of(file.path, messages, one, wearers[0].head.start_ns)[0] for one in topics]
    found = tuple(one for one in cameras if one is not None)
    if len(found) < len(topics):
        return None
    scene = LongSceneFile(file, sampled.name, wearers, found, tuple(topics))
    return scene if scene.is_found_by_time else None
