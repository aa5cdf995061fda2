"""The messages of an MCAP file, by channel; of a truncated or damaged file, everything that is still whole.

The library's readers need the index at the end of the file, or fail at the first short record; this one walks the
records (https://mcap.dev/spec) from the start, and decompresses what there is of a chunk that was cut.
"""

import mmap
import os
import struct
import warnings
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import IO

import numpy as np

from vip_factors.errors import FileFormatError, InputError

MAGIC = b"\x89MCAP0\r\n"
RECORD_HEAD = struct.Struct("<BQ")  # opcode, length
MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, ATTACHMENT, METADATA = 0x01, 0x02, 0x03, 0x04, 0x05, 0x06, 0x09, 0x0C
DATA_END = 0x0F

View = bytes | memoryview


class McapWarning(UserWarning):
    """Something in a file was left out or could not be read, and what it was."""


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

    def add(self, log_time: int, publish_time: int, sequence: int, data: View) -> None:
        """One more."""
        self.log_times.append(log_time)
        self.publish_times.append(publish_time)
        self.sequences.append(sequence)
        self.data.append(bytes(data))


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


def read_contents(path: str | os.PathLike[str], wanted: Callable[[McapChannel], bool] | None = None) -> McapContents:
    """All messages of an MCAP file, or those of the wanted channels.

    A file that ends early yields every message that is whole before the cut; a chunk whose content is damaged is
    left out. Both are told as a :class:`McapWarning` and in ``damage``.

    Raises:
        InputError: if there is no such file.
        FileFormatError: if it is empty or not an MCAP file.
    """
    path = Path(path)
    check_file(path)
    with open(path, "rb") as file:
        check_magic(path, file.read(len(MAGIC)))
        walk = RecordWalk(McapContents(path), wanted or (lambda channel: True))
        walk.file(memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)))
    for sentence in walk.contents.damage:
        warnings.warn(McapWarning(f"{path}: {sentence}"), stacklevel=2)
    return walk.contents


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


class RecordWalk:
    """One pass over the records of a file."""

    def __init__(self, contents: McapContents, wanted: Callable[[McapChannel], bool]) -> None:
        self.contents = contents
        self.wanted = wanted
        self.schemas: dict[int, tuple[str, str, bytes]] = {}
        self.kept: dict[int, McapMessages] = {}  # of the wanted channels only
        self.nameless = 0  # messages of channels that the file never describes

    def file(self, view: memoryview) -> None:
        """All records after the magic, up to the footer or the cut."""
        end = len(MAGIC)
        whole = False
        for opcode, start, stop in records_of(view, end):
            end, whole = stop, opcode == FOOTER
            if whole:
                break
            self.record(opcode, view[start:end])
        if not whole:
            if end + RECORD_HEAD.size < len(view) and view[end] == CHUNK:
                self.chunk(view[end + RECORD_HEAD.size :], whole=False)
            self._tell_end(view, end)
        elif bytes(view[end : end + len(MAGIC)]) != MAGIC:
            self._tell_end(view, end)
        if self.nameless:
            self.contents.damage.append(f"{self.nameless} messages belong to no channel of the file: left out")

    def record(self, opcode: int, content: View) -> None:
        """One whole record of the file's top level."""
        if opcode == CHUNK:
            self.chunk(content)
        elif opcode == ATTACHMENT:
            self.contents.attachments.append(bytes(content))
        elif opcode == METADATA:
            self.contents.metadata.append(bytes(content))
        else:
            self._inner(opcode, content)

    def _inner(self, opcode: int, content: View) -> None:
        """A record that may also stand in a chunk."""
        if opcode == MESSAGE and len(content) >= MESSAGE_HEAD.size:
            channel_id, sequence, log_time, publish_time = MESSAGE_HEAD.unpack_from(content)
            self.contents.last_log_time = log_time
            messages = self.kept.get(channel_id)
            if messages is not None:
                messages.add(log_time, publish_time, sequence, content[MESSAGE_HEAD.size :])
            elif channel_id not in self.contents.messages:
                self.nameless += 1
        elif opcode in (SCHEMA, CHANNEL):
            self._description(opcode, bytes(content))

    def _description(self, opcode: int, content: bytes) -> None:
        from mcap.exceptions import McapError

        try:
            (self._schema if opcode == SCHEMA else self._channel)(content)
        except (struct.error, UnicodeDecodeError, McapError):
            self.contents.damage.append("the description of a channel is malformed: its messages are left out")

    def _schema(self, content: bytes) -> None:
        from mcap.data_stream import ReadDataStream
        from mcap.records import Schema

        schema = Schema.read(ReadDataStream(BytesIO(content)))
        self.schemas.setdefault(schema.id, (schema.name, schema.encoding, schema.data))

    def _channel(self, content: bytes) -> None:
        from mcap.data_stream import ReadDataStream
        from mcap.records import Channel

        read = Channel.read(ReadDataStream(BytesIO(content)))
        if read.id in self.contents.messages:
            return  # channels are repeated in the summary at the end
        schema = self.schemas.get(read.schema_id, ("", "", b""))
        channel = McapChannel(read.id, read.topic, read.message_encoding, *schema, metadata=dict(read.metadata))
        messages = self.messages_of(channel)
        self.contents.messages[read.id] = messages
        if self.wanted(channel):
            self.kept[read.id] = messages

    def messages_of(self, channel: McapChannel) -> McapMessages:
        """Where the messages of a channel are kept."""
        return McapMessages(channel)

    def chunk(self, content: View, whole: bool = True) -> None:
        """A chunk, or as much as there is of it."""
        try:
            data = read_chunk(content, whole)
        except ChunkError as error:
            self.contents.damage.append(f"{error}: its messages are left out")
            return
        for opcode, start, end in records_of(data, 0):
            self._inner(opcode, data[start:end])

    def _tell_end(self, view: memoryview, end: int) -> None:
        last = self.contents.last_log_time
        upto = "no message is left" if last is None else f"read up to log time {last / 1e9:.3f} s"
        if bytes(view[-len(MAGIC) :]) == MAGIC and len(view) > end + len(MAGIC):
            self.contents.damage.insert(0, f"the file is damaged at byte {end} ({upto}); what follows is lost")
        else:
            self.contents.damage.insert(0, f"the file is cut off at byte {len(view)} ({upto}); what follows is lost")


