"""A port for HTTP and WebSocket with access control, and live messages that come there.

A binary message of a sender is a serialised LiveMessage, a text the same as JSON. The library websockets provides
protocol and threads.
"""

import logging
import socket
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from hmac import compare_digest
from http import HTTPStatus
from ipaddress import ip_address
from secrets import token_urlsafe
from threading import Thread
from typing import Any
from urllib.parse import parse_qs, urlsplit

from vip_factors.errors import FileFormatError, InputError
from vip_factors.io.live_messages import LARGEST_MESSAGE, Client, ClientError, Session
from vip_factors.io.live_source import JOIN, POLL, LiveSource
from vip_factors.io.settings import DEFAULT, LiveSourceSettings

try:
    from websockets.datastructures import Headers
    from websockets.exceptions import ConnectionClosed as ConnectionClosed
    from websockets.http11 import Request, Response
    from websockets.sync.server import Server, serve
    from websockets.sync.server import ServerConnection as ServerConnection
except ImportError as error:
    raise InputError("the network needs the library websockets: pip install 'vip-factors[live]'") from error

LOCAL = "127.0.0.1"
GOING, REFUSED = 1001, 1008  # close codes: going away, policy violation
WRONG_TOKEN_S = 0.5  # that a wrong guess costs
REQUEST_WAIT_S = 5.0  # that a client may take for its request: a browser sends it at once
# A peer whose cable was pulled says nothing any more; the system asks after a while, and gives up.
KEEPALIVE = {"TCP_KEEPIDLE": 5, "TCP_KEEPINTVL": 2, "TCP_KEEPCNT": 3}  # seconds, seconds, times; by the system's names
LOGGER = logging.getLogger("vip_factors.websockets")
LOGGER.disabled = True  # findings report the problems
NOTHING = "default-src 'none'; frame-ancestors 'none'"

CLAIM_S = 1.0  # of samples, which the first answer needs anyway
MOST_SENDERS = 8  # connected at once; beyond, the one that has been silent longest makes room
REASON_BYTES = 120  # a close frame holds 123
HEADER_S = 10.0  # a program that has its header ready sends it at once; this forgives a slow start
SILENCE_S = 2.0  # a sender that was lost comes back sooner than its old connection is known to be dead
# Messages a second read from a sender, after the first second: three wearers of 17 sensors at 100 Hz send 5,100.
LARGEST_RATE = 10_000.0
SHORTEST_WAIT_S = 0.02  # a shorter one costs more than it spares


def is_local(host: str) -> bool:
    """Return whether an address or a name is of the loopback interface."""
    try:
        return host == "localhost" or ip_address(host).is_loopback
    except ValueError:  # a name
        return False


