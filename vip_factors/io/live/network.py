"""A port for HTTP and WebSocket with access control; websockets provides protocol and threads."""

import logging
import socket
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from hmac import compare_digest
from http import HTTPStatus
from ipaddress import ip_address
from secrets import token_urlsafe
from threading import Thread
from typing import Any
from urllib.parse import parse_qs, urlsplit

from vip_factors.errors import InputError
from vip_factors.io.live.source import JOIN, POLL

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
NOTHING = "default-src 'none'; frame-ancestors 'none'"


def is_local(host: str) -> bool:
    """Return whether an address or a name is of the loopback interface."""
    try:
        return host == "localhost" or ip_address(host).is_loopback
    except ValueError:  # a name
        return False


class Gate:
    """Access control of requests.

    A request with the token is accepted. Without a token, programs and pages of this machine are accepted: requests
    from pages of other sites, or to another host name, are refused.

    Args:
        host: that is listened at; beyond this machine a token is made up if there is none.
        token: a secret; empty for none.

    Attributes:
        token: the secret, or an empty text.
        is_made_up: whether it was generated here, and must be printed.
    """

    def __init__(self, host: str, token: str) -> None:
        self.is_made_up = not token and not is_local(host)
        self.token = token_urlsafe(16) if self.is_made_up else token

    def refusal(self, request: Request) -> str:
        """Return why a request is refused; empty if it is accepted."""
        try:
            query = parse_qs(urlsplit(request.path).query)
            host = urlsplit(f"//{request.headers.get('Host', '')}")
            name = host.hostname or ""
            origin, fetch_site = request.headers.get("Origin"), request.headers.get("Sec-Fetch-Site", "none")
            bearer = request.headers.get("Authorization", "").removeprefix("Bearer ")
        except (LookupError, ValueError):  # a header that comes twice, or that is none
            return "the request cannot be understood"
        if self.token:
            # In a time that does not depend on how much of it is right.
            if compare_digest(query.get("token", [bearer])[0].encode(), self.token.encode()):
                return ""
            return "a token is needed here: …/?token=…, or the header Authorization: Bearer …"
        is_foreign = origin is not None and urlsplit(origin).netloc != host.netloc
        if not is_local(name) or is_foreign or fetch_site not in ("none", "same-origin"):
            return "pages of other sites get nothing without a token (--token-file); open the address by itself"
        return ""


@dataclass(frozen=True)
class Page:
    """Answer to a request.

    Attributes:
        html: the page.
        policy: its content security policy.
    """

    html: str
    policy: str


class Listener:
    """Listens on a port: pages over HTTP, and a WebSocket, in daemon threads.

    Args:
        name: for sentences.
        host, port: to listen at; port 0 takes a free one.
        token: that clients must have (see :class:`Gate`).
        path: of the WebSocket.
        talk: called in a thread of its own with each WebSocket; the connection is closed when it returns.
        is_full: returns whether no further WebSocket is accepted.
        pages: path → page.
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
        pages: Mapping[str, Page],
        largest: int,
    ) -> None:
        self._path, self._is_full, self._pages = path, is_full, pages
        listening = _listening_socket(host, port, name)
        self.host, self.port = listening.getsockname()[:2]
        self.gate = Gate(self.host, token)
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
            logger=_silent_logger(),
        )
        # Its threads are daemons as this one is: they do not keep a program from ending.
        self._thread = Thread(target=self._server.serve_forever, name=name, daemon=True)
        self._thread.start()

    def url(self, scheme: str) -> str:
        """Address for clients, with a generated token; a given one is not shown."""
        host = _outer_address() if ip_address(self.host).is_unspecified else self.host
        shown = self.gate.token if self.gate.is_made_up else "…"
        query = f"?token={shown}" if self.gate.token else ""
        return f"{scheme}://{f'[{host}]' if ':' in host else host}:{self.port}/{query}"

    @property
    def audience(self) -> str:
        """Description of the permitted clients."""
        if not is_local(self.host):
            return "whoever has the token; nothing is encrypted"
        return "whoever on this machine has the token" if self.gate.token else "this machine alone"

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
        path, refusal = urlsplit(request.path).path, self.gate.refusal(request)
        if refusal:
            time.sleep(WRONG_TOKEN_S)  # guessing is slow
            return _response(HTTPStatus.FORBIDDEN, f"{refusal}\n")
        if path == self._path:
            full = "as many as there is place for are connected already\n"
            return _response(HTTPStatus.SERVICE_UNAVAILABLE, full) if self._is_full() else None
        if path in self._pages:
            return _response(HTTPStatus.OK, self._pages[path].html, "text/html", self._pages[path].policy)
        return _response(HTTPStatus.NOT_FOUND, f"nothing is here; a WebSocket is at {self._path}\n")


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


def _silent_logger() -> logging.Logger:
    """Logger that discards: findings report the problems."""
    logger = logging.getLogger("vip_factors.websockets")
    logger.addHandler(logging.NullHandler())
    logger.propagate = False
    return logger


def _outer_address() -> str:
    """Address by which others may reach this machine."""
    with suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect(("192.0.2.1", 9))  # an address for documents: nothing is sent, the system chooses its own
        return str(probe.getsockname()[0])
    return socket.gethostname()
