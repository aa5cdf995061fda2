"""Answers for browsers and for programs: a page, WebSocket and lines of JSON, all on one port.

Nobody who reads holds the tracker up: whoever is too slow misses answers, and goes on with the newest.
"""

import select
import socket
import time
from collections import deque
from contextlib import suppress
from hmac import compare_digest
from http import HTTPStatus
from secrets import token_urlsafe
from threading import Condition, Event, Lock, Thread
from typing import TYPE_CHECKING
from urllib.parse import parse_qs, urlsplit

from vip_factors.io.live.session import WRONG_TOKEN_S
from vip_factors.io.live.source import JOIN, POLL
from vip_factors.io.live.streams import LOCAL, PIECE, is_local, listening_socket
from vip_factors.io.live.websocket import WebSocket, check_websockets
from vip_factors.io.live_json import FindingAnswer, LiveJsonEncoder, as_text
from vip_factors.live_estimate import LiveEstimate
from vip_factors.sensors.scene import Scene

if TYPE_CHECKING:
    from websockets.http11 import Request

MOST_READERS = 16  # at once: each costs a thread, and its share of the sending
MOST_WAITING = 30  # answers, half a second: a reader that is further behind is to catch up, not to stay late
MOST_FINDINGS = 200  # that a reader who is behind gets later
SEND_BUFFER = 1 << 16  # bytes that the system may hold of each reader's: five answers, not the seconds it would take
REQUEST_WAIT_S = 5.0  # that a client may take for its request: a browser sends it at once
STALLED_S = 10.0  # after which a reader who takes nothing is let go
MOST_REQUEST = 1 << 16  # bytes of what a reader sends
STREAM, LINES = "/stream", "/lines"
ENDED = "the stream has ended"


class LiveServer:
    """Serves the answers of a stream. A context manager.

    ``/`` is the page, ``/stream`` a WebSocket with an answer a message, ``/lines`` the same as lines over HTTP. Readers
    on this machine need no token, but pages of other sites do, which a browser may show as well: they could read along.

    Args:
        setup: of the stream.
        page: HTML.
        port: to listen on; 0 takes a free one.
        host: address to listen at.
        token: that readers beyond this machine must have; one is made up if it is empty.

    Attributes:
        port: that is listened on.

    Raises:
        InputError: if it cannot listen there, or without the library for WebSocket.
    """

    def __init__(self, setup: Scene, page: str, port: int, host: str = LOCAL, token: str = "") -> None:
        name = f"live page at {host}:{port}"
        check_websockets(name)
        self._page = page
        self._encoder = LiveJsonEncoder(setup)
        self._listening = listening_socket(host, port, name)
        self._listening.settimeout(POLL)
        self._host, self.port = self._listening.getsockname()[:2]
        self._is_local, self._made_up = is_local(host), not token
        self._token = token or token_urlsafe(16)
        self._readers: set[_Reader] = set()
        self._connections: set[Thread] = set()
        self._changing = Lock()
        self._stop = Event()
        self._accepting = Thread(target=self._accept, name=name, daemon=True)
        self._accepting.start()

    def __enter__(self) -> "LiveServer":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def address(self) -> str:
        """Of the page, with a token that was made up; one that was given is not told."""
        host = _own_address() if self._host in ("0.0.0.0", "::") else self._host
        token = "" if self._is_local else f"?token={self._token if self._made_up else '…'}"
        return f"http://{f'[{host}]' if ':' in host else host}:{self.port}/{token}"

    @property
    def listens(self) -> str:
        """Where the page is and for whom, in words."""
        who = "this machine alone" if self._is_local else "whoever has the token; nothing is encrypted"
        return f"the live page is at {self.address}, for {who}"

    def write(self, estimate: LiveEstimate) -> None:
        """Hand the answer to one frame to all who read; it never waits for them."""
        with self._changing:
            if not self._readers or self._stop.is_set():
                self._encoder.note(estimate)
                return
            answer, findings = self._encoder.encode(estimate)
            for reader in self._readers:
                reader.put(answer, findings)

    def close(self) -> None:
        """Send what waits, say goodbye, and let go of the port."""
        self._stop.set()
        self._accepting.join(JOIN)
        self._listening.close()
        until = time.monotonic() + JOIN
        for thread in list(self._connections):
            thread.join(max(0.0, until - time.monotonic()))

    def _accept(self) -> None:
        while not self._stop.is_set():
            try:
                connection, _ = self._listening.accept()
            except OSError as error:
                self._stop.wait(0 if isinstance(error, TimeoutError | ConnectionError) else POLL)
                continue
            self._connections = {one for one in self._connections if one.is_alive()}
            if len(self._connections) >= MOST_READERS:
                connection.close()
                continue
            thread = Thread(target=self._serve, args=(connection,), name="reader of answers", daemon=True)
            self._connections.add(thread)
            thread.start()

    def _serve(self, connection: socket.socket) -> None:
        """One client, in a thread of its own."""
        with connection, suppress(OSError, EOFError):  # it has gone, or takes nothing
            web = WebSocket(connection, MOST_REQUEST)
            request = _request(connection, web)
            if request is None:
                return
            path, refusal = urlsplit(request.path).path, self._refusal(request)
            if refusal:
                time.sleep(WRONG_TOKEN_S)  # guessing is slow
                _respond(connection, HTTPStatus.FORBIDDEN, "text/plain", f"{refusal}\n")
            elif path == "/":
                _respond(connection, HTTPStatus.OK, "text/html", self._page)
            elif path in (STREAM, LINES):
                self._send(connection, web, request if path == STREAM else None)
            else:
                found = f"nothing is here: the page is at /, WebSocket at {STREAM}, lines of JSON at {LINES}\n"
                _respond(connection, HTTPStatus.NOT_FOUND, "text/plain", found)

    def _send(self, connection: socket.socket, web: WebSocket, upgrade: "Request | None") -> None:
        """Answers until somebody ends it: over WebSocket, or without an ``upgrade`` as lines."""
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.settimeout(STALLED_S)
        if upgrade is not None:
            web.accept(upgrade)
        else:
            _respond(connection, HTTPStatus.OK, "application/x-ndjson", None)
        with self._changing:
            reader = _Reader(self._encoder.findings)
            self._readers.add(reader)
        try:
            while not web.ended:
                text = reader.get()
                if text is None and self._stop.is_set():
                    web.close(reason=ENDED)
                    return
                if select.select([connection], [], [], 0)[0]:
                    data = connection.recv(PIECE)
                    if upgrade is not None:
                        list(web.events(data))  # which answers pings
                    elif not data:
                        return
                if text is not None and upgrade is None:
                    connection.sendall(f"{text}\n".encode())
                elif text is not None and not web.ended:
                    web.send(text)
        finally:
            with self._changing:
                self._readers.discard(reader)

    def _refusal(self, request: "Request") -> str:
        """Why a client gets nothing; empty if it does."""
        try:
            url, host = urlsplit(request.path), urlsplit(f"//{request.headers.get('Host', '')}")
            origin = request.headers.get("Origin")
            bearer = request.headers.get("Authorization", "").removeprefix("Bearer ")
            name = host.hostname or ""
        except (LookupError, ValueError):  # a header that comes twice, or that is none
            return "the request cannot be understood"
        token = parse_qs(url.query).get("token", [bearer])[0]
        if compare_digest(token.encode(), self._token.encode()):
            return ""
        if not self._is_local:
            return "a token is needed here: http://…/?token=…, or the header Authorization: Bearer …"
        # A site may have given itself a name that leads to this machine.
        if not is_local(name) or (origin is not None and urlsplit(origin).netloc != host.netloc):
            return "pages of other sites get nothing without a token"
        return ""


