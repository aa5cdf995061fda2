"""Live messages through a pipe: each after its length in bytes, as a varint."""

import io
import os
import select
import stat
import sys
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, BinaryIO

from vip_factors.errors import FileFormatError, InputError
from vip_factors.io.live.session import Client, ClientError, Session
from vip_factors.io.live.source import POLL, LiveSource
from vip_factors.io.settings import DEFAULT, LiveSourceSettings
from vip_factors.sensors.live import LiveFinding

if TYPE_CHECKING:
    from _typeshed import WriteableBuffer

VARINT_BYTES = 5  # enough for 32 GiB


def delimited_messages(stream: BinaryIO, largest: int) -> Iterator[bytes]:
    """The messages of a delimited stream, to its end.

    Args:
        stream: open for reading.
        largest: bytes of a message.

    Raises:
        FileFormatError: for a length that no message has, or an end in the middle of a message.
    """
    while (length := _length(stream)) is not None:
        if length > largest:
            raise FileFormatError(
                f"a message of {length:,} bytes is announced: expected at most {largest:,}; either the bytes are no "
                "live messages, or the setting largest_message must grow"
            )
        data = stream.read(length)
        if len(data) < length:
            raise _cut_off(length - len(data))
        yield data


def follow(client: Client, stream: BinaryIO, largest: int) -> str:
    """Give a client the messages of a delimited stream; a clause about why it ended, empty if between two messages."""
    try:
        for message in delimited_messages(stream, largest):
            client.take(message)
    except OSError as error:
        return f"the connection was lost ({error.strerror or error})"
    except (FileFormatError, ClientError) as error:  # where the next message would begin is not known
        return str(error)
    return "" if client.has_header else "the stream ended before a header came"


def _length(stream: BinaryIO) -> int | None:
    """The next varint; None at the end of the stream."""
    length = 0
    for number in range(VARINT_BYTES):
        byte = stream.read(1)
        if not byte:
            if number:
                raise _cut_off(1)
            return None
        length |= (byte[0] & 0x7F) << 7 * number
        if byte[0] < 0x80:
            return length
    raise FileFormatError("the bytes are no live messages: expected each after its length as a varint")


def _cut_off(missing: int) -> FileFormatError:
    return FileFormatError(f"the stream ended in the middle of a message, at least {missing} bytes before its end")


class StandardInputSource(LiveSource):
    """Standard input, or any other descriptor that a sender writes to.

    Args:
        settings, on_finding: as of every source.
        descriptor: to read from instead; it stays open.
    """

    def __init__(
        self,
        settings: LiveSourceSettings = DEFAULT,
        on_finding: Callable[[LiveFinding], None] | None = None,
        descriptor: int | None = None,
    ) -> None:
        super().__init__("standard input", settings, drops=not _is_file(descriptor), on_finding=on_finding)
        self._descriptor = descriptor

    def _open(self) -> None:
        if self._descriptor is None:
            try:
                self._descriptor = sys.stdin.fileno()
            except (AttributeError, OSError, ValueError) as error:
                raise InputError("standard input is closed: expected a sender's live messages") from error
        if os.isatty(self._descriptor):
            raise InputError("standard input is a terminal: pipe a sender's live messages into it")

    def _read(self) -> None:
        client = Client(Session(self._announce, self._put), self.name)
        begun, is_late = time.monotonic(), False

        def wait() -> bool:
            """Called ever again while nothing comes; whether to wait on."""
            nonlocal is_late
            self._pause()
            if not client.has_header and not is_late and time.monotonic() - begun > self._settings.header_wait:
                is_late = True
                client.report("late", f"no header came within {self._settings.header_wait:g} s; still waiting for it")
            return not self._stop.is_set()

        assert self._descriptor is not None  # open
        pipe = io.BufferedReader(_Pipe(self._descriptor, wait))
        reason = follow(client, pipe, self._settings.largest_message)
        client.leave("" if self._stop.is_set() else reason)


class _Pipe(io.RawIOBase):
    """A descriptor that is read as long as ``wait`` says so: who leaves a stream need not wait for its sender."""

    def __init__(self, descriptor: int, wait: Callable[[], bool]) -> None:
        self._descriptor, self._wait = descriptor, wait

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: "WriteableBuffer", /) -> int:
        view = memoryview(buffer)
        while self._wait():
            if select.select([self._descriptor], [], [], POLL)[0]:
                data = os.read(self._descriptor, len(view))
                view[: len(data)] = data
                return len(data)
        return 0


def _is_file(descriptor: int | None) -> bool:
    """Whether a file is read, which has time: nothing of it need be dropped."""
    try:
        return stat.S_ISREG(os.fstat(sys.stdin.fileno() if descriptor is None else descriptor).st_mode)
    except (AttributeError, OSError, ValueError):
        return False
