"""The messages of a scene in an MCAP file that another program is still writing."""

import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import BufferedReader, FileIO
from pathlib import Path
from threading import Event
from typing import IO, TYPE_CHECKING, Any

from mcap.records import DataEnd

from vip_factors.errors import FileFormatError, InputError
from vip_factors.io.mcap_chunks import largest_chunk
from vip_factors.io.mcap_messages import PROTOBUF
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
        since = time.monotonic()
        while not self.has_ended:
            count = super().readinto(buffer)
            if count:
                return count
            if os.fstat(self.fileno()).st_size < self.tell():
                raise FileFormatError(f"{self._path} has become shorter while it was followed: start anew with it")
            is_stopped = self._stop.wait(LOOK_EVERY)
            self.has_ended = is_stopped or time.monotonic() - since > self.growth_wait
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


class GrowingPass(McapPass):
    """A pass over a growing file that decodes the messages of a scene as they come.

    Args:
        path: of the file.
        stop: set when nothing more is wanted.
        on_finding: is told what cannot be read or used.
    """

    def __init__(self, path: Path, stop: Event, on_finding: OnFinding) -> None:
        super().__init__(path, lambda channel: False)
        self._stop, self._on_finding = stop, on_finding
        self._routes: dict[int, Route | None] = {}
        self._first_channels: dict[str, McapChannel] = {}  # by topic
        self._received: list[tuple[Route, Any]] = []

    def messages(self, file: GrowingFile) -> Iterator[tuple[Route, Any]]:
        """The messages that belong to a scene, decoded, until the file's data or its growth ends.

        Raises:
            FileFormatError: if it is no MCAP file, or becomes shorter.
        """
        for record in self.records(BufferedReader(file), largest_chunk()):
            received, self._received = self._received, []
            yield from received
            if isinstance(record, DataEnd):
                return

    def know(self, channel: McapChannel) -> None:
        """Take in a channel, whose schema is that of its topic's first."""
        if channel.id in self._routes:
            return
        super().know(channel)
        first = self._first_channels.setdefault(channel.topic, channel)
        if (first.schema_name, first.schema_data) == (channel.schema_name, channel.schema_data):
            self._routes[channel.id] = self._route(channel)
            return
        self._routes[channel.id] = None
        self._on_finding(
            f"schema of {channel.topic}",
            f"{channel.topic}: the schema changes mid-way (to {channel.schema_name or 'none'}); the messages are left "
            "out from here on",
        )

    def add(self, number: int, sequence: int, log_time: int, publish_time: int, data: bytes) -> None:
        """Decode a message."""
        from google.protobuf.message import DecodeError

        if number not in self._routes:
            self._on_finding("nameless", f"a message belongs to no channel of the file ({number}): it is left out")
        route = self._routes.get(number)
        if route is None:
            return
        try:
            self._received.append((route, route.kind.FromString(data)))
        except DecodeError as error:
            self._on_finding(
                "message",
                f"a message on {route.channel.topic} is no {route.kind.DESCRIPTOR.full_name} ({error}): it is left out",
            )

    def report(self, sentence: str) -> None:
        """Tell at once."""
        self._on_finding("chunk", sentence)

    def refuse(self, sentence: str) -> None:
        """Leave out a chunk: the stream goes on."""
        self._on_finding("size", f"{sentence}: its messages are left out")

    def end_early(self, file: IO[bytes], at: int) -> None:
        """Tell why what follows a byte is not read."""
        raw = file.raw if isinstance(file, BufferedReader) else file
        if isinstance(raw, GrowingFile) and raw.has_ended:
            if not self._stop.is_set():
                self._on_finding("end", f"it has not grown for {raw.growth_wait:g} s: taken as its end")
        else:
            self._on_finding("end", f"it is damaged at byte {at:,}: what follows is lost")

    def _route(self, channel: McapChannel) -> Route | None:
        found = _owner(channel.topic)
        if found is None:
            return None
        owner, kind = found
        name = kind.DESCRIPTOR.full_name
        if (channel.schema_name, channel.encoding, channel.schema_encoding) != (name, PROTOBUF, PROTOBUF):
            self._on_finding(
                f"schema of {channel.topic}",
                f"channel {channel.topic} has {channel.schema_name or 'no schema'} ({channel.encoding}): expected "
                f"{name} ({PROTOBUF}); its messages are left out",
            )
            return None
        return Route(channel, owner, kind)


def _owner(topic: str) -> tuple[str, type[Any]] | None:
    """What the topics of the same wearer or camera begin with, and the messages that belong on this one."""
    if topic == SCENE_INFO:
        return "", SceneInfo
    if topic.startswith(CAMERA):
        owner, _, leaf = topic.rpartition("/")
        kind = _camera_kinds().get(leaf)
    else:
        owner = "/".join(topic.split("/")[:3]) if topic.startswith(WEARER) else ""
        rest = topic.removeprefix(owner)
        kind = ImuSample if rest.startswith(IMU) else RecordingInfo if rest == INFO else None
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
