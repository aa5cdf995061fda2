"""The messages of an MCAP file by topic, read and written."""

import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from heapq import merge
from itertools import count
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, TypeVar

import numpy as np

from vip_factors import __version__
from vip_factors.errors import FileFormatError, InputError
from vip_factors.io.codec import NS_PER_S, Codec, set_timestamp
from vip_factors.io.mcap_reader import McapChannel, McapContents, McapMessages, McapWarning

if TYPE_CHECKING:
    from google.protobuf.message import Message

PACKAGE = "vip_factors."  # of our schemas
PROTOBUF = "protobuf"
# A cut loses at most the zstd block it falls into: small chunks lose little, at some cost in compression.
CHUNK_BYTES = 32 * 1024
M = TypeVar("M", bound="Message")
T = TypeVar("T")

TimedMessage = tuple[int, int, bytes]
"""Log time in nanoseconds, channel id, serialised message."""


def is_ours(channel: McapChannel, message_class: "type[Message] | None" = None) -> bool:
    """Whether a channel carries this message, or any of package ``vip_factors``."""
    name = message_class.DESCRIPTOR.full_name if message_class else None
    is_of_schema = channel.schema_name == name if name else channel.schema_name.startswith(PACKAGE)
    return is_of_schema and channel.encoding == channel.schema_encoding == PROTOBUF


def parsed(path: Path, messages: McapMessages, message_class: type[M]) -> list[M]:
    """All messages of a channel.

    Raises:
        FileFormatError: if one does not decode, naming it.
    """
    from google.protobuf.message import DecodeError

    read: list[M] = []
    try:
        for data in messages.data:
            read.append(message_class.FromString(data))
    except DecodeError as error:
        raise FileFormatError(
            f"{path}: message {len(read)} of topic {messages.channel.topic} is not a "
            f"{message_class.DESCRIPTOR.full_name} ({error})"
        ) from error
    return read


class Topics:
    """The messages of a file by topic.

    Args:
        contents: of the file.
        prefix: of every topic in calls.
    """

    def __init__(self, contents: McapContents, prefix: str = "") -> None:
        self.contents, self.path, self._prefix = contents, contents.path, prefix
        self._channels = dict[str, list[McapMessages]]()
        for messages in contents.messages.values():
            self._channels.setdefault(messages.channel.topic, []).append(messages)

    def channels(self, topic: str, message_class: "type[Message]") -> list[McapMessages]:
        """The channels of a topic with these messages: a single one, unless several programs wrote the file."""
        channels = self._channels.get(self._prefix + topic, ())
        return [messages for messages in channels if is_ours(messages.channel, message_class)]

    def all(self, topic: str, message_class: type[M]) -> list[M]:
        """All messages of one kind on one topic; none if there is no such channel."""
        channels = self.channels(topic, message_class)
        return [message for messages in channels for message in parsed(self.path, messages, message_class)]

    def last(self, topic: str, message_class: type[M]) -> M | None:
        """The last message of one kind on one topic, which replaces those before it."""
        messages = self.all(topic, message_class)
        return messages[-1] if messages else None

    def objects(self, topic: str, codec: Codec[Any, T]) -> tuple[T, ...]:
        """The objects of all messages of one kind on one topic."""
        return tuple(codec.decode(message) for message in self.all(topic, codec.message))

    def object(self, topic: str, codec: Codec[Any, T]) -> T | None:
        """The object of the last message on a topic."""
        message = self.last(topic, codec.message)
        return None if message is None else codec.decode(message)


def warn(path: Path, sentence: str) -> None:
    """Warn about a part of a file that is left out."""
    warnings.warn(McapWarning(f"{path}: {sentence}"), stacklevel=3)


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Put the file's name before the messages of errors about its contents."""
    try:
        yield
    except InputError as error:
        if str(path) in str(error):
            raise
        raise type(error)(f"{path}: {error}") from error


class MessageWriter:
    """Writes messages to an open file; one channel per topic. A context manager, which finishes the file.

    Args:
        file: open for writing bytes.
        start_ns: absolute time of t = 0.
        chunk_bytes: after which a chunk ends by itself.
    """

    def __init__(self, file: IO[bytes], start_ns: int = 0, chunk_bytes: int = CHUNK_BYTES) -> None:
        from mcap.writer import CompressionType, Writer

        self.start_ns = start_ns
        self._writer = Writer(file, chunk_size=chunk_bytes, compression=CompressionType.ZSTD)
        self._writer.start(profile="", library=f"vip_factors {__version__}")
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._sequence = count()

    def __enter__(self) -> "MessageWriter":
        return self

    def __exit__(self, error: type[BaseException] | None, *_: object) -> None:
        if error is None:
            self.finish()

    def finish(self) -> None:
        """Write the index at the end of the file; nothing may follow."""
        self._writer.finish()

    def channel(self, topic: str, message_class: "type[Message]") -> int:
        """Id of the channel of a topic, registered with its schema at the first call."""
        if topic not in self._channels:
            from mcap_protobuf.schema import build_file_descriptor_set

            name = message_class.DESCRIPTOR.full_name
            if name not in self._schemas:
                schema = build_file_descriptor_set(message_class).SerializeToString(deterministic=True)
                self._schemas[name] = self._writer.register_schema(name, "protobuf", schema)
            self._channels[topic] = self._writer.register_channel(topic, "protobuf", self._schemas[name])
        return self._channels[topic]

    def time_ns(self, seconds: float) -> int:
        """The absolute time of ``seconds`` from t = 0."""
        return nanoseconds([seconds], self.start_ns)[0]

    def write(self, topic: str, message: "Message", seconds: float = 0.0) -> None:
        """Write one message of any kind, logged at ``seconds`` from t = 0."""
        self.add(self.channel(topic, type(message)), self.time_ns(seconds), message.SerializeToString())

    def add(self, channel: int, time_ns: int, data: bytes) -> None:
        """Write one serialised message. Log times are unsigned: times before the epoch become 0."""
        time_ns = max(time_ns, 0)
        self._writer.add_message(channel, time_ns, data, time_ns, next(self._sequence) & 0xFFFFFFFF)

    def stamped(
        self, topic: str, message_class: "type[M]", seconds: Iterable[float], messages: "Iterable[M]"
    ) -> Iterator[TimedMessage]:
        """Serialise messages of one topic in the order of time, with timestamps; they may be one reused object."""
        channel = self.channel(topic, message_class)
        for time_ns, message in zip(nanoseconds(seconds, self.start_ns), messages, strict=True):
            set_timestamp(message.timestamp, time_ns)
            yield time_ns, channel, message.SerializeToString()

    def add_in_order(self, *streams: Iterable[TimedMessage]) -> None:
        """Write several streams, each in the order of time, interleaved: a cut then ends all at one time."""
        for time_ns, channel, data in merge(*streams, key=lambda message: message[0]):
            self.add(channel, time_ns, data)

    def flush(self) -> None:
        """End the chunk, which then survives a cut in later ones."""
        self._writer.flush()


def nanoseconds(seconds: Iterable[float], start_ns: int) -> list[int]:
    """Absolute nanoseconds, as Python integers, of times in seconds from the recording's start."""
    # Whole and fractional seconds apart: a float product of a long recording would lose nanoseconds.
    times = seconds.tolist() if isinstance(seconds, np.ndarray) else seconds
    return [start_ns + int(t // 1) * NS_PER_S + round(t % 1 * NS_PER_S) for t in times]
