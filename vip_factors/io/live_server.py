"""Server of a page and of a WebSocket with the answers as JSON, on one port.

It never waits for readers: a slow reader misses answers and continues with the newest.
"""

import base64
import hashlib
import re
import socket
import time
from collections import deque
from contextlib import suppress
from threading import Condition, Event, Lock

import msgspec

from vip_factors.io.live_json import JsonObject, LiveJsonEncoder
from vip_factors.io.live_network import GOING, LOCAL, ConnectionClosed, Listener, ServerConnection, cut_off
from vip_factors.io.live_source import POLL
from vip_factors.live_estimate import LiveEstimate
from vip_factors.sensors.scene import Scene

MOST_READERS = 16  # at once: each costs three threads, and its share of the sending
MOST_WAITING = 30  # answers, half a second: a reader that is further behind is to catch up, not to stay late
MOST_FINDINGS = 200  # that a reader who is behind gets later
SEND_BUFFER = 1 << 16  # bytes that the system may hold of each reader's: five answers, not the seconds it would take
STALLED_S = 10.0  # after which a reader who takes nothing is let go
MOST_REQUEST = 1 << 16  # bytes of what a reader sends
STREAM = "/stream"
ENDED = "the stream has ended"
NONE = "'none'"
INLINE = re.compile(r"<(script|style)(?![^>]*application/json)[^>]*>(.*?)</\1>", re.DOTALL)


class LiveServer:
    """Serves the answers of a stream. A context manager.

    ``/`` is the page, ``/stream`` a WebSocket with one answer a message. Programs and pages of this machine need no
    token unless one is given; pages of other sites always do.

    Args:
        setup: of the stream; None until :meth:`begin`.
        page: HTML.
        port: to listen on; 0 takes a free one.
        host: address to listen at.
        token: that readers must have; where others than this machine are served, one is made up if it is empty.

    Attributes:
        port: that is listened on.

    Raises:
        InputError: if it cannot listen there, or without the library for WebSocket.
    """

    def __init__(self, setup: Scene | None, page: str, port: int, host: str = LOCAL, token: str = "") -> None:
        self._encoder = None if setup is None else LiveJsonEncoder(setup)
        self._pages = {"/": (page, page_policy(page))}
        self._readers: set[_Reader] = set()
        self._changing = Lock()
        self._stop = Event()
        self._listener = Listener(
            f"live page at {host}:{port}",
            host,
            port,
            token,
            STREAM,
            talk=self._send,
            is_full=lambda: len(self._readers) >= MOST_READERS,
            pages=self._pages,
            largest=MOST_REQUEST,
        )
        self.port = self._listener.port

    def __enter__(self) -> "LiveServer":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def address(self) -> str:
        """Address of the page, with a generated token; a given one is not shown."""
        return self._listener.url("http")

    @property
    def listens(self) -> str:
        """Address and permitted readers of the page."""
        return f"the live page is at {self.address}, for {self._listener.audience}"

    def begin(self, setup: Scene, page: str) -> None:
        """Serve another page, and take answers of this stream from now on; who reads already gets them."""
        with self._changing:
            self._encoder = LiveJsonEncoder(setup)
            self._pages["/"] = page, page_policy(page)

    def write(self, estimate: LiveEstimate) -> None:
        """Hand the answer to one frame of a stream that has begun to all who read; it never waits for them."""
        with self._changing:
            if self._encoder is None:
                return
            if not self._readers or self._stop.is_set():
                self._encoder.note(estimate)
                return
            answer = self._encoder.answer(estimate)
            text = msgspec.json.encode(answer)
            for reader in self._readers:
                reader.put(answer, text)

    def close(self) -> None:
        """Send what waits, and close the port."""
        self._stop.set()
        self._listener.close()

    def _send(self, connection: ServerConnection) -> None:
        """Answers to one reader, in a thread of its own."""
        connection.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
        with self._changing:
            reader = _Reader(connection, [] if self._encoder is None else self._encoder.findings)
            self._readers.add(reader)
        try:
            with suppress(ConnectionClosed):
                while reader.send() or not self._stop.is_set():
                    pass
            connection.close(GOING, ENDED)
        finally:
            with self._changing:
                self._readers.discard(reader)


class _Reader:
    """Answers that wait for one reader.

    Args:
        connection: to the reader.
        findings: from before.
    """

    def __init__(self, connection: ServerConnection, findings: list[JsonObject]) -> None:
        self._connection = connection
        self._changed = Condition()
        self._waiting: deque[tuple[JsonObject, bytes]] = deque()
        self._missed: deque[JsonObject] = deque(findings, MOST_FINDINGS)  # of answers that were left out
        self._sending_since = float("inf")

    def put(self, answer: JsonObject, text: bytes) -> None:
        """Add an answer; too many that wait are left out, and a stalled reader is cut off."""
        with self._changed:
            if time.monotonic() - self._sending_since > STALLED_S:
                cut_off(self._connection)
            if len(self._waiting) >= MOST_WAITING:
                for left_out, _ in self._waiting:
                    self._missed.extend(left_out["findings"])
                self._waiting.clear()
            self._waiting.append((answer, text))
            self._changed.notify()

    def send(self) -> bool:
        """Send the next answer, with the findings of those that were left out; False after a while without one.

        Raises:
            ConnectionClosed: if the reader has gone.
        """
        with self._changed:
            if not self._changed.wait_for(lambda: bool(self._waiting), POLL):
                if self._connection.close_code is not None:
                    raise self._connection.protocol.close_exc
                return False
            answer, text = self._waiting.popleft()
            missed = [*self._missed]
            self._missed.clear()
            self._sending_since = time.monotonic()
        if missed:
            text = msgspec.json.encode(answer | {"findings": [*missed, *answer["findings"]]})
        self._connection.send(text, text=True)
        self._sending_since = float("inf")
        return True


def page_policy(html: str) -> str:
    """Content security policy of a page: its own scripts and styles, its own WebSocket, and nothing else."""
    hashes: dict[str, set[str]] = {"script": set(), "style": set()}
    for tag, content in INLINE.findall(html):
        digest = base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()
        hashes[tag].add(f"'sha256-{digest}'")
    inline = "; ".join(f"{tag}-src {' '.join(sorted(digests or {NONE}))}" for tag, digests in hashes.items())
    return (
        f"default-src 'none'; {inline}; connect-src 'self'; img-src data:; base-uri 'none'; form-action 'none'; "
        "frame-ancestors 'none'"
    )
