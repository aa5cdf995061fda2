"""The messages of an MCAP file: all of them, or those between two instants; and the walk that a growing file shares.

The library's readers need the index at the end of the file, or fail at the first short record; this one walks the
records (https://mcap.dev/spec) from the start. Of a truncated or damaged file it gives everything that is still whole,
and decompresses what there is of a chunk that was cut.
"""

import os
import struct
import warnings
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from vip_factors.errors import FileFormatError, InputError

if TYPE_CHECKING:
    from mcap.records import Channel, Schema

MAGIC = b"\x89MCAP0\r\n"
RECORD_HEAD = struct.Struct("<BQ")  # opcode, length
MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
CHUNK_HEAD = struct.Struct("<QQQI")  # start and end log time, uncompressed size, CRC of the content
FOOTER_BYTES = 20
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, ATTACHMENT, METADATA = 0x01, 0x02, 0x03, 0x04, 0x05, 0x06, 0x09, 0x0C
DATA_END = 0x0F


class McapWarning(UserWarning):
    """Something in a file was left out or could not be read, and what it was."""


class RecordError(Exception):
    """A record that cannot be read; the message says why."""


@dataclass(frozen=True)
class McapChannel:
    """One stream of messages of one type."""

    id: int
    topic: str
    encoding: str
    schema_name: str = ""
    schema_encoding: str = ""
    schema_data: bytes = b""
    metadata: dict[str, str] = field(default_factory=dict)


@dataclass
class McapMessages:
    """The messages of one channel in file order: log and publish times in nanoseconds, numbers, serialised data."""

    channel: McapChannel
    log_times: list[int] = field(default_factory=list)
    publish_times: list[int] = field(default_factory=list)
    sequences: list[int] = field(default_factory=list)
    data: list[bytes] = field(default_factory=list)

    def add(self, log_time: int, publish_time: int, sequence: int, data: bytes) -> None:
        """One more."""
        self.log_times.append(log_time)
        self.publish_times.append(publish_time)
        self.sequences.append(sequence)
        self.data.append(data)

    def between(self, first: int, last: int) -> "McapMessages":
        """Those with log times from ``first`` to ``last``, nanoseconds."""
        rows = [row for row, time in enumerate(self.log_times) if first <= time <= last]
        log_times, publish_times, sequences = (
            [values[row] for row in rows] for values in (self.log_times, self.publish_times, self.sequences)
        )
        return McapMessages(self.channel, log_times, publish_times, sequences, [self.data[row] for row in rows])


class _Ends(McapMessages):
    """Of the messages of a channel the first and the last one alone, by log time."""

    def add(self, log_time: int, publish_time: int, sequence: int, data: bytes) -> None:
        times = self.log_times
        if len(times) < 2:
            super().add(log_time, publish_time, sequence, data)
            if times[-1] < times[0]:
                for values in (times, self.publish_times, self.sequences, self.data):
                    values.reverse()
            return
        place = 0 if log_time < times[0] else 1 if log_time > times[1] else None
        if place is not None:
            times[place], self.publish_times[place], self.sequences[place] = log_time, publish_time, sequence
            self.data[place] = data


@dataclass
class McapContents:
    """What an MCAP file holds.

    Attributes:
        path: of the file.
        messages: by channel id, of every channel named in the file; empty for channels not wanted.
        attachments, metadata: their raw records, without the opcode and length.
        damage: sentences about what could not be read; empty for a whole file.
        last_log_time: of the last whole message of any channel, nanoseconds; None without messages.
    """

    path: Path
    messages: dict[int, McapMessages] = field(default_factory=dict)
    attachments: list[bytes] = field(default_factory=list)
    metadata: list[bytes] = field(default_factory=list)
    damage: list[str] = field(default_factory=list)
    last_log_time: int | None = None

    @property
    def topics(self) -> list[str]:
        """All topics, sorted."""
        return sorted({messages.channel.topic for messages in self.messages.values()})


