"""The messages of a scene in an MCAP file that another program is still writing (https://mcap.dev/spec)."""

import os
import struct
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Any, BinaryIO

from vip_factors.errors import FileFormatError, InputError
from vip_factors.io import mcap_records
from vip_factors.io.mcap_messages import PROTOBUF
from vip_factors.io.mcap_recording import IMU, INFO, PLACEMENT, SCENE_INFO, SUBJECT, WEARER
from vip_factors.io.mcap_records import McapChannel, RecordError, RecordFile
from vip_factors.io.schemas.camera_info_pb2 import CameraInfo
from vip_factors.io.schemas.detections_2d_pb2 import Detections2D
from vip_factors.io.schemas.imu_sample_pb2 import ImuSample
from vip_factors.io.schemas.recording_info_pb2 import RecordingInfo
from vip_factors.io.schemas.scene_info_pb2 import SceneInfo
from vip_factors.io.schemas.sensor_placement_pb2 import SensorPlacement
from vip_factors.io.schemas.subject_pb2 import Subject
from vip_factors.io.settings import LiveSourceSettings

if TYPE_CHECKING:
    from mcap.records import Channel, Schema

LOOK_EVERY = 0.03  # seconds between looks at the file's size: half a frame
CAMERA = "/camera"
OF_WEARER: dict[str, type[Any]] = {INFO: RecordingInfo, SUBJECT: Subject, PLACEMENT: SensorPlacement}

OnFinding = Callable[[str, str], None]
"""Gets a kind and a sentence about what cannot be read or used."""


def open_when_it_comes(path: Path, settings: LiveSourceSettings, stop: Event) -> BinaryIO:
    """The file, which may come a little later.

    Raises:
        InputError: if it does not come, or cannot be read.
    """
    begun = time.monotonic()
    while True:
        try:
            return open(path, "rb")
        except FileNotFoundError as error:
            if time.monotonic() - begun > settings.header_wait or stop.wait(LOOK_EVERY):
                raise InputError(
                    f"{path}: no such file, nor did it come within {settings.header_wait:g} s; "
                    "expected an MCAP file that another program writes"
                ) from error
        except OSError as error:
            raise InputError(f"{path}: cannot be read: {error.strerror}") from error


class GrowingFile(RecordFile):
    """Waits at the end of a file for more of it.

    Args:
        path: of the file.
        file: open.
        settings: limits.
        stop: set when nothing more is wanted.
        on_finding: is told what cannot be read.
    """

    last = (0, mcap_records.DATA_END, mcap_records.FOOTER)

    def __init__(
        self, path: Path, file: BinaryIO, settings: LiveSourceSettings, stop: Event, on_finding: OnFinding
    ) -> None:
        super().__init__(path, file)
        self._settings, self._stop, self._on_finding = settings, stop, on_finding

    def contents(self) -> Iterator[tuple[int, bytes]]:
        """Opcode and content of schemas, channels and messages, of chunks too, until the data or its growth ends.

        Raises:
            FileFormatError: if it is no MCAP file, or becomes shorter.
        """
        for opcode, start, content in self.records():
            if opcode == mcap_records.CHUNK:
                yield from self._chunk(content, start - mcap_records.RECORD_HEAD.size)
            else:
                yield opcode, content
        if self.ended == 0:
            self._on_finding("end", f"it is damaged at byte {self.at:,}, where no record begins: what follows is lost")
        elif self.ended is None and not self._stop.is_set():
            self._on_finding("end", f"it has not grown for {self._settings.growth_wait:g} s: taken as its end")

    def reaches(self, end: int) -> bool:
        """Wait until the file has this many bytes; False if it does not grow any more."""
        known, since = -1, time.monotonic()
        while not self._stop.is_set():
            self.size = os.fstat(self.file.fileno()).st_size
            if self.size < self.at:
                raise FileFormatError(f"{self.path} has become shorter while it was followed: start anew with it")
            if self.size >= end:
                return True
            if self.size != known:
                known, since = self.size, time.monotonic()
            elif time.monotonic() - since > self._settings.growth_wait:
                return False
            self._stop.wait(LOOK_EVERY)
        return False

    def skips(self, opcode: int, length: int) -> bool:
        """Whether a record is nothing that is wanted, or larger than it may be, which is told."""
        if opcode not in (mcap_records.SCHEMA, mcap_records.CHANNEL, mcap_records.MESSAGE, mcap_records.CHUNK):
            return True
        largest = self._settings.largest_chunk if opcode == mcap_records.CHUNK else self._settings.largest_message
        if length > largest:
            self._on_finding(
                "size", f"a record of {length:,} bytes at byte {self.at:,} is left out: expected at most {largest:,}"
            )
        return length > largest

    def _chunk(self, content: bytes, at: int) -> Iterator[tuple[int, bytes]]:
        largest = self._settings.largest_chunk
        size = mcap_records.CHUNK_HEAD.unpack_from(content)[2] if len(content) >= mcap_records.CHUNK_HEAD.size else 0
        try:
            if size > largest:
                raise RecordError(f"a chunk holds {size:,} bytes: expected at most {largest:,}")
            data = mcap_records.read_chunk(content)
        except RecordError as error:
            self._on_finding("chunk", f"{error} (at byte {at:,}): its messages are left out")
            return
        for opcode, start, end in mcap_records.records_of(data):
            if opcode == mcap_records.MESSAGE and end - start > self._settings.largest_message:
                self._on_finding(
                    "size",
                    f"a message of {end - start:,} bytes is left out: expected at most "
                    f"{self._settings.largest_message:,}",
                )
            elif opcode in (mcap_records.SCHEMA, mcap_records.CHANNEL, mcap_records.MESSAGE):
                yield opcode, data[start:end]


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


