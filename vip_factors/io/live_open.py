"""Live sources by name: a recording, standard input, a growing file, a port."""

import io
import os
import select
import stat
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO
from urllib.parse import urlsplit

from vip_factors.errors import FileFormatError, InputError
from vip_factors.io.live_messages import LARGEST_MESSAGE, Client, ClientError, Session
from vip_factors.io.live_source import PAUSE_S, POLL, LiveSource
from vip_factors.io.settings import DEFAULT, LiveSourceSettings
from vip_factors.sensors.live import LiveFinding, LiveSample, live_samples, stream_head
from vip_factors.sensors.scene import Scene

if TYPE_CHECKING:
    from _typeshed import WriteableBuffer

VARIABLE = "VIP_FACTORS_TOKEN"
VARINT_BYTES = 5  # enough for 32 GiB
LOCAL = "127.0.0.1"
EXPECTED = (
    "an MCAP file, - for standard input, ws://:port to listen at 127.0.0.1, or ws://host:port to listen elsewhere"
)


def open_source(
    text: str | os.PathLike[str],
    follow: bool = False,
    real_time: bool = False,
    settings: LiveSourceSettings = DEFAULT,
    on_finding: Callable[[LiveFinding], None] | None = None,
    token: str = "",
) -> LiveSource:
    """Make the source that a text names; it is a context manager.

    Args:
        text: path of an MCAP file, ``-`` for standard input, or ``ws://host:port`` to listen there, without a host at
            127.0.0.1.
        follow: whether another program still writes the file.
        real_time: whether the file is played back in its own time.
        settings: limits.
        on_finding: gets the findings that come before the header, at once.
        token: that senders over the network must have; one is generated if other machines can connect.

    Raises:
        InputError: for a text that names no source, options that do not belong to it, or a file that is no recording.
    """
    text = os.fspath(text)
    is_file = text != "-" and "://" not in text
    if (follow or real_time) and not is_file:
        raise InputError(f"{text}: following and playing back in real time are for MCAP files only")
    if follow and real_time:
        raise InputError(f"{text}: a file that is followed comes in its own time: choose following or real time")
    source: LiveSource
    if text == "-":
        source = StandardInputSource(settings)
    elif not is_file:
        source = _network(text, settings, token)
    elif follow:
        from vip_factors.io.live_growing import GrowingFileSource

        source = GrowingFileSource(text, settings)
    else:
        from vip_factors.io.mcap_recording import read_scene

        source = RecordingSource(read_scene(text), real_time, settings)
    source.on_finding = on_finding
    return source


def _network(text: str, settings: LiveSourceSettings, token: str) -> LiveSource:
    try:
        url = urlsplit(text)
        host, port = url.hostname, url.port
    except ValueError as error:
        raise InputError(f"{text}: {error}: expected {EXPECTED}") from error
    if url.scheme != "ws" or url.path not in ("", "/") or url.query or url.fragment or url.username is not None:
        raise InputError(f"{text}: expected {EXPECTED}")
    if port is None:
        raise InputError(
            f"{text}: it names no port: expected ws://host:port; no host, or {LOCAL}, is for senders on this machine, "
            "0.0.0.0 for those in all its networks"
        )
    from vip_factors.io.live_network import WebSocketSource

    return WebSocketSource(host or LOCAL, port, settings, token)


def read_token(path: Path | None = None) -> str:
    """The token in a file, or else in the environment variable VIP_FACTORS_TOKEN; empty without both.

    Raises:
        InputError: if the file is no text or empty.
        OSError: if it cannot be read.
    """
    if path is None:
        return os.environ.get(VARIABLE, "").strip()
    try:
        token = path.read_text(encoding="utf-8").strip()
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a text file: expected a token") from error
    if not token:
        raise InputError(
            f"{path}: it is empty: expected a token, such as python -c 'import secrets; "
            "print(secrets.token_urlsafe())' makes"
        )
    return token