class _Reader:
    """Answers that wait for one who reads.

    Args:
        findings: from before.
    """

    def __init__(self, findings: list[FindingAnswer]) -> None:
        self._changed = Condition()
        self._waiting: deque[tuple[str, list[FindingAnswer]]] = deque()
        self._missed: deque[FindingAnswer] = deque(findings, MOST_FINDINGS)  # of answers that were left out

    def put(self, answer: str, findings: list[FindingAnswer]) -> None:
        """One more; those that wait are left out if they are too many."""
        with self._changed:
            if len(self._waiting) >= MOST_WAITING:
                for _, left_out in self._waiting:
                    self._missed.extend(left_out)
                self._waiting.clear()
            self._waiting.append((answer, findings))
            self._changed.notify()

    def get(self) -> str | None:
        """The next one as text, with the findings of those that were left out; None after a while without one."""
        with self._changed:
            if not self._changed.wait_for(lambda: bool(self._waiting), POLL):
                return None
            answer, findings = self._waiting.popleft()
            missed = list(self._missed)
            self._missed.clear()
        return as_text(answer, [*missed, *findings])


def _request(connection: socket.socket, web: WebSocket) -> "Request | None":
    """What a client asks for; None if that is nothing."""
    until = time.monotonic() + REQUEST_WAIT_S
    while not web.ended and (left := until - time.monotonic()) > 0:
        connection.settimeout(left)
        data = connection.recv(PIECE)
        for event in web.events(data):
            return event if not isinstance(event, bytes | str) else None
        if not data:
            break
    return None


def _respond(connection: socket.socket, status: HTTPStatus, kind: str, text: str | None) -> None:
    """An answer over HTTP; without a text its head alone, and what follows ends with the connection."""
    body = (text or "").encode()
    head = [
        f"HTTP/1.1 {status.value} {status.phrase}", f"Content-Type: {kind}; charset=utf-8", "Cache-Control: no-store",
        "X-Content-Type-Options: nosniff", "Referrer-Policy: no-referrer", "Connection: close",
    ]  # fmt: skip
    if text is not None:
        head.append(f"Content-Length: {len(body)}")
    connection.sendall("\r\n".join([*head, "", ""]).encode() + body)


def _own_address() -> str:
    """By which others may reach this machine."""
    with suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect(("192.0.2.1", 9))  # an address for documents: nothing is sent, the system chooses its own
        return str(probe.getsockname()[0])
    return socket.gethostname()