def read_contents(
    path: str | os.PathLike[str] | McapContents, wanted: Callable[[McapChannel], bool] | None = None
) -> McapContents:
    """All messages of an MCAP file, or those of the wanted channels; what was read already is given back.

    A file that ends early yields every message that is whole before the cut; a chunk whose content is damaged is
    left out. Both are told as a :class:`McapWarning` and in ``damage``.

    Raises:
        InputError: if there is no such file.
        FileFormatError: if it is empty or not an MCAP file.
    """

    if isinstance(path, McapContents):
        return path

    def keep(channel: McapChannel) -> McapMessages | None:
        return McapMessages(channel) if wanted is None or wanted(channel) else None

    walk = _Walk(Path(path), keep)
    walk.file()
    return walk.contents


class McapByTime:
    """An MCAP file larger than memory, of which as much is in memory as is asked for.

    The file is passed over once: what comes once is kept, of samples the first and the last, and of every chunk where
    it lies and which times it holds. Chunks are then read as they are asked for.

    Attributes:
        contents: what comes once, and of every sampled channel the first and the last message.
        chunked: False if messages stand outside of chunks: these are not found by time.

    Args:
        path: of the file.
        wanted: channels whose messages are few.
        sampled: those whose messages are many.

    Raises:
        InputError: if there is no such file.
        FileFormatError: if it is empty or not an MCAP file.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        wanted: Callable[[McapChannel], bool],
        sampled: Callable[[McapChannel], bool],
    ) -> None:
        def keep(channel: McapChannel) -> McapMessages | None:
            return _Ends(channel) if sampled(channel) else McapMessages(channel) if wanted(channel) else None

        self.path, self._sampled = Path(path), sampled
        walk = _Walk(self.path, keep)
        walk.file()
        self.contents, self._chunks, self.chunked = walk.contents, walk.chunks, walk.chunked

    def between(self, first: int, last: int) -> McapContents:
        """The messages of sampled channels with log times from ``first`` to ``last``, nanoseconds, in file order."""
        walk = _Walk(self.path, lambda channel: None)
        for number, one in self.contents.messages.items():
            walk.contents.messages[number] = McapMessages(one.channel)
            if self._sampled(one.channel):
                walk.gathered[number] = walk.contents.messages[number]
        with open(self.path, "rb") as file:
            for chunk in self._chunks:
                if chunk.first <= last and chunk.last >= first:
                    file.seek(chunk.offset)
                    walk.chunk(file.read(chunk.length), chunk.whole)
        for number, one in walk.gathered.items():
            walk.contents.messages[number] = one.between(first, last)
        return walk.contents


@dataclass(frozen=True)
class _ChunkPlace:
    """Where a chunk's content lies in the file, and the log times in it."""

    offset: int
    length: int
    whole: bool
    first: int
    last: int


class RecordFile:
    """The records of an open MCAP file, one after the other, up to its footer or to what is not whole.

    Attributes:
        at: byte at which the first record begins that was not given.
        ended: opcode of the record at which the walk ended; None if the file ended before.
        last: opcodes of the records that end the walk.
    """

    last: tuple[int, ...] = (0, FOOTER)  # 0 is no opcode: padding of a file system after a crash

    def __init__(self, path: Path, file: BinaryIO) -> None:
        self.path, self.file, self.at = path, file, 0
        self.ended: int | None = None
        self.size = os.fstat(file.fileno()).st_size

    def reaches(self, end: int) -> bool:
        """Whether the file has this many bytes."""
        return self.size >= end

    def skips(self, opcode: int, length: int) -> bool:
        """Whether a record is passed over unread."""
        return False

    def records(self) -> Iterator[tuple[int, int, bytes]]:
        """Opcode, byte at which the content begins, and content, of all records that do not stand in chunks.

        Raises:
            FileFormatError: if it is no MCAP file.
        """
        self.reaches(len(MAGIC))
        check_magic(self.path, self.file.read(len(MAGIC)))
        self.at = len(MAGIC)
        while self.reaches(self.at + RECORD_HEAD.size):
            opcode, length = RECORD_HEAD.unpack(self.file.read(RECORD_HEAD.size))
            start = self.at + RECORD_HEAD.size
            if opcode in self.last:
                self.ended = opcode
                return
            skipped = self.skips(opcode, length)
            if not self.reaches(start + length):
                return
            if skipped:
                self.file.seek(length, os.SEEK_CUR)
            else:
                yield opcode, start, self.file.read(length)
            self.at = start + length


