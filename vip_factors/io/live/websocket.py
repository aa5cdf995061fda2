"""Live messages over WebSocket: a binary message is a serialised LiveMessage, a text the same as JSON."""

import time
from collections.abc import Callable

from vip_factors.errors import FileFormatError
from vip_factors.io.live.network import GOING, REFUSED, ConnectionClosed, Listener, ServerConnection, cut_off
from vip_factors.io.live.session import CLAIM_S, LARGEST_MESSAGE, Client, ClientError, Session
from vip_factors.io.live.source import POLL, LiveSource
from vip_factors.io.settings import DEFAULT, LiveSourceSettings

MOST_SENDERS = 8  # connected at once; beyond, the one that has been silent longest makes room
REASON_BYTES = 120  # a close frame holds 123
HEADER_S = 10.0  # a program that has its header ready sends it at once; this forgives a slow start
SILENCE_S = 2.0  # a sender that was lost comes back sooner than its old connection is known to be dead
# Messages a second read from a sender, after the first second: three wearers of 17 sensors at 100 Hz send 5,100.
LARGEST_RATE = 10_000.0


class Pace:
    """Counts messages against a rate; a second's worth may come at once.

    Args:
        rate: messages a second.
        clock: monotonic seconds.
    """

    def __init__(self, rate: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._rate = rate
        self._clock = clock
        self._due = -float("inf")  # when those until now would have come at that rate

    def take(self, messages: int = 1) -> float:
        """Count messages; the seconds to wait before the next are read, 0 if none."""
        now = self._clock()
        self._due = max(self._due, now - 1.0) + messages / self._rate
        wait = self._due - now
        return wait if wait >= 0.02 else 0.0  # a shorter one costs more than it spares


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
        self._session = Session(self._announce, self._put, SILENCE_S)
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
        awaits = (
            "; waiting for the next client" if self._settings.next_client_wait != 0 or not client.takes_part else ""
        )
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
        pace = Pace(LARGEST_RATE)
        while not self._stop.is_set():
            try:
                data = connection.recv(POLL)
                while client.is_to_wait:
                    if self._stop.wait(POLL):
                        return ""
                take_message(client, data)
            except TimeoutError:
                if not client.has_header and time.monotonic() - client.received_at > HEADER_S:
                    return f"no header came within {HEADER_S:g} s"
                continue
            except ClientError as error:
                return str(error)
            except ConnectionClosed as error:
                return _problem(error)
            wait = pace.take()
            if wait:
                client.report("pace", f"it sends more than {LARGEST_RATE:g} messages a second and has to wait")
                self._stop.wait(wait)
        return ""


def _problem(error: ConnectionClosed) -> str:
    """Return why a connection ended; empty after a normal close."""
    if error.sent is not None and error.sent.code == 1009:
        return f"a message was larger than {LARGEST_MESSAGE:,} bytes: it is no live message"
    if error.rcvd is not None and error.rcvd.code in (1000, 1001, 1005):
        return ""
    return f"the connection was lost ({error})"


def take_message(client: Client, data: str | bytes) -> None:
    """Take one message of a client; anything but a live message is reported and left out.

    Raises:
        ClientError: if this client cannot be received any longer.
    """
    try:
        client.take(data)
    except FileFormatError as error:
        client.report("text" if isinstance(data, str) else "no message", f"a message is left out: {error}")
