"""The messages of an MCAP file between two instants, out of a file that is larger than memory.

The file is passed over once: what comes once is kept, of samples only how they begin and end, and of every chunk where
it lies and which times it holds. Chunks are then read as they are asked for.
"""

import os
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import numpy as np

from vip_factors.io.mcap_chunk import CHUNK_HEAD
from vip_factors.io.mcap_contents import (
    CHUNK,
    FOOTER,
    MAGIC,
    MESSAGE,
    MESSAGE_HEAD,
    RECORD_HEAD,
    McapChannel,
    McapContents,
    McapMessages,
    McapWarning,
    RecordWalk,
    View,
    check_file,
    check_magic,
)


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
class _Chunk:
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
        self._chunks: list[_Chunk] = []
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
                self._chunks.append(_Chunk(offset, length, first, last))
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
