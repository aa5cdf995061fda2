"""A live source from what the user wrote."""

import os
from collections.abc import Callable
from urllib.parse import urlsplit

from vip_factors.errors import InputError
from vip_factors.io.live.byte_stream import StandardInputSource
from vip_factors.io.live.recording import RecordingSource
from vip_factors.io.live.settings import DEFAULT, LiveSourceSettings
from vip_factors.io.live.source import LiveSource
from vip_factors.io.live.tcp import TcpSenderSource, TcpServerSource
from vip_factors.io.live.websocket import WebSocketSource
from vip_factors.sensors.live import LiveFinding

LOCAL = "127.0.0.1"
EXPECTED = (
    "an MCAP file, - for standard input, tcp://:port or ws://:port to listen at 127.0.0.1, tcp://host:port or "
    "ws://host:port to listen elsewhere, or "
    "tcp-connect://host:port to connect to a sender"
)


def open_source(
    text: str | os.PathLike[str],
    follow: bool = False,
    real_time: bool = False,
    speed: float = 1.0,
    settings: LiveSourceSettings = DEFAULT,
    tell: Callable[[LiveFinding], None] | None = None,
    token: str = "",
) -> LiveSource:
    """The source that a text names, to be entered as a context.

    Args:
        text: path of an MCAP file, ``-``, ``tcp://host:port``, ``tcp-connect://host:port`` or ``ws://host:port``;
            to listen, without a host, is at 127.0.0.1.
        follow: whether another program still writes the file.
        real_time: whether the file is played back in its own time.
        speed: multiple of its own time.
        settings: limits.
        tell: gets the findings that come before the header, at once.
        token: that the header of a sender must have; any if empty.

    Raises:
        InputError: for a text that names no source, options that do not belong to it, or a file that is no recording.
    """
    text = os.fspath(text)
    is_file = text != "-" and "://" not in text
    if (follow or real_time or speed != 1.0) and not is_file:
        raise InputError(f"{text}: following and playing back in real time are for MCAP files only")
    if follow and (real_time or speed != 1.0):
        raise InputError(f"{text}: a file that is followed comes in its own time: choose following or real time")
    if text == "-":
        return StandardInputSource(settings, tell, token=token)
    if not is_file:
        return _network(text, settings, tell, token)
    if speed != 1.0 and not real_time:
        raise InputError(f"{text}: a speed is for playing back in real time: ask for that too")
    if follow:
        from vip_factors.io.live.growing import GrowingFileSource

        return GrowingFileSource(text, settings, tell)
    from vip_factors.io.mcap_recording import read_scene

    return RecordingSource(read_scene(text), real_time, speed, settings, tell)


def _network(
    text: str, settings: LiveSourceSettings, tell: Callable[[LiveFinding], None] | None, token: str
) -> LiveSource:
    kinds: dict[str, type[TcpServerSource | TcpSenderSource | WebSocketSource]] = {
        "tcp": TcpServerSource,
        "tcp-connect": TcpSenderSource,
        "ws": WebSocketSource,
    }
    try:
        url = urlsplit(text)
        host, port = url.hostname, url.port
    except ValueError as error:
        raise InputError(f"{text}: {error}: expected {EXPECTED}") from error
    if url.scheme not in kinds or url.path not in ("", "/") or url.query or url.fragment or url.username is not None:
        raise InputError(f"{text}: expected {EXPECTED}")
    if url.scheme != "tcp-connect":
        if host and port is None and host.isdecimal() and int(host) < 1 << 16:  # tcp://5005
            port, host = int(host), LOCAL
        host = host or LOCAL
    if not host or port is None:
        missing = "port" if host else "host"
        raise InputError(
            f"{text}: it names no {missing}: expected {url.scheme}://host:port; to listen, no host, or "
            "127.0.0.1, is for senders on this machine, 0.0.0.0 for those in all its networks"
        )
    return kinds[url.scheme](host, port, settings, tell, token)
