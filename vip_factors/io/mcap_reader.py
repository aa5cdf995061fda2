"""The messages of an MCAP file: all of them, or those between two instants.

Of a truncated or damaged file it is everything that is still whole, and what can be decompressed of a chunk that was
cut.
"""

import os
import struct
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from vip_factors.io import mcap_records
from vip_factors.io.mcap_records import McapChannel, RecordError, RecordFile

if TYPE_CHECKING:
    from mcap.records import Channel, Schema


class McapWarning(UserWarning):
    """Something in a file was left out or could not be read, and what it was."""


@dataclass
class McapMessages:
    """The messages of one channel in file order: log and publish times in nanoseconds, numbers, serialised data."""

    channel: McapChannel
    log_times: list[int] = field(default_factory=list)
    publish_times: list[int] = field(default_factory=list)
    sequences: list[int] = field(default_factory=list)
    data: list[bytes] = field(default_factory=list)

    def add(self, log_time: int, publish_time: int, sequence: int, data: bytes) -> None:
        """Take in the next message of the channel."""
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
        """All topics of the file, wanted or not, sorted."""
        return sorted(self.topics_in_order)

    @property
    def topics_in_order(self) -> list[str]:
        """The same as they first came."""
        return list(dict.fromkeys(messages.channel.topic for messages in self.messages.values()))


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


def read_by_index(
    path: str | os.PathLike[str], wanted: Callable[[McapChannel], bool], sampled: Callable[[McapChannel], bool]
) -> tuple[McapContents, dict[int, np.ndarray]] | None:
    """What the index at the end of an MCAP file tells, without the messages of channels that have many.

    Args:
        path: of the file.
        wanted: channels whose messages are few: they are read.
        sampled: those of which the first and the last message of the file is read.

    Returns:
        Contents, and by channel id the log times of all its messages in file order, nanoseconds; None where there is
        no index, or one that does not fit the file.

    Raises:
        InputError: if there is no such file.
    """

    def keep(channel: McapChannel) -> McapMessages | None:
        return _Ends(channel) if sampled(channel) else McapMessages(channel) if wanted(channel) else None

    walk, chunks, count = _Walk(Path(path), keep), list[tuple[int, int, int]](), 0
    try:
        data = mcap_records.read_summary(Path(path))
        for opcode, start, end in mcap_records.records_of(data):
            if opcode in (mcap_records.SCHEMA, mcap_records.CHANNEL):
                walk.record(opcode, data, start, end)
            elif opcode == mcap_records.CHUNK_INDEX:
                _, _, offset, length, mapped = mcap_records.CHUNK_INDEX_HEAD.unpack_from(data, start)
                at = start + mcap_records.CHUNK_INDEX_HEAD.size + mapped
                chunks.append((offset, length, int.from_bytes(data[at : at + 8], "little")))
            elif opcode == mcap_records.STATISTICS:
                count = mcap_records.STATISTICS_CONTENT.unpack_from(data, start)[0]
        held, times = dict[int, list[int]](), dict[int, list[np.ndarray]]()
        with open(path, "rb", buffering=0) as file:  # a buffer would be filled anew for each of ten thousand chunks
            for chunk, (offset, length, size) in enumerate(chunks):
                file.seek(offset + length)
                for number, logged in _indexed_times(file.read(size)):
                    held.setdefault(number, []).append(chunk)
                    times.setdefault(number, []).append(logged)
            needed = set[int]()
            for number, messages in walk.gathered.items():
                own = held.get(number, [])
                needed.update([*own[:1], *own[-1:]] if isinstance(messages, _Ends) else own)
            for offset, length, _ in (chunks[one] for one in sorted(needed)):
                file.seek(offset + mcap_records.RECORD_HEAD.size)
                walk.chunk(file.read(length - mcap_records.RECORD_HEAD.size))
    except (struct.error, ValueError):
        return None
    log_times = {number: np.concatenate(own) for number, own in times.items()}
    if not chunks or walk.contents.damage or sum(map(len, log_times.values())) != count:
        return None
    return walk.contents, log_times


