"""The records of an MCAP file (https://mcap.dev/spec), one after the other, and what is in a chunk.

The library's readers need the index at the end of the file, or fail at the first short record; this walk begins at the
start, and ends at the footer, where the file is cut or damaged, or, of a file that grows
(vip_factors.io.live.growing_file), when it has not grown for a while.
"""

import os
import struct
import zlib
from collections.abc import Iterator
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
CHUNK_INDEX_HEAD = struct.Struct("<QQQQI")  # start and end log time, offset and length of the chunk, bytes of a map
INDEX_HEAD = struct.Struct("<HI")  # of the messages of a channel in a chunk: channel, bytes that follow
STATISTICS_CONTENT = struct.Struct("<QHIIIIQQ")  # counts of six kinds, start and end log time
FOOTER_BYTES = 20
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, ATTACHMENT, METADATA = 0x02, 0x03, 0x04, 0x05, 0x06, 0x09, 0x0C
MESSAGE_INDEX, CHUNK_INDEX, STATISTICS, DATA_END = 0x07, 0x08, 0x0B, 0x0F


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


def logged_interval(path: Path) -> tuple[int, int] | None:
    """First and last log time in nanoseconds, as the index at the end of a file says; None if it has none.

    Raises:
        InputError: if there is no such file.
    """
    data = read_summary(path)
    for opcode, start, end in records_of(data):
        if opcode == STATISTICS and end - start >= STATISTICS_CONTENT.size:
            *_, first, last = STATISTICS_CONTENT.unpack_from(data, start)
            return first, last
    return None


def read_summary(path: Path) -> bytes:
    """The records at the end of a file that say what it holds and where; empty if it has none.

    Raises:
        InputError: if there is no such file.
    """
    check_file(path)
    with open(path, "rb") as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(size - FOOTER_BYTES - len(MAGIC), 0))
        footer = file.read()
        if len(footer) < FOOTER_BYTES + len(MAGIC) or not footer.endswith(MAGIC):
            return b""
        index = int.from_bytes(footer[:8], "little")
        if not 0 < index < size:
            return b""
        file.seek(index)
        return file.read()
