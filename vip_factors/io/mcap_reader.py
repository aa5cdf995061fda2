"""The messages of an MCAP file: all of them, or those of some channels.

The ``mcap`` library reads the records. Of a truncated or damaged file everything is read that its whole chunks hold.
"""

import os
import struct
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import IO, BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader

from vip_factors.errors import FileFormatError, InputError
from vip_factors.io.mcap_chunks import ChunkError, LargeChunkError, chunk_data, largest_chunk, records_of

MAGIC = b"\x89MCAP0\r\n"
MESSAGE = int(Opcode.MESSAGE)  # compared a million times
MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
# What the library raises for records that are cut or damaged; a length in them may be any number.
READ_ERRORS = (McapError, struct.error, ValueError, OverflowError, MemoryError)


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


@dataclass
class McapMessages:
    """The messages of one channel in file order: log times in nanoseconds, serialised data."""

    channel: McapChannel
    log_times: list[int] = field(default_factory=list)
    data: list[bytes] = field(default_factory=list)

    def rows(self, rows: Sequence[int]) -> "McapMessages":
        """Some of them, by their places in the lists."""
        return McapMessages(self.channel, [self.log_times[row] for row in rows], [self.data[row] for row in rows])


@dataclass
class McapContents:
    """What an MCAP file holds.

    Attributes:
        path: of the file.
        messages: by channel id, of every channel named in the file; empty for channels not wanted.
        damage: sentences about what could not be read; empty for a whole file.
        last_log_time: of the last whole message of any channel, nanoseconds; None without messages.
    """

    path: Path
    messages: dict[int, McapMessages] = field(default_factory=dict)
    damage: list[str] = field(default_factory=list)
    last_log_time: int | None = None

    @property
    def topics(self) -> list[str]:
        """All topics of the file, wanted or not, sorted."""
        return sorted(self.topics_in_order)

    @property
    def topics_in_order(self) -> list[str]:
        """The same as they first came."""
        return list(dict.fromkeys(messages.channel.topic for messages in self.messages.values()))