class _Walk:
    """One pass over the records of a file.

    Args:
        path: of the file.
        keep: where the messages of a channel are kept; None for those that are not wanted.
    """

    def __init__(self, path: Path, keep: Callable[[McapChannel], McapMessages | None]) -> None:
        self.contents = McapContents(path)
        self.gathered: dict[int, McapMessages] = {}
        self.chunks: list[_ChunkPlace] = []
        self.chunked = True  # whether all messages stand in chunks
        self._keep = keep
        self._schemas: dict[int, Schema] = {}
        self._nameless = 0  # messages of channels that the file never describes

    def file(self) -> None:
        """The whole file; what could not be read is told as a warning."""
        path, damage = self.contents.path, self.contents.damage
        check_file(path)
        with open(path, "rb") as file:
            records = RecordFile(path, file)
            for opcode, start, content in records.records():
                if opcode == CHUNK:
                    self._indexed_chunk(start, content)
                elif opcode == ATTACHMENT:
                    self.contents.attachments.append(content)
                elif opcode == METADATA:
                    self.contents.metadata.append(content)
                else:
                    self.chunked = self.chunked and opcode != MESSAGE
                    self._record(opcode, content, 0, len(content))
            if records.ended != FOOTER or not file.read()[FOOTER_BYTES:].startswith(MAGIC):
                self._tail(records)
        if self._nameless:
            damage.append(f"{self._nameless} messages belong to no channel of the file: left out")
        for sentence in damage:
            warnings.warn(McapWarning(f"{path}: {sentence}"), stacklevel=4)

    def _tail(self, records: RecordFile) -> None:
        """A file without its footer: the chunk that was cut, and what to say of it."""
        at, size, file = records.at, records.size, records.file
        file.seek(at)
        rest = file.read()
        if len(rest) > RECORD_HEAD.size and rest[0] == CHUNK:
            self._indexed_chunk(at + RECORD_HEAD.size, rest[RECORD_HEAD.size :], whole=False)
        last = self.contents.last_log_time
        upto = "no message is left" if last is None else f"read up to log time {last / 1e9:.3f} s"
        damaged = rest.endswith(MAGIC) and len(rest) > len(MAGIC)
        where = f"damaged at byte {at}" if damaged else f"cut off at byte {size}"
        self.contents.damage.insert(0, f"the file is {where} ({upto}); what follows is lost")

    def _indexed_chunk(self, start: int, content: bytes, whole: bool = True) -> None:
        if len(content) >= CHUNK_HEAD.size:
            first, last, _, _ = CHUNK_HEAD.unpack_from(content)
            self.chunks.append(_ChunkPlace(start, len(content), whole, first, last))
        self.chunk(content, whole)

    def chunk(self, content: bytes, whole: bool = True) -> None:
        """A chunk, or as much as there is of it."""
        try:
            data = read_chunk(content, whole)
        except RecordError as error:
            self.contents.damage.append(f"{error}: its messages are left out")
            return
        for opcode, start, end in records_of(data):
            self._record(opcode, data, start, end)

    def _record(self, opcode: int, data: bytes, start: int, end: int) -> None:
        """A record that may stand in a chunk."""
        if opcode == MESSAGE and end - start >= MESSAGE_HEAD.size:
            number, sequence, log_time, publish_time = MESSAGE_HEAD.unpack_from(data, start)
            self.contents.last_log_time = log_time
            messages = self.gathered.get(number)
            if messages is not None:
                messages.add(log_time, publish_time, sequence, data[start + MESSAGE_HEAD.size : end])
            elif number not in self.contents.messages:
                self._nameless += 1
        elif opcode in (SCHEMA, CHANNEL):
            try:
                self._describe(description(opcode, data[start:end]))
            except RecordError:
                self.contents.damage.append("the description of a channel is malformed: its messages are left out")

    def _describe(self, read: "Schema | Channel") -> None:
        from mcap.records import Schema

        if isinstance(read, Schema):
            self._schemas.setdefault(read.id, read)
        elif read.id not in self.contents.messages:  # channels are repeated in the summary at the end
            channel = channel_of(read, self._schemas.get(read.schema_id))
            messages = self._keep(channel)
            self.contents.messages[read.id] = McapMessages(channel) if messages is None else messages
            if messages is not None:
                self.gathered[read.id] = messages