class Listener:
    """Listens on a port: pages over HTTP, and a WebSocket, in daemon threads.

    A request with the token is accepted. Without a token, programs and pages of this machine are accepted: requests
    from pages of other sites, or to another host name, are refused.

    Args:
        name: for sentences.
        host, port: to listen at; port 0 takes a free one.
        token: that clients must have; empty for none, but beyond this machine one is made up.
        path: of the WebSocket.
        talk: called in a thread of its own with each WebSocket; the connection is closed when it returns.
        is_full: returns whether no further WebSocket is accepted.
        pages: path → HTML and its content security policy.
        largest: bytes of a message from a client.

    Raises:
        InputError: if it cannot listen there.
    """

    def __init__(
        self,
        name: str,
        host: str,
        port: int,
        token: str,
        path: str,
        talk: Callable[[ServerConnection], None],
        is_full: Callable[[], bool],
        pages: Mapping[str, tuple[str, str]],
        largest: int,
    ) -> None:
        self._path, self._is_full, self._pages = path, is_full, pages
        listening = _listening_socket(host, port, name)
        self.host, self.port = listening.getsockname()[:2]
        self._is_token_made_up = not token and not is_local(self.host)
        self._token = token_urlsafe(16) if self._is_token_made_up else token
        self._server: Server = serve(
            talk,
            sock=listening,
            process_request=self._response,
            open_timeout=REQUEST_WAIT_S,
            close_timeout=JOIN,
            ping_interval=None,
            max_size=largest,
            compression=None,
            server_header=None,
            logger=LOGGER,
        )
        # Its threads are daemons as this one is: they do not keep a program from ending.
        self._thread = Thread(target=self._server.serve_forever, name=name, daemon=True)
        self._thread.start()

    def url(self, scheme: str) -> str:
        """Address for clients, with a generated token; a given one is not shown."""
        host = _outer_address() if ip_address(self.host).is_unspecified else self.host
        query = f"?token={self._token if self._is_token_made_up else '…'}" if self._token else ""
        return f"{scheme}://{f'[{host}]' if ':' in host else host}:{self.port}/{query}"

    @property
    def audience(self) -> str:
        """Description of the permitted clients."""
        if not is_local(self.host):
            return "whoever has the token; nothing is encrypted"
        return "whoever on this machine has the token" if self._token else "this machine alone"

    def close(self) -> None:
        """Close the port; connections that remain after a moment are cut off."""
        deadline = time.monotonic() + JOIN
        while (connections := self._server.connections) and time.monotonic() < deadline:
            time.sleep(POLL / 10)
        for connection in connections:
            cut_off(connection)
        closing = Thread(target=self._server.shutdown, daemon=True)  # waits for clients that have sent no request
        closing.start()
        closing.join(JOIN)
        self._thread.join(JOIN)

    def _response(self, connection: ServerConnection, request: Request) -> Response | None:
        """The answer to a request; None opens the WebSocket."""
        path, refusal = urlsplit(request.path).path, self._refusal(request)
        if refusal:
            time.sleep(WRONG_TOKEN_S)  # guessing is slow
            return _response(HTTPStatus.FORBIDDEN, f"{refusal}\n")
        if path == self._path:
            full = "as many as there is place for are connected already\n"
            return _response(HTTPStatus.SERVICE_UNAVAILABLE, full) if self._is_full() else None
        if path in self._pages:
            html, policy = self._pages[path]
            return _response(HTTPStatus.OK, html, "text/html", policy)
        return _response(HTTPStatus.NOT_FOUND, f"nothing is here; a WebSocket is at {self._path}\n")

    def _refusal(self, request: Request) -> str:
        """Return why a request is refused; empty if it is accepted."""
        try:
            query = parse_qs(urlsplit(request.path).query)
            host = urlsplit(f"//{request.headers.get('Host', '')}")
            name = host.hostname or ""
            origin, fetch_site = request.headers.get("Origin"), request.headers.get("Sec-Fetch-Site", "none")
            bearer = request.headers.get("Authorization", "").removeprefix("Bearer ")
        except (LookupError, ValueError):  # a header that comes twice, or that is none
            return "the request cannot be understood"
        if self._token:
            # In a time that does not depend on how much of it is right.
            if compare_digest(query.get("token", [bearer])[0].encode(), self._token.encode()):
                return ""
            return "a token is needed here: …/?token=…, or the header Authorization: Bearer …"
        is_foreign = origin is not None and urlsplit(origin).netloc != host.netloc
        if not is_local(name) or is_foreign or fetch_site not in ("none", "same-origin"):
            return "pages of other sites get nothing without a token (--token-file); open the address by itself"
        return ""


def cut_off(connection: ServerConnection) -> None:
    """End a connection at once, whatever waits in it."""
    with suppress(OSError):
        connection.socket.shutdown(socket.SHUT_RDWR)


class _ListeningSocket(socket.socket):
    """Socket that goes on accepting after errors such as too many open files, at which the library would stop."""

    def accept(self) -> tuple[socket.socket, Any]:
        while True:
            try:
                connection, peer = super().accept()
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
                for option, value in KEEPALIVE.items():
                    if hasattr(socket, option):
                        connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)
                return connection, peer
            except TimeoutError:
                pass
            except OSError:
                if self.fileno() < 0:  # closed
                    raise
                time.sleep(POLL)


def _listening_socket(host: str, port: int, name: str) -> _ListeningSocket:
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        listening = _ListeningSocket(fileno=socket.create_server((host, port), family=family).detach())
    except OSError as error:
        raise InputError(
            f"{name}: cannot listen there ({error.strerror or error}): choose another port, or a host of this "
            "machine: 127.0.0.1 for programs on it, 0.0.0.0 for all"
        ) from error
    listening.settimeout(POLL)
    return listening


def _response(status: HTTPStatus, text: str, kind: str = "text/plain", policy: str = NOTHING) -> Response:
    body = text.encode()
    headers = {
        "Content-Type": f"{kind}; charset=utf-8",
        "Content-Length": str(len(body)),
        "Content-Security-Policy": policy,
        "Cache-Control": "no-store",
        "Connection": "close",
        "Cross-Origin-Resource-Policy": "same-origin",
        "Referrer-Policy": "no-referrer",
        "X-Content-Type-Options": "nosniff",
        "X-Frame-Options": "DENY",  # browsers that do not know frame-ancestors
    }
    return Response(status.value, status.phrase, Headers(headers), body)