def records_of(data: View, start: int) -> Iterator[tuple[int, int, int]]:
    """Opcode, start and end of the content of every whole record."""
    size = len(data)
    unpack = RECORD_HEAD.unpack_from
    while start + RECORD_HEAD.size <= size:
        opcode, length = unpack(data, start)
        start += RECORD_HEAD.size
        if opcode == 0 or start + length > size:  # 0 is no opcode: padding of a file system after a crash
            return
        yield opcode, start, start + length
        start += length


CHUNK_HEAD = struct.Struct("<QQQI")  # start and end log time, uncompressed size, CRC of the content


class ChunkError(Exception):
    """A chunk that cannot be read; the message says why."""


def read_chunk(content: bytes | memoryview, whole: bool = True) -> bytes:
    """The records of a chunk, decompressed.

    Args:
        content: of the chunk record, without opcode and length.
        whole: False if the content is cut off: then everything that decompresses is returned, which is every block
            that was written completely (zstd and lz4 compress in blocks of at most 128 KiB and 4 MiB).

    Raises:
        ChunkError: for an unknown compression, or data that does not match its size or checksum.
    """
    try:
        _, _, size, crc = CHUNK_HEAD.unpack_from(content)
        compression, start = _prefixed_string(content, CHUNK_HEAD.size)
        (length,) = struct.unpack_from("<Q", content, start)
    except (struct.error, UnicodeDecodeError) as error:
        if not whole:
            return b""
        raise ChunkError("a chunk's head is malformed") from error
    packed = bytes(content[start + 8 : start + 8 + length])
    data = _decompress(compression, packed, size, whole)
    if whole and len(data) != size:
        raise ChunkError(f"a chunk holds {len(data)} bytes where its head says {size}")
    if whole and crc and zlib.crc32(data) != crc:
        raise ChunkError("a chunk does not match its checksum")
    return data