class McapPass:
    """One pass over the records of a file, which gathers messages.

    Attributes:
        contents: what has been read.
        gathered: the messages of wanted channels, by channel id.
        refusals: sentences about chunks that were larger than they may be.

    Args:
        path: of the file.
        wanted: whether the messages of a channel are kept.

    Raises:
        InputError: for a limit in the environment that is no number.
    """

    def __init__(self, path: Path, wanted: Callable[[McapChannel], bool]) -> None:
        self.contents = McapContents(path)
        self.gathered: dict[int, McapMessages] = {}
        self.refusals: list[str] = []
        self._wanted, self._largest = wanted, largest_chunk()
        self._schemas: dict[int, Schema] = {}
        self._nameless = 0  # messages of channels that the file never describes

    def records(self, file: IO[bytes], largest_record: int) -> Iterator[McapRecord]:
        """Take in the records of a file, and give back each, up to the footer or what is not whole.

        Args:
            file: open, at its beginning.
            largest_record: bytes of a record at most.

        Raises:
            FileFormatError: if it is no MCAP file.
        """
        check_magic(self.contents.path, file.read(len(MAGIC)))
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
            self.end_early(file, position)

    def take(self, record: McapRecord) -> None:
        """Take in a record that stands outside of chunks."""
        if isinstance(record, Chunk):
            self.take_chunk(record)
        elif isinstance(record, Message):
            self.add(record.channel_id, record.log_time, record.data)
        elif isinstance(record, Schema | Channel):
            self._describe(record)

    def take_chunk(self, chunk: Chunk) -> None:
        """Take in the records of a chunk; one that is damaged or larger than it may be is left out."""
        try:
            data = chunk_data(chunk, self._largest)
        except ChunkError as error:
            sentences = self.refusals if isinstance(error, LargeChunkError) else self.contents.damage
            sentences.append(f"{error}: its messages are left out")
            return
        for opcode, start, end in records_of(data):
            if opcode == MESSAGE and end - start >= MESSAGE_HEAD.size:
                number, _, log_time, _ = MESSAGE_HEAD.unpack_from(data, start)
                self.add(number, log_time, data[start + MESSAGE_HEAD.size : end])
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                kind: type[Schema | Channel] = Schema if opcode == Opcode.SCHEMA else Channel
                try:
                    self._describe(kind.read(ReadDataStream(BytesIO(data[start:end]))))
                except READ_ERRORS:
                    self.contents.damage.append("the description of a channel is malformed: its messages are left out")

    def know(self, channel: McapChannel) -> None:
        """Take in a channel, unless it is known: chunks and the end of the file repeat them."""
        if channel.id not in self.contents.messages:
            messages = self.contents.messages[channel.id] = McapMessages(channel)
            if self._wanted(channel):
                self.gathered[channel.id] = messages

    def add(self, number: int, log_time: int, data: bytes) -> None:
        """Take in a message of the channel with this id."""
        self.contents.last_log_time = log_time
        messages = self.gathered.get(number)
        if messages is not None:
            messages.log_times.append(log_time)
            messages.data.append(data)
        elif number not in self.contents.messages:
            self._nameless += 1

    def take_messages(self) -> list[tuple[int, bytes]]:
        """Channel and data of the messages gathered since the last time, in the order of their log times."""
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
        """What could not be read since the last time, and what was refused."""
        complaints = [*self.contents.damage, *self.refusals]
        self.contents.damage.clear()
        self.refusals.clear()
        return complaints

    def end_early(self, file: IO[bytes], position: int) -> None:
        """Take note of a file whose records end at a byte before they should."""
        size = file.seek(0, os.SEEK_END)
        file.seek(max(size - len(MAGIC), 0))
        is_cut = size <= position + len(MAGIC) or file.read() != MAGIC
        last_log_time = self.contents.last_log_time
        upto = "no message is left" if last_log_time is None else f"read up to log time {last_log_time / 1e9:.3f} s"
        where = f"cut off at byte {size}" if is_cut else f"damaged at byte {position}"
        self.contents.damage.insert(0, f"the file is {where} ({upto}); what follows is lost")

    def close(self) -> None:
        """Warn of the damage in a file that was read to its end.

        Raises:
            FileFormatError: if a chunk was larger than it may be.
        """
        self.check_size()
        if self._nameless:
            self.contents.damage.append(f"{self._nameless} messages belong to no channel of the file: left out")
        for sentence in self.contents.damage:
            warnings.warn(McapWarning(f"{self.contents.path}: {sentence}"), stacklevel=3)

    def check_size(self) -> None:
        """Check that no chunk was larger than it may be.

        Raises:
            FileFormatError: if one was.
        """
        if self.refusals:
            raise FileFormatError(f"{self.contents.path}: {self.refusals[0]}")

    def _describe(self, record: Schema | Channel) -> None:
        if isinstance(record, Schema):
            self._schemas.setdefault(record.id, record)
        else:
            schema = self._schemas.get(record.schema_id)
            described = ("", "") if schema is None else (schema.name, schema.encoding)
            self.know(McapChannel(record.id, record.topic, record.message_encoding, *described))


def read_contents(
    path: str | os.PathLike[str] | McapContents, wanted: Callable[[McapChannel], bool] | None = None
) -> McapContents:
    """All messages of an MCAP file, or those of the wanted channels; what was read already is given back.

    A file that ends early yields every chunk that is whole before the cut; a chunk whose content is damaged is left
    out. Both are told as a :class:`McapWarning` and in ``damage``.

    Raises:
        InputError: if there is no such file.
        FileFormatError: if it is empty or not an MCAP file, or a chunk is larger than it may be.
    """
    if isinstance(path, McapContents):
        return path
    reading = McapPass(Path(path), wanted or (lambda channel: True))
    with open_file(Path(path)) as file:
        for _ in reading.records(file, os.fstat(file.fileno()).st_size):
            pass
    reading.close()
    return reading.contents


def open_file(path: Path) -> BinaryIO:
    """The file, if it can be read from any place in it.

    Raises:
        InputError: if it cannot.
    """
    if path.is_dir():
        raise InputError(f"{path} is a folder: expected an MCAP file")
    if not path.exists():
        raise InputError(f"{path}: no such file; expected an MCAP file")
    if not path.is_file():
        raise InputError(f"{path} is a device or a pipe: expected an MCAP file; write what comes from it to one first")
    return open(path, "rb")


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