def _outer_address() -> str:
    """Address by which others may reach this machine."""
    with suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect(("192.0.2.1", 9))  # an address for documents: nothing is sent, the system chooses its own
        return str(probe.getsockname()[0])
    return socket.gethostname()


class WebSocketSource(LiveSource):
    """Source that listens on a port. One sender is received at a time; it gives way when it leaves or falls silent.

    The first sender of one second of samples owns the stream. A message that cannot be used is left out.

    Args:
        host, port: to listen at; port 0 takes a free one, see :attr:`url`.
        settings: as of every source.
        token: that senders must have, in the query of the address or as ``Authorization: Bearer …``; one is
            generated if other machines can connect.
    """

    def __init__(self, host: str, port: int, settings: LiveSourceSettings = DEFAULT, token: str = "") -> None:
        super().__init__(f"ws://{host}:{port}", settings)
        self._where, self._token = (host, port), token
        self._session = Session(self._queue.put, SILENCE_S)
        self._clients: dict[ServerConnection, Client] = {}
        self._gone = float("inf")  # when the last client that took part went

    @property
    def url(self) -> str:
        """Address for senders, once open, with a generated token."""
        return self._listener.url("ws")

    @property
    def awaits(self) -> str:
        """Description of the expected sender, without the token."""
        return f"a sender at {self.url.partition('?')[0]} (a header, then a second of samples of its sensors)"

    def _open(self) -> None:
        self._listener = Listener(
            self.name, *self._where, self._token, "/", self._receive, self._is_full, {}, LARGEST_MESSAGE
        )
        self.listens = f"listening at {self.url}, to {self._listener.audience}"

    def _read(self) -> None:
        while not self._stop.wait(POLL):
            takes_part = any(client.takes_part for client in list(self._clients.values()))
            wait = self._settings.next_client_wait
            if not takes_part and wait is not None and time.monotonic() - self._gone > wait:
                return

    def _close(self) -> None:
        self._listener.close()

    def _is_full(self) -> bool:
        clients = list(self._clients.items())
        if len(clients) < MOST_SENDERS:
            return False
        connection, client = min(clients, key=lambda entry: entry[1].received_at)
        if time.monotonic() - client.received_at < SILENCE_S:
            return True
        cut_off(connection)
        return False

    def _receive(self, connection: ServerConnection) -> None:
        """Receive one sender, in its own thread."""
        host, port = connection.remote_address[:2]
        client = Client(self._session, f"{self.name}, client {host}:{port}", CLAIM_S)
        self._clients[connection] = client
        try:
            reason = self._follow(client, connection)
        except Exception as error:  # nobody sees what a thread raises
            reason = f"{type(error).__name__}: {error}"
        is_last = self._settings.next_client_wait == 0 and client.takes_part
        awaits = "" if is_last else "; waiting for the next client"
        if reason:
            client.leave(f"{reason}; its connection is closed{awaits}")
        else:
            client.leave(f"it has left after {client.messages:,} messages{awaits}" if awaits else "")
        if client.takes_part:
            self._gone = time.monotonic()
        del self._clients[connection]
        connection.close(REFUSED if reason else GOING, reason.encode()[:REASON_BYTES].decode(errors="ignore"))

    def _follow(self, client: Client, connection: ServerConnection) -> str:
        """Take the messages of a sender; return why it ended, empty after a normal close."""
        due = -float("inf")  # when the messages until now would have come at the largest rate
        while not self._stop.is_set():
            try:
                data = connection.recv(POLL)
                while client.is_to_wait:
                    if self._stop.wait(POLL):
                        return ""
                client.take(data)
            except TimeoutError:
                if not client.has_header and time.monotonic() - client.received_at > HEADER_S:
                    return f"no header came within {HEADER_S:g} s"
                continue
            except FileFormatError as error:
                client.report("text" if isinstance(data, str) else "no message", f"a message is left out: {error}")
            except ClientError as error:
                return str(error)
            except ConnectionClosed as error:
                return _problem(error)
            now = time.monotonic()
            due = max(due, now - 1.0) + 1 / LARGEST_RATE
            if due - now >= SHORTEST_WAIT_S:
                client.report("pace", f"it sends more than {LARGEST_RATE:g} messages a second and has to wait")
                self._stop.wait(due - now)
        return ""


def _problem(error: ConnectionClosed) -> str:
    """Return why a connection ended; empty after a normal close."""
    if error.sent is not None and error.sent.code == 1009:
        return f"a message was larger than {LARGEST_MESSAGE:,} bytes: it is no live message"
    if error.rcvd is not None and error.rcvd.code in (1000, 1001, 1005):
        return ""
    return f"the connection was lost ({error})"
