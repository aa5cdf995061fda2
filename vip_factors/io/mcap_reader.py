"""The messages of an MCAP file (https://mcap.dev/spec): all of them, those of some channels, or by its index of a time.

The ``mcap`` library reads the records. Of a truncated or damaged file everything is read that its whole chunks hold.
Chunks are decompressed here, within a limit: one of 65 kB may claim gigabytes, which the library would believe.
"""

import os
import struct
import warnings
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import IO, BinaryIO

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, ChunkIndex, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader
from mcap.summary import Summary

from vip_factors.errors import FileFormatError, InputError

MAGIC = b"\x89MCAP0\r\n"
MESSAGE = int(Opcode.MESSAGE)  # compared a million times
RECORD_HEAD = struct.Struct("<BQ")  # opcode, length
MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
INDEX_HEAD = struct.Struct("<HI")  # of the messages of a channel in a chunk: channel, bytes that follow
LARGEST_CHUNK = "VIP_FACTORS_LARGEST_CHUNK"
# What the library raises for records that are cut or damaged; a length in them may be any number.
READ_ERRORS = (McapError, struct.error, ValueError, OverflowError, MemoryError)


class McapWarning(UserWarning):
    """Part of a file that was left out or could not be read."""


class ChunkError(Exception):
    """Chunk that cannot be read."""


class LargeChunkError(ChunkError):
    """Chunk that holds more bytes than allowed, or claims to."""


def largest_chunk() -> int:
    """Bytes that a chunk may hold, packed or not: 128 MiB, or :data:`LARGEST_CHUNK` in the environment.

    Recorders close chunks at 1 to 4 MB, those with images in them at a few more.
    """
    limit = os.environ.get(LARGEST_CHUNK) or str(128 << 20)
    if not limit.isdecimal():
        raise InputError(f"{LARGEST_CHUNK}={limit} in the environment: expected a number of bytes")
    return int(limit)


def chunk_data(chunk: Chunk, largest: int) -> bytes:
    """Decompress the records of a chunk.

    Raises:
        ChunkError: for an unknown compression, or data that does not match its size or checksum.
        LargeChunkError: if it holds more than ``largest`` bytes, or claims to.
    """
    packed, size = chunk.data, chunk.uncompressed_size
    try:
        # The size in a zstd frame's own head is allocated, whatever the chunk's head says.
        framed = zstandard.frame_content_size(packed) if chunk.compression == "zstd" else 0
        claimed = max(size, len(packed), framed)
        if claimed > largest:
            raise LargeChunkError(
                f"a chunk of {len(packed):,} bytes claims to hold {claimed:,}: expected at most {largest:,}; if that "
                f"is right, set {LARGEST_CHUNK} to more bytes in the environment"
            )
        data = _decompressed(chunk.compression, packed, size)
    except (zstandard.ZstdError, RuntimeError) as error:  # RuntimeError is lz4's
        raise ChunkError(f"a chunk of {size} bytes does not decompress ({error})") from error
    if len(data) != size:
        raise ChunkError(f"a chunk holds {len(data)} bytes where its head says {size}")
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise ChunkError("a chunk does not match its checksum")
    return data


def _decompressed(compression: str, packed: bytes, size: int) -> bytes:
    if compression == "":
        return packed
    if compression == "zstd":
        return zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)
    if compression == "lz4":
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size + 1))
    raise ChunkError(f"a chunk is compressed with '{compression}' (known: zstd, lz4)")


