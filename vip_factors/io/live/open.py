"""A live source from what the user wrote, and a recording as one."""

import os
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from urllib.parse import urlsplit

from vip_factors.errors import InputError
from vip_factors.io.live.source import LiveSource
from vip_factors.io.live.standard_input import StandardInputSource
from vip_factors.io.settings import DEFAULT, LiveSourceSettings
from vip_factors.sensors.live import LiveFinding, LiveSample, live_samples, stream_head
from vip_factors.sensors.scene import Scene

VARIABLE = "VIP_FACTORS_TOKEN"


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

    As fast as it goes, nothing is dropped; in its own time, a tracker that is too slow loses samples, as it would
    lose those of real sensors.

    Args:
        scene: to be played back.
        real_time: whether each sample comes when it is due.
        settings, on_finding: as of every source.
    """

    def __init__(
        self,
        scene: Scene,
        real_time: bool = False,
        settings: LiveSourceSettings = DEFAULT,
        on_finding: Callable[[LiveFinding], None] | None = None,
    ) -> None:
        super().__init__(f"recording '{scene.name}'", settings, drops=real_time, on_finding=on_finding)
        self._scene = scene
        self._real_time = real_time

    @property
    def is_played(self) -> bool:
        """Whether samples come as fast as they can be tracked."""
        return not self._real_time

    def _read(self) -> None:
        samples = live_samples(self._scene)
        self._announce(stream_head(self._scene))
        for sample in when_due(samples, self._stop.wait) if self._real_time else samples:
            if self._stop.is_set():
                return
            self._put(sample)


def when_due(samples: Iterable[LiveSample], wait: Callable[[float], object]) -> Iterator[LiveSample]:
    """Each sample when it is due, after the first."""
    begun: float | None = None
    for sample in samples:
        begun = time.monotonic() - sample.time if begun is None else begun
        wait(max(0.0, begun + sample.time - time.monotonic()))
        yield sample


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
    """The source that a text names, to be entered as a context.

    Args:
        text: path of an MCAP file, ``-`` for standard input, or ``ws://host:port`` to listen there, without a host at
            127.0.0.1.
        follow: whether another program still writes the file.
        real_time: whether the file is played back in its own time.
        settings: limits.
        on_finding: gets the findings that come before the header, at once.
        token: that senders over the network must have; one is made up where other machines are listened to.

    Raises:
        InputError: for a text that names no source, options that do not belong to it, or a file that is no recording.
    """
    text = os.fspath(text)
    is_file = text != "-" and "://" not in text
    if (follow or real_time) and not is_file:
        raise InputError(f"{text}: following and playing back in real time are for MCAP files only")
    if follow and real_time:
        raise InputError(f"{text}: a file that is followed comes in its own time: choose following or real time")
    if text == "-":
        return StandardInputSource(settings, on_finding)
    if not is_file:
        return _network(text, settings, on_finding, token)
    if follow:
        from vip_factors.io.live.growing import GrowingFileSource

        return GrowingFileSource(text, settings, on_finding)
    from vip_factors.io.mcap_recording import read_scene

    return RecordingSource(read_scene(text), real_time, settings, on_finding)


def _network(
    text: str, settings: LiveSourceSettings, on_finding: Callable[[LiveFinding], None] | None, token: str
) -> LiveSource:
    try:
        url = urlsplit(text)
        host, port = url.hostname, url.port
    except ValueError as error:
        raise InputError(f"{text}: {error}: expected {EXPECTED}") from error
    if url.scheme != "ws" or url.path not in ("", "/") or url.query or url.fragment or url.username is not None:
        raise InputError(f"{text}: expected {EXPECTED}")
    if host and port is None and host.isdecimal() and int(host) < 1 << 16:  # ws://5005
        port, host = int(host), LOCAL
    if port is None:
        raise InputError(
            f"{text}: it names no port: expected ws://host:port; no host, or {LOCAL}, is for senders on this machine, "
            "0.0.0.0 for those in all its networks"
        )
    from vip_factors.io.live.websocket import WebSocketSource

    return WebSocketSource(host or LOCAL, port, settings, on_finding, token)
