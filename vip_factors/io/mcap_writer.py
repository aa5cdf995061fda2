"""Protobuf messages into an MCAP file."""

from collections.abc import Iterable, Iterator
from heapq import merge
from itertools import count
from typing import IO, TYPE_CHECKING, Any

from vip_factors import __version__
from vip_factors.io.codec import NS_PER_S, M, set_timestamp

if TYPE_CHECKING:
    from google.protobuf.message import Message

# A cut loses at most the zstd block it falls into: small chunks lose little, at some cost in compression.
CHUNK_BYTES = 32 * 1024

TimedMessage = tuple[int, int, bytes]
"""Log time in nanoseconds, channel id, serialised message."""


class MessageWriter:
    """Writes messages to an open file; one channel per topic. A context manager, which finishes the file.

    Args:
        file: open for writing bytes.
        chunk_bytes: after which a chunk ends by itself.
    """

    def __init__(self, file: IO[bytes], chunk_bytes: int = CHUNK_BYTES) -> None:
        from mcap.writer import CompressionType, Writer

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

    def write(self, topic: str, message: "Message", time_ns: int) -> None:
        """One message of any kind."""
        self.add(self.channel(topic, type(message)), time_ns, message.SerializeToString())

    def add(self, channel: int, time_ns: int, data: bytes) -> None:
        """One serialised message. Log times are unsigned: what lies before the epoch is logged at 0."""
        time_ns = max(time_ns, 0)
        self._writer.add_message(channel, time_ns, data, time_ns, next(self._sequence) & 0xFFFFFFFF)

    def stamped(
        self, topic: str, message_class: "type[M]", times_ns: Iterable[int], messages: "Iterable[M]"
    ) -> Iterator[TimedMessage]:
        """Messages on one topic in the order of time, with their timestamps, serialised; one may be filled anew."""
        channel = self.channel(topic, message_class)
        for time_ns, message in zip(times_ns, messages, strict=True):
            set_timestamp(message.timestamp, time_ns)
            yield time_ns, channel, message.SerializeToString()

    def add_in_order(self, *streams: Iterable[TimedMessage]) -> None:
        """Messages of several streams, each in the order of time, interleaved: a cut then ends all at one time."""
        for time_ns, channel, data in merge(*streams, key=lambda message: message[0]):
            self.add(channel, time_ns, data)

    def flush(self) -> None:
        """End the chunk, so that what was written so far survives a cut in what follows."""
        self._writer.flush()


def nanoseconds(seconds: Any, start_ns: int) -> list[int]:
    """Absolute nanoseconds, as Python integers, of times ``(N,)`` in seconds from the recording's start."""
    # Whole and fractional seconds apart: a float product of a long recording would lose nanoseconds.
    return [start_ns + int(t // 1) * NS_PER_S + round(t % 1 * NS_PER_S) for t in seconds.tolist()]
