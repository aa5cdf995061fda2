"""An MCAP file that another program is still writing, as a live source."""

import os
import time
from collections.abc import Iterator
from io import BufferedReader, FileIO
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Any

from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from google.protobuf.message import DecodeError
from mcap.records import DataEnd

from vip_factors.errors import FileFormatError, InputError
from vip_factors.io.codec import time_ns_of
from vip_factors.io.live_messages import imu_sample_of, setup_of, video_frame_of
from vip_factors.io.live_source import FindingReporter, LiveSource
from vip_factors.io.mcap_camera import CameraTopics, path_of
from vip_factors.io.mcap_frames import camera_poses
from vip_factors.io.mcap_messages import PROTOBUF, is_ours, naming
from vip_factors.io.mcap_reader import McapChannel, McapPass, largest_chunk
from vip_factors.io.mcap_recording import FIRST_CAMERA, IMU, INFO, SCENE_INFO
from vip_factors.io.schemas.camera_info_pb2 import CameraInfo
from vip_factors.io.schemas.detections_2d_pb2 import Detections2D
from vip_factors.io.schemas.imu_sample_pb2 import ImuSample
from vip_factors.io.schemas.live_message_pb2 import LiveCamera, LiveHeader, LiveWearer
from vip_factors.io.schemas.recording_info_pb2 import RecordingInfo, SceneInfo
from vip_factors.io.settings import DEFAULT, LiveSourceSettings
from vip_factors.sensors.camera import VideoClock
from vip_factors.sensors.live import LiveSample
from vip_factors.sensors.scene import Camera, Scene

if TYPE_CHECKING:
    from typing_extensions import Buffer

KINDS: dict[str, type[Any]] = {
    kind.DESCRIPTOR.full_name: kind
    for kind in (SceneInfo, RecordingInfo, CameraInfo, CameraCalibration, PoseInFrame, ImuSample, Detections2D)
}
"""Messages of a scene by the names of their schemas."""
LOOK_EVERY = 0.03  # seconds between looks at the file's size: half a frame
TRUTH = "/truth/"

TopicMessage = tuple[str, Any]
"""Topic and decoded message."""


class GrowingFile(FileIO):
    """A file at whose end reading waits for more; it ends when it has not grown for a while.

    Attributes:
        growth_wait: seconds without growth after which it ends.
        has_ended: whether that is so, or ``stop`` was set.

    Args:
        path: of the file.
        settings: limits.
        stop: set when nothing more is wanted.

    Raises:
        OSError: if it cannot be opened.
    """

    def __init__(self, path: Path, settings: LiveSourceSettings, stop: Event) -> None:
        super().__init__(path)
        self.growth_wait, self.has_ended = settings.growth_wait, False
        self._path, self._stop = path, stop

    def readinto(self, buffer: "Buffer") -> int:
        """Read as many bytes as there are, once there are some; none at the end.

        Raises:
            FileFormatError: if the file becomes shorter.
        """
        waiting_from = time.monotonic()
        while not self.has_ended:
            count = super().readinto(buffer)
            if count:
                return count
            if os.fstat(self.fileno()).st_size < self.tell():
                raise FileFormatError(f"{self._path} became shorter while it was followed: start the stream again")
            is_stopped = self._stop.wait(LOOK_EVERY)
            self.has_ended = is_stopped or time.monotonic() - waiting_from > self.growth_wait
        return 0


