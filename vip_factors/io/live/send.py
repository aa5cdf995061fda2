"""A scene as the live messages that a sender would send."""

import time
from collections import Counter
from collections.abc import Iterator
from typing import Protocol

from vip_factors.io.live.framing import delimited
from vip_factors.io.live.header import header_message
from vip_factors.io.live.samples import sample_message
from vip_factors.sensors.live import LiveSetup, VideoFrame, live_samples
from vip_factors.sensors.scene import Scene


class ByteSink(Protocol):
    """Where bytes go: an open binary file, a pipe, or a socket's ``makefile("wb")``."""

    def write(self, data: bytes, /) -> object:
        """All of the bytes."""

    def flush(self) -> object:
        """Send what was written."""


def live_messages(scene: Scene, speed: float | None = None, token: str = "") -> Iterator[bytes]:
    """The header and then every sample, serialised.

    Args:
        scene: with the samples.
        speed: each sample comes when it is due, at this multiple of its own time; None: as fast as it goes.
        token: for the header.
    """
    setup = LiveSetup.of(scene)
    yield header_message(setup, token).SerializeToString()
    frames: Counter[str] = Counter()
    begun, first = time.monotonic(), None
    for sample in live_samples(scene):
        if speed is not None:
            first = sample.time if first is None else first
            time.sleep(max(0.0, begun + (sample.time - first) / speed - time.monotonic()))
        number = 0
        if isinstance(sample, VideoFrame):
            number = frames[sample.camera]
            frames[sample.camera] += 1
        yield sample_message(sample, setup.start_ns, number).SerializeToString()


def write_messages(scene: Scene, stream: ByteSink, speed: float | None = None, token: str = "") -> int:
    """Send a scene as a delimited stream; how many messages that were.

    Args:
        scene: to be sent.
        stream: that a live source reads at its other end.
        speed, token: as in :func:`live_messages`.
    """
    count = 0
    for message in live_messages(scene, speed, token):
        count += 1
        stream.write(delimited(message))
        if speed is not None:
            stream.flush()
    stream.flush()
    return count
