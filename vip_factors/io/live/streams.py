"""Live messages as a delimited stream of bytes: standard input, and TCP, from either side."""

import os
import select
import socket
import stat
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from ipaddress import ip_address
from threading import Event
from typing import TYPE_CHECKING, Any

from vip_factors.errors import FileFormatError, InputError
from vip_factors.io.live.messages import Deframer
from vip_factors.io.live.session import Client, ClientError, Pace, Session
from vip_factors.io.live.source import POLL, LiveSource
from vip_factors.io.settings import DEFAULT, LiveSourceSettings
from vip_factors.sensors.live import LiveFinding

if TYPE_CHECKING:
    from vip_factors.io.live.websocket import WebSocket

PIECE = 64 * 1024  # bytes at a time: what a pipe holds


def listen(
    client: Client,
    receive: Callable[[], bytes | None],
    settings: LiveSourceSettings,
    stop: Event,
    framing: "Deframer | WebSocket | None" = None,
    take: Callable[[Client, Any], None] = Client.take,
    may_be_late: bool = False,
    network: bool = True,
) -> str:
    """Follow one sender to its end; a clause about why it ended, empty if it did between two messages.

    Args:
        client: gets the messages.
        receive: the next bytes, none at the end of the stream, or None after :data:`POLL` seconds without any.
        settings: limits.
        stop: set when nothing more is wanted.
        framing: makes messages of the bytes; None: they are delimited.
        take: gives a client one of them.
        may_be_late: whether a header that does not come is told instead of ending it.
        network: whether the sender's pace is limited.
    """
    framing = framing or Deframer(settings.largest_message)
    pace = Pace(settings.largest_rate if network else float("inf"))
    whole = time.monotonic()  # when nothing of a message was pending
    begun, told = time.monotonic(), False
    while not stop.is_set():
        if not client.has_header and not told and time.monotonic() - begun > settings.header_wait:
            sentence = f"no header came within {settings.header_wait:g} s"
            if not may_be_late:
                return sentence
            told = True
            client.report("late", f"{sentence}; still waiting for it")
        if network and time.monotonic() - whole > settings.message_wait:
            return f"a message was not whole {settings.message_wait:g} s after its first byte"
        before = client.messages
        try:
            data = receive()
            if data is None:
                client.flush()
                whole = whole if framing.pending else time.monotonic()
                continue
            for message in framing.feed(data):  # which may answer, too
                take(client, message)
        except OSError as error:
            return f"the connection was lost ({error.strerror or error})"
        except (FileFormatError, ClientError) as error:
            return str(error)  # where the next message would begin is not known
        if not data or framing.ended:
            return framing.problem or ("" if client.has_header else "the stream ended before a header came")
        if not framing.pending or client.messages > before:
            whole = time.monotonic()
        wait = pace.take(client.messages - before)
        if wait:
            client.report("pace", f"it sends more than {settings.largest_rate:g} messages a second and has to wait")
            stop.wait(wait)
            whole += wait
    return ""


class StandardInputSource(LiveSource):
    """Standard input, or any other descriptor that a sender writes to.

    Args:
        settings, on_finding: as of every source.
        token: that the header must have; any if empty.
        descriptor: to read from instead; it stays open.
    """

    def __init__(
        self,
        settings: LiveSourceSettings = DEFAULT,
        on_finding: Callable[[LiveFinding], None] | None = None,
        descriptor: int | None = None,
        token: str = "",
    ) -> None:
        super().__init__("standard input", settings, drops=not _is_file(descriptor), on_finding=on_finding)
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
        self._pause()
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


LOCAL = "127.0.0.1"
BACKLOG = 8  # clients that wait unheard; the system refuses more
RETRY = 1.0  # seconds between two attempts to reach a sender that was lost
# A sender whose cable was pulled says nothing any more; the system asks after a while, and gives up.
KEEPALIVE = {"TCP_KEEPIDLE": 5, "TCP_KEEPINTVL": 2, "TCP_KEEPCNT": 3}  # seconds, seconds, times; by the system's names


def listening_socket(host: str, port: int, name: str) -> socket.socket:
    """A socket that listens; ``name`` is what it is called in sentences.

    Raises:
        InputError: if it cannot, because the port is in use or the address is none of this machine's.
    """
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        return socket.create_server((host, port), family=family, backlog=BACKLOG)
    except OSError as error:
        raise InputError(
            f"{name}: cannot listen there ({error.strerror or error}): choose another port, or a host of this "
            "machine: 127.0.0.1 for programs on it, 0.0.0.0 for all"
        ) from error


def is_local(host: str) -> bool:
    """Whether an address, or a name, is this machine's for itself alone."""
    try:
        return host == "localhost" or ip_address(host).is_loopback
    except ValueError:  # a name
        return False