class GrowingFileSource(LiveSource):
    """Source that follows a file to its footer, or until it stops growing. Nothing is dropped.

    Args:
        path: of the file, which may come a little later.
        settings: as of every source.
    """

    def __init__(self, path: str | os.PathLike[str], settings: LiveSourceSettings = DEFAULT) -> None:
        super().__init__(str(path), settings, drops=False)
        self._path = Path(path)
        self._reporter = FindingReporter(self.name, self._queue.put)
        self._head = _Head()

    def _read(self) -> None:
        head, early = self._head, list[TopicMessage]()  # samples before the set-up is complete
        with self._open_when_it_comes() as file:
            for topic, message in self._messages(file):
                if self._stop.is_set():
                    return
                if not isinstance(message, ImuSample | Detections2D):
                    head.messages.setdefault((topic, type(message)), message)
                elif head.is_announced:
                    self._put_sample(topic, message)
                else:
                    early.append((topic, message))
                is_full = len(early) > self._settings.queue_limit
                if not head.is_announced and (is_full or head.is_complete(bool(early))):
                    self._begin(early)
        self._reporter.close()
        if not head.is_announced and not self._stop.is_set():
            self._begin(early)

    def _open_when_it_comes(self) -> GrowingFile:
        begun, wait = time.monotonic(), self._settings.growth_wait
        while True:
            try:
                return GrowingFile(self._path, self._settings, self._stop)
            except FileNotFoundError as error:
                if time.monotonic() - begun > wait or self._stop.wait(LOOK_EVERY):
                    raise InputError(
                        f"{self._path}: no such file, nor did it come within {wait:g} s; expected an MCAP file that "
                        "another program writes"
                    ) from error
            except OSError as error:
                raise InputError(f"{self._path}: cannot be read: {error.strerror}") from error

    def _messages(self, file: GrowingFile) -> Iterator[TopicMessage]:
        """The messages of a scene, until the file's data or its growth ends."""
        reading = McapPass(self._path, self._is_wanted, refuses_large=False)
        for record in reading.records(BufferedReader(file), largest_chunk()):
            for sentence in reading.take_complaints():
                self._reporter.report("chunk", sentence)
            for number, data in reading.take_messages():
                channel = reading.gathered[number].channel
                try:
                    yield channel.topic, KINDS[channel.schema_name].FromString(data)
                except DecodeError as error:
                    sentence = f"a message on {channel.topic} is no {channel.schema_name} ({error}): it is left out"
                    self._reporter.report("message", sentence)
            if isinstance(record, DataEnd):
                return
        if file.has_ended and not self._stop.is_set():
            self._reporter.report("end", f"it has not grown for {file.growth_wait:g} s: taken as its end")
        elif not self._stop.is_set():
            for sentence in reading.take_complaints():
                self._reporter.report("end", sentence)

    def _is_wanted(self, channel: McapChannel) -> bool:
        kind = KINDS.get(channel.schema_name)
        is_known = kind is not None and is_ours(channel, kind)
        if IMU in channel.topic and not channel.topic.startswith(FIRST_CAMERA.prefix) and not is_known:
            self._reporter.report(
                f"schema of {channel.topic}",
                f"channel {channel.topic} has {channel.schema_name or 'no schema'} ({channel.encoding}): expected "
                f"{ImuSample.DESCRIPTOR.full_name} ({PROTOBUF}); its messages are left out",
            )
        return is_known and not channel.topic.startswith(TRUTH)

    def _begin(self, early: list[TopicMessage]) -> None:
        with naming(self._path):
            setup = self._head.setup()
        for camera, info in zip(setup.cameras, self._head.camera_infos, strict=True):
            if info.moving and info.known_poses:
                sentence = (
                    f"camera '{camera.name}' is said to move on a known path, which a growing file does not hold yet: "
                    "its poses are estimated instead"
                )
                self._reporter.report(sentence, sentence)
        self._queue.put(setup)
        for topic, message in early:
            self._put_sample(topic, message)

    def _put_sample(self, topic: str, message: ImuSample | Detections2D) -> None:
        try:
            sample = self._head.sample(topic, message)
        except FileFormatError as error:
            self._reporter.report(type(message).__name__, str(error))
            return
        if sample is not None:
            self._queue.put(sample)
        else:
            self._reporter.report(
                f"owner of {topic}",
                f"{topic} belongs to nobody whom the file's beginning describes: its messages are left out",
            )