def check_file(path: Path) -> None:
    """Whether there is a file that can be read from any place in it.

    Raises:
        InputError: if there is not.
    """
    if path.is_dir():
        raise InputError(f"{path} is a folder: expected an MCAP file")
    if not path.exists():
        raise InputError(f"{path}: no such file; expected an MCAP file")
    if not path.is_file():
        raise InputError(f"{path} is a device or a pipe: expected an MCAP file; write what comes from it to one first")


def check_magic(path: Path, start: bytes) -> None:
    """Whether a file begins as MCAP files do.

    Raises:
        FileFormatError: if it does not.
    """
    if not start:
        raise FileFormatError(f"{path} is empty (0 bytes): expected an MCAP file; write or copy it again")
    if start != MAGIC[: len(start)]:
        raise FileFormatError(
            f"{path} is not an MCAP file: it begins with {start!r}, expected {MAGIC!r}; check that it is the right file"
        )
    if len(start) < len(MAGIC):
        raise FileFormatError(f"{path} was cut after {len(start)} bytes: no message of the MCAP file is left")


def description(opcode: int, content: bytes) -> "Schema | Channel":
    """The schema or the channel that a record describes.

    Raises:
        RecordError: if it is malformed.
    """
    from mcap.data_stream import ReadDataStream
    from mcap.exceptions import McapError
    from mcap.records import Channel, Schema

    try:
        return (Schema if opcode == SCHEMA else Channel).read(ReadDataStream(BytesIO(content)))
    except (struct.error, EOFError, ValueError, McapError) as error:  # of text too: UnicodeDecodeError
        raise RecordError("the description of a channel is malformed") from error


def channel_of(read: "Channel", schema: "Schema | None") -> McapChannel:
    """A channel with the schema of its messages, if it has one."""
    described = ("", "", b"") if schema is None else (schema.name, schema.encoding, schema.data)
    return McapChannel(read.id, read.topic, read.message_encoding, *described, metadata=dict(read.metadata))


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


def read_chunk(content: bytes, whole: bool = True) -> bytes:
    """The records of a chunk, decompressed.

    Args:
        content: of the chunk record, without opcode and length.
        whole: False if the content is cut off: then everything that decompresses is returned, which is every block
            that was written completely (zstd and lz4 compress in blocks of at most 128 KiB and 4 MiB).

    Raises:
        RecordError: for an unknown compression, or data that does not match its size or checksum.
    """
    try:
        _, _, size, crc = CHUNK_HEAD.unpack_from(content)
        (length,) = struct.unpack_from("<I", content, CHUNK_HEAD.size)
        start = CHUNK_HEAD.size + 4 + length
        compression = str(content[start - length : start], "utf-8")
        (length,) = struct.unpack_from("<Q", content, start)
    except (struct.error, UnicodeDecodeError) as error:
        if not whole:
            return b""
        raise RecordError("a chunk's head is malformed") from error
    data = _decompress(compression, content[start + 8 : start + 8 + length], size, whole)
    if whole and len(data) != size:
        raise RecordError(f"a chunk holds {len(data)} bytes where its head says {size}")
    if whole and crc and zlib.crc32(data) != crc:
        raise RecordError("a chunk does not match its checksum")
    return data


def _decompress(compression: str, packed: bytes, size: int, whole: bool) -> bytes:
    if compression == "":
        return packed
    if compression == "zstd":
        import zstandard

        decompress = zstandard.ZstdDecompressor().decompressobj().decompress
        failure: type[Exception] = zstandard.ZstdError
    elif compression == "lz4":
        import lz4.frame

        decompress, failure = lz4.frame.LZ4FrameDecompressor().decompress, RuntimeError
    else:
        raise RecordError(f"a chunk is compressed with '{compression}' (known: zstd, lz4)")
    try:
        return decompress(packed)
    except failure as error:
        if not whole:
            return b""
        raise RecordError(f"a chunk of {size} bytes does not decompress ({error})") from error
