"""The index at the end of an MCAP file: what the file holds and where, to read as much of it as is asked for."""

import os
import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Chunk, ChunkIndex
from mcap.summary import Summary

from vip_factors.io.mcap_chunks import RECORD_HEAD, records_of
from vip_factors.io.mcap_reader import READ_ERRORS, McapChannel, McapContents, McapPass, open_file, read_contents

INDEX_HEAD = struct.Struct("<HI")  # of the messages of a channel in a chunk: channel, bytes that follow


def read_summary(path: str | os.PathLike[str]) -> Summary | None:
    """What the end of a file says of it: statistics, channels and chunks; None if it does not.

    Raises:
        InputError: if there is no such file.
    """
    with open_file(Path(path)) as file:
        try:
            return SeekingReader(file, record_size_limit=os.fstat(file.fileno()).st_size).get_summary()
        except (*READ_ERRORS, OSError):
            return None


def logged_interval(summary: Summary | None) -> tuple[int, int] | None:
    """First and last log time in nanoseconds; None if a file does not say."""
    statistics = None if summary is None else summary.statistics
    return None if statistics is None else (statistics.message_start_time, statistics.message_end_time)


@dataclass(frozen=True)
class McapByTime:
    """An MCAP file larger than memory, of which as much is in memory as is asked for.

    Attributes:
        contents: the messages of channels that have few; of sampled channels the first and the last message.
        sampled: which channels have many messages.
        chunks: where the file's chunks lie, and which channels and log times they hold.
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
        """Read what comes once, and the ends of the rest; None where there is no index, or one that does not fit.

        Args:
            path: of the file.
            summary: of the file.
            wanted: channels whose messages are few.
            sampled: those whose messages are many.

        Raises:
            FileFormatError: if a chunk is larger than it may be.
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
        except READ_ERRORS:
            return None
        reading.check_size()
        counts = summary.statistics.channel_message_counts
        is_complete = all(
            sampled(messages.channel) or len(messages.data) == counts.get(number, 0)
            for number, messages in reading.gathered.items()
        )
        if reading.contents.damage or not is_complete:
            return None
        for number, messages in reading.gathered.items():
            if sampled(messages.channel) and messages.data:
                order = np.argsort(messages.log_times, kind="stable").tolist()
                reading.contents.messages[number] = messages.rows(order[:1] + order[1:][-1:])
        return cls(reading.contents, sampled, summary.chunk_indexes, summary.statistics.message_count)

    def between(self, start_ns: int, end_ns: int) -> McapContents:
        """The messages of sampled channels with log times from ``first`` to ``last``, nanoseconds, in file order."""
        reading = McapPass(self.contents.path, self.sampled)
        for messages in self.contents.messages.values():
            reading.know(messages.channel)
        within = [
            chunk for chunk in self.chunks if chunk.message_start_time <= end_ns and chunk.message_end_time >= start_ns
        ]
        _take_chunks(reading, within)
        for number, messages in reading.gathered.items():
            rows = [row for row, time in enumerate(messages.log_times) if start_ns <= time <= end_ns]
            reading.contents.messages[number] = messages.rows(rows)
        return reading.contents

    @property
    def is_complete(self) -> bool:
        """Whether the index knows all messages: others stand outside of chunks, and are not found by time."""
        return sum(len(times) for _, times in self._indexed()) == self.message_count

    def log_times(self) -> dict[int, np.ndarray] | None:
        """Log times ``(N,)`` in nanoseconds of all messages by channel id, in file order; None if some are missing."""
        times = dict[int, list[np.ndarray]]()
        for number, logged in self._indexed():
            times.setdefault(number, []).append(logged)
        of_channel = {number: np.concatenate(pieces) for number, pieces in times.items()}
        return of_channel if sum(map(len, of_channel.values())) == self.message_count else None

    def _indexed(self) -> Iterator[tuple[int, np.ndarray]]:
        """Channel id and log times of its messages, chunk by chunk."""
        head = INDEX_HEAD.size
        with open(self.contents.path, "rb", buffering=0) as file:  # a buffer would be filled anew for each chunk
            for chunk in self.chunks:
                file.seek(chunk.chunk_start_offset + chunk.chunk_length)
                data = file.read(chunk.message_index_length)
                for opcode, start, end in records_of(data):
                    if opcode == Opcode.MESSAGE_INDEX and end > start + head:
                        pairs = np.frombuffer(data, "<i8", (end - start - head) // 8, start + head)
                        yield INDEX_HEAD.unpack_from(data, start)[0], pairs[::2]  # beside each, its place in the chunk


def read_few(path: str | os.PathLike[str], wanted: Callable[[McapChannel], bool]) -> McapContents:
    """The messages of channels that have few: by the index, or where there is none those of the whole file.

    Raises:
        InputError: if there is no such file.
        FileFormatError: if it is empty or not an MCAP file, or a chunk is larger than it may be.
    """
    file = McapByTime.open(path, read_summary(path), wanted, lambda channel: False)
    return read_contents(path, wanted) if file is None else file.contents


def _take_chunks(reading: McapPass, chunks: Sequence[ChunkIndex]) -> None:
    with open(reading.contents.path, "rb") as file:
        for chunk in chunks:
            file.seek(chunk.chunk_start_offset + RECORD_HEAD.size)
            reading.take_chunk(Chunk.read(ReadDataStream(file)))