def _indexed_times(data: bytes) -> Iterator[tuple[int, np.ndarray]]:
    """Channel id, and the log times of its messages in a chunk, by the records that follow the chunk."""
    head = mcap_records.INDEX_HEAD.size
    for opcode, at, end in mcap_records.records_of(data):
        if opcode == mcap_records.MESSAGE_INDEX and end > at + head:
            pairs = np.frombuffer(data, "<i8", (end - at - head) // 8, at + head)
            yield int.from_bytes(data[at : at + 2], "little"), pairs[::2]  # beside each, where it stands in the chunk


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
        mcap_records.check_file(path)
        with open(path, "rb") as file:
            records = RecordFile(path, file)
            for opcode, start, content in records.records():
                if opcode == mcap_records.CHUNK:
                    self._indexed_chunk(start, content)
                elif opcode == mcap_records.ATTACHMENT:
                    self.contents.attachments.append(content)
                elif opcode == mcap_records.METADATA:
                    self.contents.metadata.append(content)
                else:
                    self.chunked = self.chunked and opcode != mcap_records.MESSAGE
                    self.record(opcode, content, 0, len(content))
            if records.ended != mcap_records.FOOTER or not file.read()[mcap_records.FOOTER_BYTES :].startswith(
                mcap_records.MAGIC
            ):
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
        if len(rest) > mcap_records.RECORD_HEAD.size and rest[0] == mcap_records.CHUNK:
            self._indexed_chunk(at + mcap_records.RECORD_HEAD.size, rest[mcap_records.RECORD_HEAD.size :], whole=False)
        last = self.contents.last_log_time
        upto = "no message is left" if last is None else f"read up to log time {last / 1e9:.3f} s"
        damaged = rest.endswith(mcap_records.MAGIC) and len(rest) > len(mcap_records.MAGIC)
        where = f"damaged at byte {at}" if damaged else f"cut off at byte {size}"
        self.contents.damage.insert(0, f"the file is {where} ({upto}); what follows is lost")

    def _indexed_chunk(self, start: int, content: bytes, whole: bool = True) -> None:
        if len(content) >= mcap_records.CHUNK_HEAD.size:
            first, last, _, _ = mcap_records.CHUNK_HEAD.unpack_from(content)
            self.chunks.append(_ChunkPlace(start, len(content), whole, first, last))
        self.chunk(content, whole)

    def chunk(self, content: bytes, whole: bool = True) -> None:
        """A chunk, or as much as there is of it."""
        try:
            data = mcap_records.read_chunk(content, whole)
        except RecordError as error:
            self.contents.damage.append(f"{error}: its messages are left out")
            return
        for opcode, start, end in mcap_records.records_of(data):
            self.record(opcode, data, start, end)

    def record(self, opcode: int, data: bytes, start: int, end: int) -> None:
        """A record that may stand in a chunk."""
        if opcode == mcap_records.MESSAGE and end - start >= mcap_records.MESSAGE_HEAD.size:
            number, sequence, log_time, publish_time = mcap_records.MESSAGE_HEAD.unpack_from(data, start)
            self.contents.last_log_time = log_time
            messages = self.gathered.get(number)
            if messages is not None:
                messages.add(log_time, publish_time, sequence, data[start + mcap_records.MESSAGE_HEAD.size : end])
            elif number not in self.contents.messages:
                self._nameless += 1
        elif opcode in (mcap_records.SCHEMA, mcap_records.CHANNEL):
            try:
                self._describe(mcap_records.description(opcode, data[start:end]))
            except RecordError:
                self.contents.damage.append("the description of a channel is malformed: its messages are left out")

    def _describe(self, read: "Schema | Channel") -> None:
        from mcap.records import Schema

        if isinstance(read, Schema):
            self._schemas.setdefault(read.id, read)
        elif read.id not in self.contents.messages:  # channels are repeated in the summary at the end
            channel = mcap_records.channel_of(read, self._schemas.get(read.schema_id))
            messages = self._keep(channel)
            self.contents.messages[read.id] = McapMessages(channel) if messages is None else messages
            if messages is not None:
                self.gathered[read.id] = messages