class RecordingSource(LiveSource):
    """The samples of a scene in the order of their times.

    Played as fast as possible, nothing is dropped. In real time, a tracker that is too slow loses samples as it would
    from real sensors.

    Args:
        scene: to be played back.
        real_time: whether each sample comes when it is due.
        settings: as of every source.
    """

    def __init__(self, scene: Scene, real_time: bool = False, settings: LiveSourceSettings = DEFAULT) -> None:
        super().__init__(f"recording '{scene.name}'", settings, drops=real_time)
        self.is_played = not real_time
        self._scene = scene

    def _read(self) -> None:
        samples = live_samples(self._scene)
        self._queue.put(stream_head(self._scene))
        for sample in samples if self.is_played else when_due(samples, self._stop.wait):
            if self._stop.is_set():
                return
            self._queue.put(sample)


def when_due(samples: Iterable[LiveSample], wait: Callable[[float], object]) -> Iterator[LiveSample]:
    """Each sample when it is due, after the first."""
    begun: float | None = None
    for sample in samples:
        begun = time.monotonic() - sample.time if begun is None else begun
        wait(max(0.0, begun + sample.time - time.monotonic()))
        yield sample


class StandardInputSource(LiveSource):
    """Standard input; what comes through a pipe faster than it is tracked is dropped, a file waits."""

    def __init__(self, settings: LiveSourceSettings = DEFAULT) -> None:
        try:
            self._descriptor = sys.stdin.fileno()
            is_file = stat.S_ISREG(os.fstat(self._descriptor).st_mode)
        except (AttributeError, OSError, ValueError) as error:
            raise InputError("standard input is closed: expected a sender's live messages") from error
        if os.isatty(self._descriptor):
            raise InputError("standard input is a terminal: pipe a sender's live messages into it")
        super().__init__("standard input", settings, drops=not is_file)

    def _read(self) -> None:
        client = Client(Session(self._queue.put), self.name)
        reason = follow(client, io.BufferedReader(_Pipe(self._descriptor, self._may_read)))
        client.leave("" if self._stop.is_set() else reason)

    def _may_read(self) -> bool:
        """Return whether to read on, after a pause if the tracker is behind."""
        if self._queue.is_behind:
            self._stop.wait(PAUSE_S)
        return not self._stop.is_set()


class _Pipe(io.RawIOBase):
    """Raw input from a descriptor, read while ``may_read`` returns True."""

    def __init__(self, descriptor: int, may_read: Callable[[], bool]) -> None:
        self._descriptor, self._may_read = descriptor, may_read

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: "WriteableBuffer", /) -> int:
        view = memoryview(buffer)
        while self._may_read():
            if select.select([self._descriptor], [], [], POLL)[0]:
                data = os.read(self._descriptor, len(view))
                view[: len(data)] = data
                return len(data)
        return 0


def follow(client: Client, stream: BinaryIO) -> str:
    """Pass the messages of a delimited stream to a client; return why it ended, empty if between two messages."""
    try:
        for message in delimited_messages(stream):
            client.take(message)
    except OSError as error:
        return f"the connection was lost ({error.strerror or error})"
    except (FileFormatError, ClientError) as error:  # where the next message would begin is not known
        return str(error)
    return "" if client.has_header else "the stream ended before a header came"


def delimited_messages(stream: BinaryIO) -> Iterator[bytes]:
    """The messages of a delimited stream that is open for reading, each after its length as a varint.

    Raises:
        FileFormatError: for a length that no message has, or an end in the middle of a message.
    """
    while head := stream.read(1):
        while head[-1] >= 0x80 and len(head) < VARINT_BYTES:
            head += _read_whole(stream, 1)
        if head[-1] >= 0x80:
            raise FileFormatError("the bytes are no live messages: expected each after its length as a varint")
        length = sum((byte & 0x7F) << 7 * number for number, byte in enumerate(head))
        if length > LARGEST_MESSAGE:
            raise FileFormatError(
                f"a message of {length:,} bytes is announced: expected at most {LARGEST_MESSAGE:,}: the bytes are no "
                "live messages"
            )
        yield _read_whole(stream, length)


def _read_whole(stream: BinaryIO, size: int) -> bytes:
    data = stream.read(size)
    if len(data) < size:
        missing = size - len(data)
        raise FileFormatError(f"the stream ended in the middle of a message, at least {missing} bytes before its end")
    return data