class NetworkSource(LiveSource):
    """What the clients of a port, or a sender that listens, tell; one at a time.

    Args:
        host, port: to listen on, or of the sender; port 0 takes a free one, see :attr:`address`.
        settings, on_finding: as of every source.
        token: that headers must have; any if empty.
    """

    scheme: str

    def __init__(
        self,
        host: str,
        port: int,
        settings: LiveSourceSettings = DEFAULT,
        on_finding: Callable[[LiveFinding], None] | None = None,
        token: str = "",
    ) -> None:
        super().__init__(f"{self.scheme}://{host}:{port}", settings, on_finding=on_finding)
        self._where, self._token = (host, port), token
        self._session = Session(self._announce, self._put, token)
        self._listening: socket.socket | None = None

    @property
    def address(self) -> tuple[str, int]:
        """Host and port that are listened on, once open."""
        if self._listening is None:
            return self._where
        host, port = self._listening.getsockname()[:2]
        return host, port

    @property
    def listens(self) -> str:
        """Who can send, in words."""
        if self._listening is None:
            return ""
        host, port = self.address
        where = f"listening at {self.scheme}://{f'[{host}]' if ':' in host else host}:{port}"
        if is_local(host):
            return f"{where}, to senders on this machine alone"
        who = "whoever has the token" if self._token else "everybody: no token is asked for (--token-file)"
        networks = "all networks of this machine" if ip_address(host).is_unspecified else "the network of that address"
        return f"{where}, to senders in {networks}, that is {who}; nothing is encrypted"

    def _listen(self) -> socket.socket:
        """The socket that listens.

        Raises:
            InputError: if it cannot.
        """
        self._listening = listening_socket(*self._where, self.name)
        return self._listening


class TcpServerSource(NetworkSource):
    """Listens on a port; one client at a time, and the next when it has gone."""

    scheme = "tcp"

    def _open(self) -> None:
        self._listen().settimeout(POLL)

    def _read(self) -> None:
        assert self._listening is not None  # open
        gone: float | None = None  # when the last client that had a header went
        while not self._stop.is_set() and (gone is None or time.monotonic() - gone <= self._settings.next_client_wait):
            try:
                connection, peer = self._listening.accept()
            except TimeoutError:
                continue
            except OSError as error:  # closed by us, or a client that went before it was accepted
                self._stop.wait(0 if isinstance(error, ConnectionError) else POLL)
                continue
            client = Client(self._session, f"{self.name}, client {peer[0]}:{peer[1]}")
            with connection:
                reason = self._follow(client, connection)
            self._dismiss(client, reason)
            gone = time.monotonic() if client.has_header else gone

    def _follow(self, client: Client, connection: socket.socket) -> str:
        """A clause about why the client's stream ended; empty if it ended between two messages."""
        return listen(client, receiver(connection, self._pause), self._settings, self._stop)

    def _dismiss(self, client: Client, reason: str) -> None:
        """The last words about a client of a port, whose stream ended for a ``reason``, or without one."""
        more = self._settings.next_client_wait > 0 or not client.has_header
        awaits = "; waiting for the next client" if more else ""
        if reason:
            client.leave(f"{reason}; its connection is closed{awaits}")
        else:
            client.leave(f"it has left after {client.messages:,} messages{awaits}" if awaits else "")

    def _close(self) -> None:
        if self._listening is not None:
            self._listening.close()


class TcpSenderSource(NetworkSource):
    """Connects to a sender that listens; its end is the stream's, but a connection that breaks is made anew."""

    scheme = "tcp-connect"

    def _open(self) -> None:
        try:
            self._connection = socket.create_connection(self._where, timeout=self._settings.header_wait)
        except OSError as error:
            raise InputError(
                f"{self.name}: nobody answers there ({error.strerror or error}): start the sender first"
            ) from error

    def _read(self) -> None:
        connection: socket.socket | None = self._connection
        while connection is not None:
            client = Client(self._session, self.name)
            with connection:
                reason = listen(client, receiver(connection, self._pause), self._settings, self._stop)
            if not reason or self._stop.is_set():
                client.leave()
                return
            client.leave(f"{reason}; connecting anew")
            connection = self._again()

    def _again(self) -> socket.socket | None:
        begun = time.monotonic()
        while not self._stop.wait(RETRY) and time.monotonic() - begun <= self._settings.next_client_wait:
            try:
                return socket.create_connection(self._where, timeout=RETRY)
            except OSError:
                continue
        return None


def receiver(connection: socket.socket, pause: Callable[[], None]) -> Callable[[], bytes | None]:
    """How :func:`~vip_factors.io.live.streams.listen` gets the bytes of a connection, after a ``pause`` each time."""
    connection.settimeout(POLL)
    with suppress(OSError):  # macOS refuses it for a client that is already gone
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for option, value in KEEPALIVE.items():
            if hasattr(socket, option):
                connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)

    def receive() -> bytes | None:
        pause()
        try:
            return connection.recv(PIECE)
        except TimeoutError as error:
            if error.errno is not None:  # the system's own: the other side answers no more
                raise
            return None

    return receive