class _Head:
    """Messages of the set-up, and conversion of messages into samples.

    A file without a SceneInfo before its first sample is a recording of one wearer.

    Attributes:
        messages: by topic and kind; the first pose of a camera.
        is_announced: whether :meth:`setup` was made, after which samples are converted.
    """

    def __init__(self) -> None:
        self.messages: dict[tuple[str, type[Any]], Any] = {}
        self._wearers: dict[str, str] = {}  # names, by what the topics begin with
        self._cameras: dict[str, Camera] = {}
        self._start_ns = 0
        self.is_announced = False

    def is_complete(self, has_samples: bool) -> bool:
        """Return whether all messages of the set-up have come, with the known pose of a static camera."""
        if not (has_samples or (SCENE_INFO, SceneInfo) in self.messages) or self._missing:
            return False
        cameras = zip(self._camera_topics, self.camera_infos, strict=True)
        standing = [topic_of for topic_of, info in cameras if _stands_known(info)]
        return all((topic_of("pose"), PoseInFrame) in self.messages for topic_of in standing)

    def setup(self) -> Scene:
        """The set-up, which names carriers and clocks.

        Raises:
            InputError: for what no wearer or camera can be, or if something is missing.
        """
        if self._missing:
            raise FileFormatError(f"expected a recording or a scene; there is nothing on {', '.join(self._missing)}")
        infos = [self.messages[prefix + INFO, RecordingInfo] for prefix in self._wearer_prefixes]
        self._start_ns = time_ns_of(infos[0].start)
        wearers = [
            LiveWearer(subject=info.subject, placement=info.placement, initial_pose=info.initial_pose) for info in infos
        ]
        cameras = [self._camera(topic_of) for topic_of in self._camera_topics]
        name = self._scene.name or infos[0].name
        setup = setup_of(LiveHeader(name=name, start=infos[0].start, wearers=wearers, cameras=cameras))
        names = [wearer.subject.name for wearer in setup.wearers]
        self._wearers = dict(zip(self._wearer_prefixes, names, strict=True))
        prefixes = [topic_of.prefix for topic_of in self._camera_topics]
        self._cameras = dict(zip(prefixes, setup.cameras, strict=True))
        self.is_announced = True
        return setup

    @property
    def camera_infos(self) -> list[CameraInfo]:
        """Description of each camera, once nothing is missing."""
        return [self.messages[topic_of("info"), CameraInfo] for topic_of in self._camera_topics]

    @property
    def _scene(self) -> SceneInfo:
        scene: SceneInfo = self.messages.get((SCENE_INFO, SceneInfo), SceneInfo())
        return scene

    @property
    def _wearer_prefixes(self) -> list[str]:
        return list(self._scene.wearer_topics) or [""]

    @property
    def _camera_topics(self) -> list[CameraTopics]:
        first_camera = [FIRST_CAMERA] if self._scene.has_camera else []
        return [*first_camera, *map(CameraTopics, self._scene.further_camera_topics)]

    @property
    def _missing(self) -> list[str]:
        """Topics of which a set-up still needs a message."""
        needed: list[tuple[str, type[Any]]] = [(prefix + INFO, RecordingInfo) for prefix in self._wearer_prefixes]
        for topic_of in self._camera_topics:
            needed += [(topic_of("info"), CameraInfo), (topic_of("calibration"), CameraCalibration)]
        return [topic for topic, kind in needed if (topic, kind) not in self.messages]

    def _camera(self, topic_of: CameraTopics) -> LiveCamera:
        info = self.messages[topic_of("info"), CameraInfo]
        pose = self.messages.get((topic_of("pose"), PoseInFrame)) if _stands_known(info) else None
        path = None if pose is None else path_of([pose], self._start_ns)
        poses = () if path is None else camera_poses(path, self._start_ns)
        calibration = self.messages[topic_of("calibration"), CameraCalibration]
        return LiveCamera(info=info, calibration=calibration.SerializeToString(), known_poses=poses)

    def sample(self, topic: str, message: ImuSample | Detections2D) -> LiveSample | None:
        """Return the sample of a message; None if its carrier is not in the set-up.

        Raises:
            FileFormatError: for one that cannot be used.
        """
        prefix, _, leaf = topic.rpartition("/")
        camera = self._cameras.get(prefix)
        if isinstance(message, Detections2D):
            if camera is None:
                return None
            info = self.messages[f"{prefix}/info", CameraInfo]
            clock = VideoClock(info.time_offset_s, info.time_drift)
            return video_frame_of(message, camera.name, self._start_ns, len(camera.keypoints), clock)
        if camera is not None:
            sensor = camera.mount.imu.name if camera.mount is not None else leaf
            return imu_sample_of(message, camera.name, self._start_ns, sensor)
        wearer = next((name for start, name in self._wearers.items() if topic.startswith(start + IMU)), None)
        return None if wearer is None else imu_sample_of(message, wearer, self._start_ns, leaf)


def _stands_known(info: CameraInfo) -> bool:
    """Return whether a static camera has a known pose in the file."""
    return info.known_poses == 1 and not info.moving
