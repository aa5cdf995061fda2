"""A delimited stream of live messages from one sender, and standard input as one."""

import os
import select
import stat
import sys
import time
from collections.abc import Callable
from threading import Event

from vip_factors.errors import FileFormatError, InputError
from vip_factors.io.live.framing import Deframer
from vip_factors.io.live.pace import Pace
from vip_factors.io.live.session import Client, ClientError, Session
from vip_factors.io.live.settings import DEFAULT, LiveSourceSettings
from vip_factors.io.live.source import POLL, LiveSource
from vip_factors.sensors.live import LiveFinding

PIECE = 64 * 1024  # bytes at a time: what a pipe holds


def listen(
    client: Client,
    receive: Callable[[], bytes | None],
    settings: LiveSourceSettings,
    stop: Event,
    may_be_late: bool = False,
    network: bool = True,
) -> str:
    """Follow one sender to its end; a clause about why it ended, empty if it did between two messages.

    Args:
        client: gets the messages.
        receive: the next bytes, none at the end of the stream, or None after :data:`POLL` seconds without any.
        settings: limits.
        stop: set when nothing more is wanted.
        may_be_late: whether a header that does not come is told instead of ending it.
        network: whether the sender's pace is limited.
    """
    deframer = Deframer(settings.largest_message)
    pace = Pace(settings.largest_rate if network else float("inf"))
    whole = time.monotonic()  # when nothing of a message was pending
    begun, told = time.monotonic(), False
    while not stop.is_set():
        if not client.has_header and not told and time.monotonic() - begun > settings.header_wait:
            sentence = f"no header came within {settings.header_wait:g} s"
            if not may_be_late:
                return sentence
            told = True
            client.tell("late", f"{sentence}; still waiting for it")
        if network and time.monotonic() - whole > settings.message_wait:
            return f"a message was not whole {settings.message_wait:g} s after its first byte"
        try:
            data = receive()
        except OSError as error:
            return f"the connection was lost ({error.strerror or error})"
        if data is None:
            client.flush()
            whole = whole if deframer.pending else time.monotonic()
            continue
        if not data:
            return _end(client, deframer)
        before = client.messages
        try:
            for message in deframer.feed(data):
                client.take(message)
        except (FileFormatError, ClientError) as error:
            return str(error)  # where the next message would begin is not known
        if not deframer.pending or client.messages > before:
            whole = time.monotonic()
        wait = pace.take(client.messages - before)
        if wait:
            client.tell("pace", f"it sends more than {settings.largest_rate:g} messages a second and has to wait")
            stop.wait(wait)
            whole += wait
    return ""


def _end(client: Client, deframer: Deframer) -> str:
    if deframer.pending:
        return f"the stream ended in the middle of a message, {deframer.pending} bytes after its beginning"
    return "" if client.has_header else "the stream ended before a header came"


class StandardInputSource(LiveSource):
    """Standard input, or any other descriptor that a sender writes to.

    Args:
        settings, tell: as of every source.
        token: that the header must have; any if empty.
        descriptor: to read from instead; it stays open.
    """

    def __init__(
        self,
        settings: LiveSourceSettings = DEFAULT,
        tell: Callable[[LiveFinding], None] | None = None,
        descriptor: int | None = None,
        token: str = "",
    ) -> None:
        super().__init__("standard input", settings, drops=not _is_file(descriptor), tell=tell)
        self._descriptor = descriptor
        self._token = token

    def _open(self) -> None:
        if self._descriptor is None:
            try:
                self._descriptor = sys.stdin.fileno()
            except (AttributeError, OSError, ValueError) as error:
                raise InputError("standard input is closed: expected a sender's live messages") from error
        if os.isatty(self._descriptor):
            raise InputError("standard input is a terminal: pipe a sender's live messages into it")

    def _read(self) -> None:
        client = Client(Session(self._announce, self._put, self._token), self.name)
        client.leave(listen(client, self._receive, self._settings, self._stop, may_be_late=True, network=False))

    def _receive(self) -> bytes | None:
        descriptor = self._descriptor
        if descriptor is None or not select.select([descriptor], [], [], POLL)[0]:
            return None
        return os.read(descriptor, PIECE)


def _is_file(descriptor: int | None) -> bool:
    """Whether a file is read, which has time: nothing of it need be dropped."""
    try:
        return stat.S_ISREG(os.fstat(sys.stdin.fileno() if descriptor is None else descriptor).st_mode)
    except (AttributeError, OSError, ValueError):
        return False