def _prefixed_string(content: bytes | memoryview, start: int) -> tuple[str, int]:
    (length,) = struct.unpack_from("<I", content, start)
    end = start + 4 + length
    if end > len(content):
        raise struct.error("string beyond the end")
    return str(content[start + 4 : end], "utf-8"), end


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
        raise ChunkError(f"a chunk is compressed with '{compression}' (known: zstd, lz4)")
    try:
        return decompress(packed)
    except failure as error:
        if not whole:
            return b""
        raise ChunkError(f"a chunk of {size} bytes does not decompress ({error})") from error


class _Ends(McapMessages):
    """Of the messages of a channel the first and the last one alone, by log time."""

    def add(self, log_time: int, publish_time: int, sequence: int, data: View) -> None:
        """One more, in the place of the one that it is before or after."""
        times = self.log_times
        if times and min(times) <= log_time <= max(times) and len(times) > 1:
            return
        super().add(log_time, publish_time, sequence, data)
        if len(times) > 2:
            order = np.argsort(times, kind="stable").tolist()
            for values in (times, self.publish_times, self.sequences, self.data):
                values[:] = [values[order[0]], values[order[-1]]]


class _FirstPass(RecordWalk):
    """Keeps the messages of wanted channels, and of the sampled ones the ends."""

    def __init__(
        self, contents: McapContents, wanted: Callable[[McapChannel], bool], sampled: Callable[[McapChannel], bool]
    ) -> None:
        super().__init__(contents, lambda channel: wanted(channel) or sampled(channel))
        self._sampled = sampled

    def messages_of(self, channel: McapChannel) -> McapMessages:
        return _Ends(channel) if self._sampled(channel) else McapMessages(channel)


@dataclass(frozen=True)
class _ChunkPlace:
    """Where a chunk's content lies in the file, and the log times in it."""

    offset: int
    length: int
    first: int
    last: int


class McapByTime:
    """An MCAP file of which as much is in memory as is asked for.

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
        self.path, self._sampled, self.chunked = Path(path), sampled, True
        check_file(self.path)
        self.contents = McapContents(self.path)
        self._chunks: list[_ChunkPlace] = []
        walk = _FirstPass(self.contents, wanted, sampled)
        with open(self.path, "rb") as file:
            check_magic(self.path, file.read(len(MAGIC)))
            self._pass_over(file, walk)
        for sentence in self.contents.damage:
            warnings.warn(McapWarning(f"{path}: {sentence}"), stacklevel=2)

    def _pass_over(self, file: IO[bytes], walk: RecordWalk) -> None:
        size, offset = self.path.stat().st_size, len(MAGIC)
        while offset + RECORD_HEAD.size <= size:
            opcode, length = RECORD_HEAD.unpack(file.read(RECORD_HEAD.size))
            offset += RECORD_HEAD.size
            if opcode == FOOTER:
                return
            if opcode == 0 or offset + length > size:
                break
            content = file.read(length)
            if opcode == CHUNK and length >= CHUNK_HEAD.size:
                first, last, _, _ = CHUNK_HEAD.unpack_from(content)
                self._chunks.append(_ChunkPlace(offset, length, first, last))
            elif opcode == MESSAGE and length >= MESSAGE_HEAD.size:
                self.chunked = False
            walk.record(opcode, content)
            offset += length
        self.contents.damage.insert(0, f"the file is cut off or damaged at byte {offset}; what follows is lost")

    def between(self, first: int, last: int) -> McapContents:
        """The messages of sampled channels with log times from ``first`` to ``last``, nanoseconds, in file order."""
        found = McapContents(self.path)
        walk = RecordWalk(found, self._sampled)
        for number, one in self.contents.messages.items():
            found.messages[number] = McapMessages(one.channel)
            if self._sampled(one.channel):
                walk.kept[number] = _Inside(one.channel, between=(first, last))
                found.messages[number] = walk.kept[number]
        with open(self.path, "rb") as file:
            for chunk in self._chunks:
                if chunk.first <= last and chunk.last >= first:
                    file.seek(chunk.offset)
                    walk.chunk(file.read(chunk.length))
        return found


@dataclass
class _Inside(McapMessages):
    """The messages of a channel within some log times."""

    between: tuple[int, int] = (0, 0)

    def add(self, log_time: int, publish_time: int, sequence: int, data: View) -> None:
        if self.between[0] <= log_time <= self.between[1]:
            super().add(log_time, publish_time, sequence, data)
