"""Who may use a port of the live page and of a source, and that others keep nobody out."""

import http.client
import socket
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest
from live_answers import live_scene
from live_streams import listening
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from vip_factors.errors import InputError
from vip_factors.io import live_network as network
from vip_factors.io.live_server import MOST_READERS, LiveServer
from vip_factors.sensors.live import stream_head

TOKEN = "correct horse"
SETUP = stream_head(live_scene(0.2, 1))


@dataclass(frozen=True)
class Door:
    """A port that listens, its words about itself, and the path of its WebSocket."""

    port: int
    words: str
    path: str


Opened = Callable[..., AbstractContextManager[Door]]


@contextmanager
def page_door(host: str = "127.0.0.1", token: str = "") -> Iterator[Door]:
    with LiveServer(SETUP, "<p>page</p>", 0, host, token) as server:
        yield Door(server.port, server.listens, "/stream")


@contextmanager
def source_door(host: str = "127.0.0.1", token: str = "") -> Iterator[Door]:
    with listening(f"ws://{host}:0", token=token) as source:
        yield Door(source._listener.port, source.listens, "/")


@pytest.fixture(params=[page_door, source_door])
def opened(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Opened:
    monkeypatch.setattr(network, "WRONG_TOKEN_S", 0.0)
    return request.param


def status(door: Door, path: str, **headers: str) -> int:
    """Status of a request for a WebSocket; 101 if it is opened."""
    host = headers.pop("Host", f"127.0.0.1:{door.port}")
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    try:
        with (
            socket.create_connection(("127.0.0.1", door.port)) as connection,
            connect(f"ws://{host}{path}", sock=connection, additional_headers=named, proxy=None),
        ):
            return 101
    except InvalidStatus as error:
        return error.response.status_code


def test_pages_of_other_sites_are_refused(opened: Opened) -> None:
    with opened() as door:
        here = f"127.0.0.1:{door.port}"
        for headers, expected in (
            ({}, 101), ({"Origin": f"http://{here}"}, 101), ({"Origin": "http://elsewhere.org"}, 403),
            ({"Origin": "null"}, 403), ({"Origin": "http://127.0.0.1:1"}, 403),
            ({"Host": f"elsewhere.org:{door.port}"}, 403), ({"Host": f"elsewhere.org:{door.port}",
            "Origin": f"http://elsewhere.org:{door.port}"}, 403), ({"Sec_Fetch_Site": "cross-site"}, 403),
            ({"Sec_Fetch_Site": "same-site"}, 403), ({"Sec_Fetch_Site": "same-origin"}, 101),
        ):  # fmt: skip
            assert status(door, door.path, **headers) == expected, headers


def test_with_a_token_everybody_needs_it(opened: Opened) -> None:
    with opened(token=TOKEN) as door:
        assert "?token=…" in door.words
        assert "horse" not in door.words
        path = f"{door.path}?token="
        assert status(door, door.path) == status(door, f"{path}correct") == status(door, f"{path}wrong%20horse") == 403
        assert status(door, door.path, Authorization=f"Bearer {TOKEN}x") == 403
        assert status(door, door.path, Authorization=f"Bearer {TOKEN}") == 101
        assert status(door, f"{path}correct%20horse", Origin="http://elsewhere.org") == 101


def test_beyond_this_machine_a_token_is_made_up(opened: Opened) -> None:
    with opened("0.0.0.0") as door:
        assert "whoever has the token; nothing is encrypted" in door.words
        token = door.words.partition("?token=")[2].partition(",")[0]
        assert len(token) >= 16
        assert status(door, door.path) == 403
        assert status(door, f"{door.path}?token={token}") == 101


def test_a_wrong_token_waits_and_the_time_does_not_tell_how_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    waits, compared = list[float](), list[bytes]()
    monkeypatch.setattr(network.time, "sleep", waits.append)
    compare = network.compare_digest
    monkeypatch.setattr(network, "compare_digest", lambda given, own: compared.append(own) or compare(given, own))
    with page_door(token=TOKEN) as door:
        assert status(door, "/stream?token=x") == 403
    assert network.WRONG_TOKEN_S in waits
    assert compared == [TOKEN.encode()]


@pytest.mark.parametrize("request_line", [b"hello", b"GET", b"\x00\xff\x00", b"GET / HTTP/9.9\r\nHost"])
def test_an_invalid_request_ends_the_connection(
    opened: Opened, request_line: bytes, capfd: pytest.CaptureFixture
) -> None:
    with opened() as door, socket.create_connection(("127.0.0.1", door.port), timeout=20) as client:
        client.sendall(request_line + b"\r\n\r\n")
        assert client.recv(1) == b""
        assert status(door, door.path) == 101
    assert capfd.readouterr().err == ""


def test_clients_without_a_request_keep_nobody_out(opened: Opened) -> None:
    with opened(token=TOKEN) as door, ExitStack() as stack:
        for number in range(100):
            client = stack.enter_context(socket.create_connection(("127.0.0.1", door.port)))
            client.sendall(b"GET /stream HTTP/1.1\r\n"[: number % 20])
        assert status(door, door.path, Authorization=f"Bearer {TOKEN}") == 101


def test_readers_are_limited_and_one_that_goes_makes_room() -> None:
    with page_door() as door, ExitStack() as stack:
        for _ in range(MOST_READERS):
            reader = stack.enter_context(connect(f"ws://127.0.0.1:{door.port}/stream"))
        assert status(door, "/stream") == 503
        reader.close()
        until = time.monotonic() + 20
        while status(door, "/stream") != 101:
            assert time.monotonic() < until


def test_an_answer_says_how_a_browser_is_to_take_it() -> None:
    with page_door() as door:
        for path, expected in (("/", 200), ("/nowhere", 404)):
            client = http.client.HTTPConnection("127.0.0.1", door.port)
            client.request("GET", path)
            answer = client.getresponse()
            assert (answer.status, answer.getheader("X-Content-Type-Options")) == (expected, "nosniff")
            policy = answer.getheader("Content-Security-Policy") or ""
            assert "default-src 'none'" in policy
            assert "frame-ancestors 'none'" in policy
            assert "unsafe" not in policy
            assert answer.getheader("Referrer-Policy") == "no-referrer"
            client.close()


@pytest.mark.skipif(sys.platform != "linux", reason="timers are looked for in /proc")
def test_the_system_asks_whether_a_peer_is_still_there(opened: Opened) -> None:
    """Half-open connections: the network is gone, and no goodbye comes."""
    with opened() as door, socket.create_connection(("127.0.0.1", door.port)) as client:
        local, remote = (f"0100007F:{port:04X}" for port in (door.port, client.getsockname()[1]))
        until = time.monotonic() + 20
        while not (timers := timers_of(local, remote)):  # accepted by another thread
            assert time.monotonic() < until
    assert timers == ["02"]  # keepalive


def timers_of(local: str, remote: str) -> list[str]:
    """Timers that run for the connection between two addresses, as the system numbers them."""
    rows = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    timers = [row[5].partition(":")[0] for row in rows if row[1:3] == [local, remote]]
    return [timer for timer in timers if timer != "00"]


def test_a_port_goes_on_listening_after_an_error(monkeypatch: pytest.MonkeyPatch, opened: Opened) -> None:
    accept, errors = socket.socket.accept, [OSError(24, "Too many open files"), ConnectionAbortedError()]

    def failing(listening: socket.socket) -> object:
        if errors:
            raise errors.pop()
        return accept(listening)

    monkeypatch.setattr(socket.socket, "accept", failing)
    with opened() as door:
        assert status(door, door.path) == 101
    assert errors == []


def test_a_port_in_use_is_an_input_error(opened: Opened) -> None:
    with opened() as door, pytest.raises(InputError, match="cannot listen there"):
        LiveServer(SETUP, "page", door.port)