def records_of(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Opcode, start and end of the content of every whole record of a chunk."""
    size, start = len(data), 0
    unpack = RECORD_HEAD.unpack_from
    while start + RECORD_HEAD.size <= size:
        opcode, length = unpack(data, start)
        start += RECORD_HEAD.size
        if opcode == 0 or start + length > size:
            return
        yield opcode, start, start + length
        start += length


@dataclass(frozen=True)
class McapChannel:
    """Stream of messages of one type."""

    id: int
    topic: str
    encoding: str
    schema_name: str = ""
    schema_encoding: str = ""


@dataclass
class McapMessages:
    """Messages of one channel in file order: log times in nanoseconds, serialised data."""

    channel: McapChannel
    log_times: list[int] = field(default_factory=list)
    data: list[bytes] = field(default_factory=list)

    def rows(self, rows: Sequence[int]) -> "McapMessages":
        """Select messages by their indices."""
        return McapMessages(self.channel, [self.log_times[row] for row in rows], [self.data[row] for row in rows])


@dataclass
class McapContents:
    """Content of an MCAP file.

    Attributes:
        path: of the file.
        messages: by channel id, of every channel named in the file; empty for channels not wanted.
        damage: sentences about unreadable parts; empty for a sound file.
        last_log_time: of the last whole message of any channel, nanoseconds; None without messages.
    """

    path: Path
    messages: dict[int, McapMessages] = field(default_factory=dict)
    damage: list[str] = field(default_factory=list)
    last_log_time: int | None = None

    @property
    def topics(self) -> list[str]:
        """All topics of the file, wanted or not, as they first came."""
        return list(dict.fromkeys(messages.channel.topic for messages in self.messages.values()))


class McapPass:
    """Pass over the records of a file, which gathers messages.

    Attributes:
        contents: of the file so far.
        gathered: the messages of wanted channels, by channel id.

    Args:
        path: of the file.
        wanted: whether the messages of a channel are kept.
        refuses_large: whether a chunk that is too large is a FileFormatError; otherwise it counts as damage.
    """

    def __init__(self, path: Path, wanted: Callable[[McapChannel], bool], refuses_large: bool = True) -> None:
        self.contents = McapContents(path)
        self.gathered: dict[int, McapMessages] = {}
        self._wanted, self._refuses_large, self._largest = wanted, refuses_large, largest_chunk()
        self._schemas: dict[int, Schema] = {}
        self._nameless = 0  # messages of channels that the file never describes

    def records(self, file: IO[bytes], largest_record: int) -> Iterator[McapRecord]:
        """Take in and yield the records of a file that is open at its beginning, up to the footer or damage.

        Raises:
            FileFormatError: if it is no MCAP file.
        """
        _check_magic(self.contents.path, file.read(len(MAGIC)))
        reader = StreamReader(file, skip_magic=True, emit_chunks=True, record_size_limit=largest_record)
        position = len(MAGIC)
        try:
            for record in reader.records:
                self.take(record)
                yield record
                position = file.tell()
        except FileFormatError:
            raise
        except READ_ERRORS:
            self._end_early(file, position)

    def take(self, record: McapRecord) -> None:
        """Take in a record outside of chunks."""
        if isinstance(record, Chunk):
            self.take_chunk(record)
        elif isinstance(record, Message):
            self._add(record.channel_id, record.log_time, record.data)
        elif isinstance(record, Schema):
            self._schemas.setdefault(record.id, record)
        elif isinstance(record, Channel):
            schema = self._schemas.get(record.schema_id)
            described = ("", "") if schema is None else (schema.name, schema.encoding)
            self.know(McapChannel(record.id, record.topic, record.message_encoding, *described))

    def take_chunk(self, chunk: Chunk) -> None:
        """Take in the records of a chunk; a damaged or too large one is left out."""
        try:
            data = chunk_data(chunk, self._largest)
        except ChunkError as error:
            sentence = f"{error}: its messages are left out"
            if self._refuses_large and isinstance(error, LargeChunkError):
                raise FileFormatError(f"{self.contents.path}: {sentence}") from error
            self.contents.damage.append(sentence)
            return
        for opcode, start, end in records_of(data):
            if opcode == MESSAGE and end - start >= MESSAGE_HEAD.size:
                number, _, log_time, _ = MESSAGE_HEAD.unpack_from(data, start)
                self._add(number, log_time, data[start + MESSAGE_HEAD.size : end])
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                kind: type[Schema | Channel] = Schema if opcode == Opcode.SCHEMA else Channel
                try:
                    self.take(kind.read(ReadDataStream(BytesIO(data[start:end]))))
                except READ_ERRORS:
                    self.contents.damage.append("the description of a channel is malformed: its messages are left out")

    def know(self, channel: McapChannel) -> None:
        """Take in a channel once: chunks and the end of the file repeat them."""
        if channel.id not in self.contents.messages:
            messages = self.contents.messages[channel.id] = McapMessages(channel)
            if self._wanted(channel):
                self.gathered[channel.id] = messages

    def _add(self, number: int, log_time: int, data: bytes) -> None:
        """Take in a message of the channel with this id."""
        self.contents.last_log_time = log_time
        messages = self.gathered.get(number)
        if messages is not None:
            messages.log_times.append(log_time)
            messages.data.append(data)
        elif number not in self.contents.messages:
            self._nameless += 1

    def take_messages(self) -> list[tuple[int, bytes]]:
        """Channel and data of the messages gathered since the last call, in the order of their log times."""
        messages_by_time = [
            (log_time, number, data)
            for number, messages in self.gathered.items()
            for log_time, data in zip(messages.log_times, messages.data, strict=True)
        ]
        for messages in self.gathered.values():
            messages.log_times.clear()
            messages.data.clear()
        return [(number, data) for _, number, data in sorted(messages_by_time, key=lambda message: message[0])]

    def take_complaints(self) -> list[str]:
        """Sentences about damage since the last call."""
        complaints, self.contents.damage = self.contents.damage, []
        return complaints

    def _end_early(self, file: IO[bytes], position: int) -> None:
        """Note a file whose records end early, at byte ``position``."""
        size = file.seek(0, os.SEEK_END)
        file.seek(max(size - len(MAGIC), 0))
        is_cut = size <= position + len(MAGIC) or file.read() != MAGIC
        last_log_time = self.contents.last_log_time
        upto = "no message is left" if last_log_time is None else f"read up to log time {last_log_time / 1e9:.3f} s"
        where = f"cut off at byte {size}" if is_cut else f"damaged at byte {position}"
        self.contents.damage.insert(0, f"the file is {where} ({upto}); what follows is lost")

    def close(self) -> None:
        """Warn about the damage in a file that was read to its end."""
        if self._nameless:
            self.contents.damage.append(f"{self._nameless} messages belong to no channel of the file: left out")
        for sentence in self.contents.damage:
            warnings.warn(McapWarning(f"{self.contents.path}: {sentence}"), stacklevel=3)


def read_contents(
    path: str | os.PathLike[str] | McapContents, wanted: Callable[[McapChannel], bool] | None = None
) -> McapContents:
    """Read the messages of an MCAP file, or those of the wanted channels; contents in memory are returned as they are.

    A file that ends early yields every complete chunk before the cut; a damaged chunk is left out. A
    :class:`McapWarning` and ``damage`` report both.

    Raises:
        InputError: if there is no such file.
        FileFormatError: if it is empty or not an MCAP file, or a chunk is larger than it may be.
    """
    if isinstance(path, McapContents):
        return path
    reading = McapPass(Path(path), wanted or (lambda channel: True))
    with _open_file(Path(path)) as file:
        for _ in reading.records(file, os.fstat(file.fileno()).st_size):
            pass
    reading.close()
    return reading.contents


def read_summary(path: str | os.PathLike[str]) -> Summary | None:
    """Read the summary at the end of a file: statistics, channels and chunks; None without a readable one."""
    with _open_file(Path(path)) as file:
        try:
            return SeekingReader(file, record_size_limit=os.fstat(file.fileno()).st_size).get_summary()
        except (*READ_ERRORS, OSError):
            return None


@dataclass(frozen=True)
class McapByTime:
    """MCAP file larger than memory, read by time.

    Attributes:
        contents: all messages of channels that have few; the first and the last message of sampled channels.
        sampled: whether a channel has many messages.
        chunks: index of the file's chunks: position, channels and log times.
        message_count: of all channels.
    """

    contents: McapContents
    sampled: Callable[[McapChannel], bool] = field(repr=False)
    chunks: Sequence[ChunkIndex] = field(repr=False)
    message_count: int

    @classmethod
    def open(
        cls,
        path: str | os.PathLike[str],
        summary: Summary | None,
        wanted: Callable[[McapChannel], bool],
        sampled: Callable[[McapChannel], bool],
    ) -> "McapByTime | None":
        """Read the channels with few messages, and the ends of sampled ones; None without an index that fits the file.

        Args:
            path: of the file.
            summary: of the file.
            wanted: channels whose messages are few.
            sampled: those whose messages are many.
        """
        if summary is None or summary.statistics is None:
            return None
        reading = McapPass(Path(path), lambda channel: wanted(channel) or sampled(channel))
        for record in (*summary.schemas.values(), *summary.channels.values()):
            reading.take(record)
        needed = dict[int, ChunkIndex]()
        for number, messages in reading.gathered.items():
            chunks = [chunk for chunk in summary.chunk_indexes if number in chunk.message_index_offsets]
            ends = [*chunks[:1], *chunks[-1:]]
            needed |= {chunk.chunk_start_offset: chunk for chunk in (ends if sampled(messages.channel) else chunks)}
        try:
            _take_chunks(reading, [needed[start] for start in sorted(needed)])
        except FileFormatError:
            raise
        except READ_ERRORS:
            return None
        counts = summary.statistics.channel_message_counts
        for number, messages in reading.gathered.items():
            if sampled(messages.channel) and messages.data:
                order = np.argsort(messages.log_times, kind="stable").tolist()
                reading.contents.messages[number] = messages.rows(order[:1] + order[1:][-1:])
            elif not sampled(messages.channel) and len(messages.data) != counts.get(number, 0):
                return None
        if reading.contents.damage:
            return None
        return cls(reading.contents, sampled, summary.chunk_indexes, summary.statistics.message_count)

    def between(self, start_ns: int, end_ns: int) -> McapContents:
        """Read messages of sampled channels logged from ``start_ns`` to ``end_ns``, in file order.

        A damaged chunk is left out with a :class:`McapWarning`.
        """
        reading = McapPass(self.contents.path, self.sampled)
        for messages in self.contents.messages.values():
            reading.know(messages.channel)
        within = [
            chunk for chunk in self.chunks if chunk.message_start_time <= end_ns and chunk.message_end_time >= start_ns
        ]
        _take_chunks(reading, within)
        reading.close()
        for number, messages in reading.gathered.items():
            rows = [row for row, time in enumerate(messages.log_times) if start_ns <= time <= end_ns]
            reading.contents.messages[number] = messages.rows(rows)
        return reading.contents

    def log_times(self) -> dict[int, np.ndarray] | None:
        """Log times ``(N,)`` in nanoseconds by channel id, in file order; None if the index lacks some messages."""
        times = dict[int, list[np.ndarray]]()
        with open(self.contents.path, "rb", buffering=0) as file:  # a buffer would be filled for each chunk
            for chunk in self.chunks:
                file.seek(chunk.chunk_start_offset + chunk.chunk_length)
                data = file.read(chunk.message_index_length)
                for opcode, start, end in records_of(data):
                    pairs_start = start + INDEX_HEAD.size
                    if opcode == Opcode.MESSAGE_INDEX and end > pairs_start:
                        pairs = np.frombuffer(data, "<i8", (end - pairs_start) // 8, pairs_start)
                        number, _ = INDEX_HEAD.unpack_from(data, start)
                        times.setdefault(number, []).append(pairs[::2])  # beside each, its place in the chunk
        of_channel = {number: np.concatenate(pieces) for number, pieces in times.items()}
        return of_channel if sum(map(len, of_channel.values())) == self.message_count else None


def read_few(path: str | os.PathLike[str], wanted: Callable[[McapChannel], bool]) -> McapContents:
    """Read the messages of channels that have few: by the index, or without one from the whole file."""
    file = McapByTime.open(path, read_summary(path), wanted, lambda channel: False)
    return read_contents(path, wanted) if file is None else file.contents


def _take_chunks(reading: McapPass, chunks: Sequence[ChunkIndex]) -> None:
    with open(reading.contents.path, "rb") as file:
        for chunk in chunks:
            file.seek(chunk.chunk_start_offset + RECORD_HEAD.size)
            reading.take_chunk(Chunk.read(ReadDataStream(file)))


def _open_file(path: Path) -> BinaryIO:
    """Open a file that can be read from any position."""
    if path.is_dir():
        raise InputError(f"{path} is a folder: expected an MCAP file")
    if not path.exists():
        raise InputError(f"{path}: no such file; expected an MCAP file")
    if not path.is_file():
        raise InputError(f"{path} is a device or a pipe: expected an MCAP file; write its data to one first")
    return open(path, "rb")


def _check_magic(path: Path, start: bytes) -> None:
    """Refuse a file that does not begin as an MCAP file."""
    if not start:
        raise FileFormatError(f"{path} is empty (0 bytes): expected an MCAP file; write or copy it again")
    if start != MAGIC[: len(start)]:
        raise FileFormatError(
            f"{path} is not an MCAP file: it begins with {start!r}, expected {MAGIC!r}; check that it is the right file"
        )
    if len(start) < len(MAGIC):
        raise FileFormatError(f"{path} was cut after {len(start)} bytes: no message of the MCAP file is left")