class Channels:
    """The channels of a file as they become known.

    Args:
        on_finding: is told what cannot be used.
    """

    def __init__(self, on_finding: OnFinding) -> None:
        self._on_finding = on_finding
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, tuple[int, McapChannel]] = {}  # with the id of the schema
        self._routes: dict[int, Route | None] = {}
        self._of_topic: dict[str, McapChannel] = {}  # the first one

    def messages(self, records: Iterator[tuple[int, bytes]]) -> Iterator[tuple[Route, Any]]:
        """The messages that belong to a scene, decoded."""
        from google.protobuf.message import DecodeError

        for opcode, content in records:
            try:
                if opcode != mcap_records.MESSAGE:
                    self._describe(mcap_records.description(opcode, content))
                    continue
                number = mcap_records.MESSAGE_HEAD.unpack_from(content)[0]
            except (RecordError, struct.error):
                self._on_finding("record", "a record is malformed: it is left out")
                continue
            if number not in self._routes:
                self._on_finding("nameless", f"a message belongs to no channel of the file ({number}): it is left out")
            route = self._routes.get(number)
            if route is None:
                continue
            try:
                message = route.kind.FromString(content[mcap_records.MESSAGE_HEAD.size :])
            except DecodeError as error:
                self._on_finding(
                    "message",
                    f"a message on {route.channel.topic} is no {route.kind.DESCRIPTOR.full_name} ({error}): it is "
                    "left out",
                )
                continue
            yield route, message

    def _describe(self, read: "Schema | Channel") -> None:
        from mcap.records import Schema

        if isinstance(read, Schema):
            if self._schemas.setdefault(read.id, read) != read:
                self._schemas[read.id] = read
                same = [number for number, (schema_id, _) in self._channels.items() if schema_id == read.id]
                self._leave_out(same, read.name)
            return
        channel = mcap_records.channel_of(read, self._schemas.get(read.schema_id))
        known = self._channels.get(read.id)
        if known is not None:
            if known[1] != channel:
                self._leave_out([read.id], f"{channel.schema_name}, topic {channel.topic}")
            return
        self._channels[read.id] = (read.schema_id, channel)
        first = self._of_topic.setdefault(read.topic, channel)
        if (first.schema_name, first.schema_data) == (channel.schema_name, channel.schema_data):
            self._routes[read.id] = self._route(channel)
        else:
            self._leave_out([read.id], channel.schema_name)

    def _leave_out(self, numbers: list[int], schema: str) -> None:
        """Channels that are not what they were."""
        topics = sorted({self._channels[one][1].topic for one in numbers})
        topics = [topic for topic in topics if _owner(topic) is not None]
        if topics:
            self._on_finding(
                f"schema of {topics[0]}",
                f"{', '.join(topics)}: the schema changes mid-way (to {schema or 'none'}); the messages are left out "
                "from here on",
            )
        self._routes.update(dict.fromkeys(numbers))

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
        kind = ImuSample if rest.startswith(IMU) else OF_WEARER.get(rest)
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
