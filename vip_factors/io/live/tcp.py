"""Live messages over TCP: from senders that connect to us, or from one that we connect to."""

import socket
import time
from collections.abc import Callable
from contextlib import suppress
from ipaddress import ip_address

from vip_factors.errors import InputError
from vip_factors.io.live.byte_stream import PIECE, listen
from vip_factors.io.live.session import Client, Session
from vip_factors.io.live.settings import DEFAULT, LiveSourceSettings
from vip_factors.io.live.source import POLL, LiveSource
from vip_factors.sensors.live import LiveFinding

BACKLOG = 8  # clients that wait unheard; the system refuses more
RETRY = 1.0  # seconds between two attempts to reach a sender that was lost
# A sender whose cable was pulled says nothing any more; the system asks after a while, and gives up.
KEEPALIVE = {"TCP_KEEPIDLE": 5, "TCP_KEEPINTVL": 2, "TCP_KEEPCNT": 3}  # seconds, seconds, times; by the system's names


class TcpServerSource(LiveSource):
    """Listens on a port; one client at a time, and the next when it has gone.

    Args:
        host, port: to listen on; port 0 takes a free one, see :attr:`address`.
        settings, tell: as of every source.
        token: that headers must have; any if empty.
    """

    def __init__(
        self,
        host: str,
        port: int,
        settings: LiveSourceSettings = DEFAULT,
        tell: Callable[[LiveFinding], None] | None = None,
        token: str = "",
    ) -> None:
        super().__init__(f"tcp://{host}:{port}", settings, tell=tell)
        self._where = host, port
        self._token = token
        self._server: socket.socket | None = None

    @property
    def address(self) -> tuple[str, int]:
        """Host and port that are listened on, once open."""
        if self._server is None:
            return self._where
        host, port = self._server.getsockname()[:2]
        return host, port

    @property
    def listens(self) -> str:
        """Who can send, in words."""
        return listens("tcp", self.address, self._token)

    def _open(self) -> None:
        self._server = listening(self.name, *self._where)
        self._server.settimeout(POLL)

    def _read(self) -> None:
        session = Session(self._announce, self._put, self._token)
        gone: float | None = None  # when the last client that had a header went
        while not self._stop.is_set() and (gone is None or time.monotonic() - gone <= self._settings.next_client_wait):
            accepted = self._accept()
            if accepted is not None and self._serve(session, *accepted):
                gone = time.monotonic()

    def _close(self) -> None:
        if self._server is not None:
            self._server.close()

    def _accept(self) -> tuple[socket.socket, str] | None:
        assert self._server is not None  # open
        try:
            connection, peer = self._server.accept()
        except TimeoutError:
            return None
        except OSError as error:  # closed by us, or a client that went before it was accepted
            self._stop.wait(0 if isinstance(error, ConnectionError) else POLL)
            return None
        return connection, f"{self.name}, client {peer[0]}:{peer[1]}"

    def _serve(self, session: Session, connection: socket.socket, name: str) -> bool:
        """Follow one client; whether it had sent its header."""
        client = Client(session, name)
        with connection:
            reason = listen(client, receiver(connection), self._settings, self._stop)
        more = self._settings.next_client_wait > 0 or not client.has_header
        awaits = "; waiting for the next client" if more else ""
        if reason:
            client.leave(f"{reason}; its connection is closed{awaits}")
        else:
            client.leave(f"it has left after {client.messages:,} messages{awaits}" if awaits else "")
        return client.has_header


class TcpSenderSource(LiveSource):
    """Connects to a sender that listens; its end is the stream's, but a connection that breaks is made anew.

    Args:
        host, port: of the sender.
        settings, tell: as of every source.
        token: that headers must have; any if empty.
    """

    def __init__(
        self,
        host: str,
        port: int,
        settings: LiveSourceSettings = DEFAULT,
        tell: Callable[[LiveFinding], None] | None = None,
        token: str = "",
    ) -> None:
        super().__init__(f"tcp-connect://{host}:{port}", settings, tell=tell)
        self._where = host, port
        self._token = token
        self._connection: socket.socket | None = None

    def _open(self) -> None:
        try:
            self._connection = socket.create_connection(self._where, timeout=self._settings.header_wait)
        except OSError as error:
            raise InputError(
                f"{self.name}: nobody answers there ({error.strerror or error}): start the sender first"
            ) from error

    def _read(self) -> None:
        session = Session(self._announce, self._put, self._token)
        while self._connection is not None:
            client = Client(session, self.name)
            with self._connection as connection:
                reason = listen(client, receiver(connection), self._settings, self._stop)
            if not reason or self._stop.is_set():
                client.leave()
                return
            client.leave(f"{reason}; connecting anew")
            self._connection = self._again()

    def _again(self) -> socket.socket | None:
        begun = time.monotonic()
        while not self._stop.wait(RETRY) and time.monotonic() - begun <= self._settings.next_client_wait:
            try:
                return socket.create_connection(self._where, timeout=RETRY)
            except OSError:
                continue
        return None


def listening(name: str, host: str, port: int) -> socket.socket:
    """A socket that listens.

    Raises:
        InputError: if it cannot, because the port is in use or the address is none of this machine's.
    """
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        return socket.create_server((host, port), family=family, backlog=BACKLOG)
    except OSError as error:
        raise InputError(
            f"{name}: cannot listen there ({error.strerror or error}): choose another port, or a host of this machine: "
            "127.0.0.1 for senders on it, 0.0.0.0 for all"
        ) from error


def listens(scheme: str, address: tuple[str, int], token: str) -> str:
    """Who can send to an address, in words."""
    host, port = address
    where = f"listening at {scheme}://[{host}]:{port}" if ":" in host else f"listening at {scheme}://{host}:{port}"
    if host == "localhost" or ip_address(host).is_loopback:
        return f"{where}, to senders on this machine alone"
    who = "whoever has the token" if token else "everybody: no token is asked for (--token-file)"
    networks = "all networks of this machine" if ip_address(host).is_unspecified else "the network of that address"
    return f"{where}, to senders in {networks}, that is {who}; nothing is encrypted"


def receiver(connection: socket.socket) -> Callable[[], bytes | None]:
    """How :func:`~vip_factors.io.live.byte_stream.listen` gets the bytes of a connection."""
    connection.settimeout(POLL)
    with suppress(OSError):  # macOS refuses it for a client that is already gone
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for option, value in KEEPALIVE.items():
            if hasattr(socket, option):
                connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)

    def receive() -> bytes | None:
        try:
            return connection.recv(PIECE)
        except TimeoutError as error:
            if error.errno is not None:  # the system's own: the other side answers no more
                raise
            return None

    return receive
