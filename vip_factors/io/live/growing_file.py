"""The records of an MCAP file that another program is still writing (https://mcap.dev/spec)."""

import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Event
from typing import BinaryIO

from vip_factors.errors import FileFormatError, InputError
from vip_factors.io.live.source import LiveSourceSettings
from vip_factors.io.mcap_reader import (
    CHANNEL,
    CHUNK,
    CHUNK_HEAD,
    DATA_END,
    FOOTER,
    MAGIC,
    MESSAGE,
    RECORD_HEAD,
    SCHEMA,
    ChunkError,
    check_magic,
    read_chunk,
    records_of,
)

LOOK_EVERY = 0.03  # seconds between looks at the file's size: half a frame

Record = tuple[int, bytes]
"""Opcode and content."""


class GrowingFile:
    """Waits at the end of a file for more of it.

    Args:
        path: of the file, which may come later.
        settings: limits.
        stop: set when nothing more is wanted.
        tell: gets a kind and a sentence about what cannot be read.
    """

    def __init__(self, path: Path, settings: LiveSourceSettings, stop: Event, tell: Callable[[str, str], None]) -> None:
        self._path = path
        self._settings = settings
        self._stop = stop
        self._tell = tell

    def records(self) -> Iterator[Record]:
        """Schemas, channels and messages, of chunks too, until the end of the data, or of the file's growth.

        Raises:
            InputError: if the file does not come.
            FileFormatError: if it is no MCAP file.
        """
        with self._opened() as file:
            yield from self._records(file)

    def _opened(self) -> BinaryIO:
        begun = time.monotonic()
        while True:
            try:
                return open(self._path, "rb")
            except FileNotFoundError as error:
                if time.monotonic() - begun > self._settings.header_wait or self._stop.wait(LOOK_EVERY):
                    raise InputError(
                        f"{self._path}: no such file, nor did it come within {self._settings.header_wait:g} s; "
                        "expected an MCAP file that another program writes"
                    ) from error
            except OSError as error:
                raise InputError(f"{self._path}: cannot be read: {error.strerror}") from error

    def _records(self, file: BinaryIO) -> Iterator[Record]:
        if not self._grown(file, len(MAGIC)):
            check_magic(self._path, file.read())
        check_magic(self._path, file.read(len(MAGIC)))
        while self._grown(file, RECORD_HEAD.size):
            at = file.tell()
            opcode, length = RECORD_HEAD.unpack(file.read(RECORD_HEAD.size))
            if opcode in (DATA_END, FOOTER):
                return
            if opcode == 0:
                self._tell("end", f"it is damaged at byte {at:,}, where no record begins: what follows is lost")
                return
            largest = self._settings.largest_chunk if opcode == CHUNK else self._settings.largest_message
            wanted = opcode in (SCHEMA, CHANNEL, MESSAGE, CHUNK)
            if wanted and length > largest:
                self._tell(
                    "size", f"a record of {length:,} bytes at byte {at:,} is left out: expected at most {largest:,}"
                )
            if not self._grown(file, length):
                break
            if not wanted or length > largest:
                file.seek(length, os.SEEK_CUR)
            elif opcode == CHUNK:
                yield from self._chunk(file.read(length), at)
            else:
                yield opcode, file.read(length)
        if not self._stop.is_set():
            self._tell("end", f"it has not grown for {self._settings.growth_wait:g} s: taken as its end")

    def _chunk(self, content: bytes, at: int) -> Iterator[Record]:
        largest = self._settings.largest_chunk
        size = CHUNK_HEAD.unpack_from(content)[2] if len(content) >= CHUNK_HEAD.size else 0
        try:
            if size > largest:
                raise ChunkError(f"a chunk holds {size:,} bytes: expected at most {largest:,}")
            data = read_chunk(content)
        except ChunkError as error:
            self._tell("chunk", f"{error} (at byte {at:,}): its messages are left out")
            return
        for opcode, start, end in records_of(data, 0):
            if opcode == MESSAGE and end - start > self._settings.largest_message:
                self._tell(
                    "size",
                    f"a message of {end - start:,} bytes is left out: expected at most "
                    f"{self._settings.largest_message:,}",
                )
            elif opcode in (SCHEMA, CHANNEL, MESSAGE):
                yield opcode, data[start:end]

    def _grown(self, file: BinaryIO, wanted: int) -> bool:
        """Wait until that many bytes follow; False if the file does not grow any more."""
        position, known, since = file.tell(), -1, time.monotonic()
        while not self._stop.is_set():
            size = os.fstat(file.fileno()).st_size
            if size - position >= wanted:
                return True
            if size < position:
                raise FileFormatError(f"{self._path} has become shorter while it was followed: start anew with it")
            if size != known:
                known, since = size, time.monotonic()
            elif time.monotonic() - since > self._settings.growth_wait:
                return False
            self._stop.wait(LOOK_EVERY)
        return False
