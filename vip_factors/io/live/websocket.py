"""The server's side of WebSocket, and live messages over it: one binary message is one LiveMessage.

The protocol is the library's; socket and thread are those of whoever listens.
"""

import logging
import socket
import time
from collections.abc import Iterator
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from vip_factors.errors import FileFormatError, InputError
from vip_factors.io.live.session import Client
from vip_factors.io.live.streams import PIECE, TcpServerSource, listen, receiver

if TYPE_CHECKING:
    from websockets.http11 import Request

GOODBYE_WAIT = 1.0  # seconds that a client may take to answer a goodbye
GOING, REFUSED = 1001, 1008  # close codes: going away, policy violation
REASON_BYTES = 120  # a close frame holds 123


def check_websockets(name: str) -> None:
    """Whether the library is there.

    Raises:
        InputError: if it is not.
    """
    try:
        import websockets.server  # noqa: F401
    except ImportError as error:
        raise InputError(f"{name}: needs the library websockets: pip install 'vip-factors[live]'") from error


class WebSocket:
    """One client's connection, from its HTTP request on.

    Args:
        connection: its socket, which stays the caller's.
        largest: bytes of a message.
    """

    def __init__(self, connection: socket.socket, largest: int) -> None:
        from websockets.server import ServerProtocol

        self._connection = connection
        self._largest = largest
        self._protocol: Any = ServerProtocol(max_size=largest, logger=_silent_logger())
        self._parts: list[bytes] = []  # of a message in several frames
        self._text = False

    @property
    def pending(self) -> int:
        """Bytes of a message, or of the request, that is not whole yet."""
        return len(self._protocol.reader.buffer) + sum(map(len, self._parts))

    @property
    def ended(self) -> bool:
        """Whether nothing more comes."""
        from websockets.protocol import State

        return self._protocol.handshake_exc is not None or self._protocol.state in (State.CLOSING, State.CLOSED)

    @property
    def problem(self) -> str:
        """A clause about why it ended; empty if it has not, or with a goodbye."""
        from websockets.exceptions import PayloadTooBig

        if not self.ended:
            return ""
        if self._protocol.handshake_exc is not None:
            return f"it did not open a WebSocket ({self._protocol.handshake_exc})"
        if isinstance(self._protocol.parser_exc, PayloadTooBig):
            return (
                f"a message was larger than {self._largest:,} bytes: either it is no live message, or the setting "
                "largest_message must grow"
            )
        said = self._protocol.close_rcvd
        if self._protocol.parser_exc is None and said is not None and said.code in (1000, 1001, 1005):
            return ""
        return f"the connection was lost ({self._protocol.parser_exc or said})"

    def feed(self, data: bytes) -> Iterator[bytes | str]:
        """The messages that these bytes, none at the end, complete; whoever asks for a WebSocket gets it."""
        for event in self.events(data):
            if isinstance(event, bytes | str):
                yield event
            else:
                self.accept(event)

    def events(self, data: bytes) -> "Iterator[Request | bytes | str]":
        """The request and the messages that these bytes, none at the end, complete."""
        from websockets.frames import Opcode

        if data:
            self._protocol.receive_data(data)
        else:
            self._protocol.receive_eof()
        for event in self._protocol.events_received():
            opcode = getattr(event, "opcode", None)
            if opcode is None:
                yield event
            elif opcode in (Opcode.TEXT, Opcode.BINARY, Opcode.CONT):
                self._text = opcode is Opcode.TEXT or (opcode is Opcode.CONT and self._text)
                self._parts.append(bytes(event.data))
                if event.fin:
                    whole, self._parts = b"".join(self._parts), []
                    yield whole.decode(errors="replace") if self._text else whole
        self._flush()

    def accept(self, request: "Request") -> None:
        """Open it."""
        self._protocol.send_response(self._protocol.accept(request))
        self._flush()

    def send(self, text: str) -> None:
        """A text message.

        Raises:
            OSError: if it cannot be sent whole.
        """
        self._protocol.send_text(text.encode())
        self._flush()

    def close(self, code: int = GOING, reason: str = "") -> None:
        """Say goodbye, if it is open, and wait a moment for the answer; never fails."""
        from websockets.protocol import State

        with suppress(OSError, EOFError):
            if self._protocol.state is State.OPEN:
                self._protocol.send_close(code, reason.encode()[:REASON_BYTES].decode(errors="ignore"))
                self._flush()
                self._connection.settimeout(GOODBYE_WAIT)
                until = time.monotonic() + GOODBYE_WAIT  # of one who goes on sending
                while not self._protocol.close_rcvd and (data := self._connection.recv(PIECE)):
                    list(self.events(data))
                    if time.monotonic() > until:
                        return

    def _flush(self) -> None:
        for data in self._protocol.data_to_send():
            if data:
                self._connection.sendall(data)
            else:
                with suppress(OSError):  # the other side has gone
                    self._connection.shutdown(socket.SHUT_WR)


class WebSocketSource(TcpServerSource):
    """Listens on a port; one client at a time, and the next when it has gone.

    A message that cannot be used is left out; its end is known, so the ones after it are read on.
    """

    scheme = "ws"

    def _open(self) -> None:
        check_websockets(self.name)
        super()._open()

    def _follow(self, client: Client, connection: socket.socket) -> str:
        web = WebSocket(connection, self._settings.largest_message)
        reason = listen(client, receiver(connection, self._pause), self._settings, self._stop, web, take_message)
        web.close(REFUSED if reason else GOING, reason)
        return reason


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


def _silent_logger() -> logging.Logger:
    """What the library would log is told as findings."""
    logger = logging.getLogger("vip_factors.websockets")
    logger.addHandler(logging.NullHandler())
    logger.propagate = False
    return logger
