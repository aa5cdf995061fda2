"""Which channels of an MCAP file belong to a scene, and what their messages are."""

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import BytesIO
from typing import Any

from vip_factors.io.live.growing_file import Record
from vip_factors.io.mcap_reader import CHANNEL, MESSAGE_HEAD, SCHEMA, McapChannel
from vip_factors.io.mcap_recording import IMU, INFO, PLACEMENT, SCENE_INFO, SUBJECT, WEARER
from vip_factors.io.schemas.camera_info_pb2 import CameraInfo
from vip_factors.io.schemas.detections_2d_pb2 import Detections2D
from vip_factors.io.schemas.imu_sample_pb2 import ImuSample
from vip_factors.io.schemas.recording_info_pb2 import RecordingInfo
from vip_factors.io.schemas.scene_info_pb2 import SceneInfo
from vip_factors.io.schemas.sensor_placement_pb2 import SensorPlacement
from vip_factors.io.schemas.subject_pb2 import Subject

CAMERA = "/camera"
PROTOBUF = "protobuf"
OF_WEARER: dict[str, type[Any]] = {INFO: RecordingInfo, SUBJECT: Subject, PLACEMENT: SensorPlacement}


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
        tell: gets a kind and a sentence about what cannot be used.
    """

    def __init__(self, tell: Callable[[str, str], None]) -> None:
        self._tell = tell
        self._schemas: dict[int, tuple[str, str, bytes]] = {}
        self._channels: dict[int, tuple[int, McapChannel]] = {}  # with the id of the schema
        self._routes: dict[int, Route | None] = {}
        self._topics: dict[str, tuple[str, str, bytes]] = {}

    def messages(self, records: Iterator[Record]) -> Iterator[tuple[Route, Any]]:
        """The messages that belong to a scene, decoded."""
        from google.protobuf.message import DecodeError
        from mcap.exceptions import McapError

        for opcode, content in records:
            try:
                if opcode == SCHEMA:
                    self._schema(content)
                    continue
                if opcode == CHANNEL:
                    self._channel(content)
                    continue
                channel_id = MESSAGE_HEAD.unpack_from(content)[0]
            except (struct.error, UnicodeDecodeError, EOFError, ValueError, McapError):
                self._tell("record", "a record is malformed: it is left out")
                continue
            if channel_id not in self._routes:
                self._tell("nameless", f"a message belongs to no channel of the file ({channel_id}): it is left out")
            route = self._routes.get(channel_id)
            if route is None:
                continue
            try:
                message = route.kind.FromString(content[MESSAGE_HEAD.size :])
            except DecodeError as error:
                self._tell(
                    "message",
                    f"a message on {route.channel.topic} is no {route.kind.DESCRIPTOR.full_name} ({error}): it is "
                    "left out",
                )
                continue
            yield route, message

    def _schema(self, content: bytes) -> None:
        from mcap.data_stream import ReadDataStream
        from mcap.records import Schema

        read = Schema.read(ReadDataStream(BytesIO(content)))
        schema = (read.name, read.encoding, read.data)
        if self._schemas.setdefault(read.id, schema) != schema:
            self._schemas[read.id] = schema
            self._leave_out([one for one, (schema_id, _) in self._channels.items() if schema_id == read.id], read.name)

    def _channel(self, content: bytes) -> None:
        from mcap.data_stream import ReadDataStream
        from mcap.records import Channel

        read = Channel.read(ReadDataStream(BytesIO(content)))
        schema = self._schemas.get(read.schema_id, ("", "", b""))
        channel = McapChannel(read.id, read.topic, read.message_encoding, *schema)
        if read.id in self._channels:
            if self._channels[read.id][1] != channel:
                self._leave_out([read.id], f"{channel.schema_name}, topic {channel.topic}")
            return
        self._channels[read.id] = (read.schema_id, channel)
        if self._topics.setdefault(read.topic, schema) == schema:
            self._routes[read.id] = self._route(channel)
        else:
            self._leave_out([read.id], channel.schema_name)

    def _leave_out(self, channel_ids: list[int], schema: str) -> None:
        """Channels that are not what they were."""
        topics = sorted({self._channels[one][1].topic for one in channel_ids})
        topics = [topic for topic in topics if _owner(topic) is not None]
        if topics:
            self._tell(
                f"schema of {topics[0]}",
                f"{', '.join(topics)}: the schema changes mid-way (to {schema or 'none'}); the messages are left out "
                "from here on",
            )
        self._routes.update(dict.fromkeys(channel_ids))

    def _route(self, channel: McapChannel) -> Route | None:
        found = _owner(channel.topic)
        if found is None:
            return None
        owner, kind = found
        name = kind.DESCRIPTOR.full_name
        if (channel.schema_name, channel.encoding, channel.schema_encoding) != (name, PROTOBUF, PROTOBUF):
            self._tell(
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
        return (owner, kind) if kind is not None else None
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
