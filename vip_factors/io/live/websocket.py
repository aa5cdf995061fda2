"""Live messages over WebSocket: one binary message is one LiveMessage."""

import logging
import socket
import time
from contextlib import suppress
from threading import Lock, Thread
from typing import TYPE_CHECKING, Any

from vip_factors.errors import FileFormatError, InputError
from vip_factors.io.live.session import Client, ClientError, Pace
from vip_factors.io.live.source import POLL
from vip_factors.io.live.streams import NetworkSource

if TYPE_CHECKING:
    from websockets.sync.server import Server, ServerConnection

GRACE = 1.0  # seconds for the connection before to end: a client that comes back may be quicker than its old one
CLOSE_WAIT = 1.0  # seconds that a client may take to say goodbye
BUSY, REFUSED, TOO_LARGE = 1013, 1008, 1009  # close codes: try again later, policy violation, message too big
REASON_BYTES = 120  # a close frame holds 123


class WebSocketSource(NetworkSource):
    """Listens on a port; one client at a time, and the next when it has gone.

    A message that cannot be used is left out; its end is known, so the ones after it are read on.
    """

    scheme = "ws"

    def _open(self) -> None:
        try:
            from websockets.sync.server import serve
        except ImportError as error:
            raise InputError(f"{self.name}: needs the library websockets: pip install 'vip-factors[live]'") from error
        self._busy = Lock()
        self._gone: float | None = None  # when the last client that had a header went
        self._failure: Exception | None = None
        self._opening: set[ServerConnection] = set()
        self._server: Server = serve(
            self._serve,
            sock=self._listen(),
            compression=None,  # numbers of sensors hardly shrink, and the thread must stay cheap
            open_timeout=self._settings.header_wait,
            close_timeout=CLOSE_WAIT,
            max_size=self._settings.largest_message,
            create_connection=self._connection_class(),
            logger=_silent_logger(),
        )

    def _read(self) -> None:
        accepting = Thread(target=self._server.serve_forever, name=f"{self.name}, connections", daemon=True)
        accepting.start()
        try:
            while not self._stop.wait(POLL) and self._failure is None:
                gone = self._gone
                if gone is not None and time.monotonic() - gone > self._settings.next_client_wait:
                    break
        finally:
            self._stop.set()  # the clients' threads see it within POLL
            for connection in list(self._opening):
                with suppress(OSError):
                    connection.socket.shutdown(socket.SHUT_RDWR)
            self._server.shutdown()
            accepting.join(CLOSE_WAIT)
        if self._failure is not None:
            raise self._failure

    def _serve(self, connection: "ServerConnection") -> None:
        """Follow one client, in a thread of its own."""
        client = Client(self._session, _peer(self.name, connection))
        if not self._busy.acquire(timeout=GRACE):
            client.leave("it is sent away, as another client is connected")
            connection.close(BUSY, "another client is connected")
            return
        left, self._gone = self._gone, None  # nobody is waited for while this one is here
        try:
            reason = self._follow(client, connection)
            if self._stop.is_set():
                client.leave()
            else:
                self._dismiss(client, reason)
                if reason:
                    connection.close(REFUSED, reason.encode()[:REASON_BYTES].decode(errors="ignore"))
        except Exception as error:  # raised in the thread that iterates
            self._failure = error
        finally:
            self._gone = time.monotonic() if client.has_header or left is not None else None
            self._busy.release()

    def _follow(self, client: Client, connection: "ServerConnection") -> str:
        """A clause about why the client's stream ended; empty if it said goodbye."""
        from websockets.exceptions import ConnectionClosed, ConnectionClosedOK

        begun, pace = time.monotonic(), Pace(self._settings.largest_rate)
        while not self._stop.is_set():
            if not client.has_header and time.monotonic() - begun > self._settings.header_wait:
                return f"no header came within {self._settings.header_wait:g} s"
            try:
                data = connection.recv(POLL)
            except TimeoutError:
                client.flush()
                continue
            except ConnectionClosedOK:
                return "" if client.has_header else "it left without sending a header"
            except ConnectionClosed as error:
                if error.sent is None or error.sent.code != TOO_LARGE:
                    return f"the connection was lost ({error})"
                return (
                    f"a message was larger than {self._settings.largest_message:,} bytes: either it is no live "
                    "message, or the setting largest_message must grow"
                )
            try:
                take_message(client, data)
            except ClientError as error:
                return str(error)
            wait = pace.take()
            if wait:
                rate = self._settings.largest_rate
                client.report("pace", f"it sends more than {rate:g} messages a second and has to wait")
                self._stop.wait(wait)
        return ""

    def _connection_class(self) -> "type[ServerConnection]":
        """Connections that speak of a client which never speaks WebSocket; the library keeps silent about it."""
        from websockets.protocol import State
        from websockets.sync.server import ServerConnection

        report, name, stop, opening = self._session.report, self.name, self._stop, self._opening
        most = self._settings.clients

        class Connection(ServerConnection):
            def handshake(self, *args: Any, **keywords: Any) -> None:
                problem = ""
                opening.add(self)
                try:
                    if len(opening) > most:
                        raise ConnectionError(f"{most} others are opening one")
                    super().handshake(*args, **keywords)
                    if self.protocol.state is not State.OPEN:
                        problem = str(getattr(self.protocol, "handshake_exc", None) or "refused")
                except Exception as error:
                    problem = str(error) or type(error).__name__
                    raise
                finally:
                    opening.discard(self)
                    if problem and not stop.is_set():
                        report(
                            f"{_peer(name, self)}: it did not open a WebSocket ({problem}); its connection is closed"
                        )

        return Connection


def take_message(client: Client, data: str | bytes) -> None:
    """One message of a client; what is no live message is told and left out.

    Raises:
        ClientError: if this client cannot be listened to any longer.
    """
    if isinstance(data, str):
        client.report("text", f"a text message of {len(data)} characters is left out: expected binary messages")
        return
    try:
        client.take(data)
    except FileFormatError as error:
        client.report("no message", f"a message is left out: {error}")


def _peer(name: str, connection: "ServerConnection") -> str:
    try:
        host, port = connection.remote_address[:2]
    except (OSError, ValueError):
        return f"{name}, a client"
    return f"{name}, client {host}:{port}"


def _silent_logger() -> logging.Logger:
    """What the library would log is told as findings."""
    logger = logging.getLogger("vip_factors.websockets")
    logger.addHandler(logging.NullHandler())
    logger.propagate = False
    return logger
