"""The messages of a scene in an MCAP file that another program is still writing."""

import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import BufferedReader, FileIO
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Any

from mcap.records import DataEnd

from vip_factors.errors import FileFormatError, InputError
from vip_factors.io.mcap_chunks import largest_chunk
from vip_factors.io.mcap_messages import PROTOBUF, is_ours
from vip_factors.io.mcap_reader import McapChannel, McapPass
from vip_factors.io.mcap_recording import IMU, INFO, SCENE_INFO, WEARER
from vip_factors.io.schemas.camera_info_pb2 import CameraInfo
from vip_factors.io.schemas.detections_2d_pb2 import Detections2D
from vip_factors.io.schemas.imu_sample_pb2 import ImuSample
from vip_factors.io.schemas.recording_info_pb2 import RecordingInfo, SceneInfo
from vip_factors.io.settings import LiveSourceSettings

if TYPE_CHECKING:
    from typing_extensions import Buffer

LOOK_EVERY = 0.03  # seconds between looks at the file's size: half a frame
CAMERA = "/camera"

OnFinding = Callable[[str, str], None]
"""Gets a kind and a sentence about what cannot be read or used."""


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
                raise FileFormatError(f"{self._path} has become shorter while it was followed: start anew with it")
            is_stopped = self._stop.wait(LOOK_EVERY)
            self.has_ended = is_stopped or time.monotonic() - waiting_from > self.growth_wait
        return 0


def open_when_it_comes(path: Path, settings: LiveSourceSettings, stop: Event) -> GrowingFile:
    """The file, which may come a little later.

    Raises:
        InputError: if it does not come, or cannot be read.
    """
    begun = time.monotonic()
    while True:
        try:
            return GrowingFile(path, settings, stop)
        except FileNotFoundError as error:
            if time.monotonic() - begun > settings.header_wait or stop.wait(LOOK_EVERY):
                raise InputError(
                    f"{path}: no such file, nor did it come within {settings.header_wait:g} s; "
                    "expected an MCAP file that another program writes"
                ) from error
        except OSError as error:
            raise InputError(f"{path}: cannot be read: {error.strerror}") from error


@dataclass(frozen=True)
class Route:
    """Where a channel's messages belong.

    Attributes:
        channel: of the file.
        owner: what the topics of the wearer or camera begin with.
        kind: class of the messages.
    """

    channel: McapChannel
    owner: str
    kind: type[Any]


def followed_messages(path: Path, file: GrowingFile, stop: Event, on_finding: OnFinding) -> Iterator[tuple[Route, Any]]:
    """The messages of a scene, decoded, until the file's data or its growth ends.

    Args:
        path: of the file.
        file: it, open.
        stop: set when nothing more is wanted.
        on_finding: is told what cannot be read or used.

    Raises:
        FileFormatError: if it is no MCAP file, or becomes shorter.
    """
    routes: dict[int, Route] = {}

    def is_wanted(channel: McapChannel) -> bool:
        route = _route(channel, on_finding)
        if route is not None:
            routes[channel.id] = route
        return route is not None

    reading = McapPass(path, is_wanted)
    for record in reading.records(BufferedReader(file), largest_chunk()):
        for sentence in reading.take_complaints():
            on_finding("chunk", sentence)
        for number, data in reading.take_messages():
            message = _decoded(routes[number], data, on_finding)
            if message is not None:
                yield routes[number], message
        if isinstance(record, DataEnd):
            return
    if file.has_ended and not stop.is_set():
        on_finding("end", f"it has not grown for {file.growth_wait:g} s: taken as its end")
    elif not stop.is_set():
        for sentence in reading.take_complaints():
            on_finding("end", sentence)


def _decoded(route: Route, data: bytes, on_finding: OnFinding) -> Any:
    from google.protobuf.message import DecodeError

    try:
        return route.kind.FromString(data)
    except DecodeError as error:
        name = route.kind.DESCRIPTOR.full_name
        on_finding("message", f"a message on {route.channel.topic} is no {name} ({error}): it is left out")
        return None


def _route(channel: McapChannel, on_finding: OnFinding) -> Route | None:
    owner = _owner(channel.topic)
    if owner is None:
        return None
    topics, kind = owner
    if not is_ours(channel, kind):
        on_finding(
            f"schema of {channel.topic}",
            f"channel {channel.topic} has {channel.schema_name or 'no schema'} ({channel.encoding}): expected "
            f"{kind.DESCRIPTOR.full_name} ({PROTOBUF}); its messages are left out",
        )
        return None
    return Route(channel, topics, kind)


def _owner(topic: str) -> tuple[str, type[Any]] | None:
    """What the topics of the same wearer or camera begin with, and the messages that belong on this one."""
    if topic == SCENE_INFO:
        return "", SceneInfo
    if topic.startswith(CAMERA):
        owner, _, leaf = topic.rpartition("/")
        kind = _camera_kinds().get(leaf)
    else:
        owner = "/".join(topic.split("/")[:3]) if topic.startswith(WEARER) else ""
        leaf_topic = topic.removeprefix(owner)
        kind = ImuSample if leaf_topic.startswith(IMU) else RecordingInfo if leaf_topic == INFO else None
    return (owner, kind) if kind is not None else None


def _camera_kinds() -> dict[str, type[Any]]:
    from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
    from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame

    return {
        "info": CameraInfo,
        "calibration": CameraCalibration,
        "detections": Detections2D,
        "imu": ImuSample,
        "pose": PoseInFrame,
    }
