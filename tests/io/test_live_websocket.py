"""The source over WebSocket on this machine: what arrives, and clients that err."""

import socket
import time
from dataclasses import replace
from threading import Event

import pytest
from live_sender import live_messages
from live_streams import PATIENT, QUICK, Background, assert_arrived, listening, received, short_walk

from vip_factors.errors import InputError
from vip_factors.io.live import websocket
from vip_factors.io.live.open import open_source
from vip_factors.io.live.session import Client, Session
from vip_factors.io.live.streams import NetworkSource, listen
from vip_factors.sensors.scene import Scene

connect = pytest.importorskip("websockets.sync.client", reason="needs the extra live").connect
ConnectionClosed = pytest.importorskip("websockets.exceptions").ConnectionClosed


WS = "ws://127.0.0.1:0"


def url(source: NetworkSource) -> str:
    host, port = source.address
    return f"ws://{host}:{port}"


def send_scene(where: str, scene: Scene) -> None:
    with connect(where) as client:
        for message in live_messages(scene):
            client.send(message)


def sent_away(where: str, *messages: str | bytes) -> int:
    """The code that the other side closes with."""
    with connect(where) as client:
        try:
            for message in messages:
                client.send(message)
            client.recv(20)
        except ConnectionClosed as error:
            return error.rcvd.code
    return 0


def test_a_scene_arrives() -> None:
    scene = short_walk()
    with listening(WS) as source, Background(send_scene, url(source), scene):
        setup, samples, sentences = received(source)
    assert_arrived(scene, setup, samples)
    assert sentences == []


def test_what_is_no_message_is_left_out_and_the_rest_is_read() -> None:
    scene = short_walk()
    header, *messages = live_messages(scene)

    def send(where: str) -> None:
        with connect(where) as client:
            for message in (header, b"\xff\xff", *messages[:10], "words", b"", header, *messages[10:]):
                client.send(message)

    with listening(WS) as source, Background(send, url(source)):
        setup, samples, sentences = received(source)
    assert_arrived(scene, setup, samples)
    assert ["no LiveMessage" in one for one in sentences] == [True, False, False, False]
    assert "text message of 5 characters" in sentences[1]
    assert "neither header nor sample" in sentences[2]
    assert "second header" in sentences[3]


@pytest.mark.parametrize(
    ("messages", "complaint", "code"),
    [
        ((), "no header came within 0.4 s", 1008),
        ((b"x" * 70_000,), "larger than 60,000 bytes", 1009),
        ((b"\x0a\x03Ada\x1a\x00",), "before its header", 1008),
    ],
)
def test_a_bad_client_is_sent_away_with_one_line_and_the_next_one_is_heard(
    messages: tuple[bytes, ...], complaint: str, code: int
) -> None:
    scene, told = short_walk(), []
    with listening(WS, replace(QUICK, largest_message=60_000), on_finding=told.append) as source:
        assert sent_away(url(source), *messages) == code
        with Background(send_scene, url(source), scene):
            setup, samples, sentences = received(source)
    assert_arrived(scene, setup, samples)
    assert sentences == []
    assert complaint in told[0].sentence
    assert "waiting for the next client" in told[0].sentence
    assert len(told) == 1


def test_a_client_that_speaks_no_websocket_is_told() -> None:
    told = []
    with listening(WS, on_finding=told.append) as source:
        with socket.create_connection(source.address) as silent, socket.create_connection(source.address) as wrong:
            wrong.sendall(b"hello\r\n\r\n")
            while wrong.recv(1000):
                pass
            assert silent.recv(1) == b""
        with Background(send_scene, url(source), short_walk()):
            received(source)
    assert len(told) == 2
    assert "no header came" in told[0].sentence
    assert "did not open a WebSocket" in told[1].sentence


def test_a_second_client_waits_until_the_first_has_gone() -> None:
    scene = short_walk()
    messages = list(live_messages(scene))
    with listening(WS, replace(PATIENT, next_client_wait=1.0)) as source:
        with connect(url(source)) as client:
            client.send(messages[0])
            source.setup  # noqa: B018
            second = Background(send_scene, url(source), scene)
            second.__enter__()
            for message in messages[1:]:
                client.send(message)
        second.__exit__()
        setup, samples, sentences = received(source)
    assert_arrived(scene, setup, samples[: len(messages) - 1])
    assert_arrived(scene, setup, samples[len(messages) - 1 :])
    assert ["has left after" in one for one in sentences] == [True, True]


def test_a_message_may_come_in_pieces_and_a_ping_is_answered() -> None:
    scene = short_walk()
    with listening(WS) as source:
        with connect(url(source)) as client:
            for message in live_messages(scene):
                client.send([message[:5], message[5:]])
            assert client.ping().wait(20)
        setup, samples, _ = received(source)
    assert_arrived(scene, setup, samples)


def test_a_client_that_vanishes_is_told_and_may_come_back() -> None:
    scene = short_walk()
    header, *messages = live_messages(scene)
    with listening(WS, replace(PATIENT, next_client_wait=2.0)) as source:
        with connect(url(source)) as client:
            client.send(header)
            client.send(messages[0])
            source.setup  # noqa: B018
            client.socket.shutdown(socket.SHUT_RDWR)
        with Background(send_scene, url(source), scene):
            setup, samples, sentences = received(source)
    assert_arrived(scene, setup, samples[1:])
    assert "connection was lost" in sentences[0]
    assert len(sentences) == 2


def test_an_answer_that_cannot_be_sent_ends_that_client_only() -> None:
    class Gone:
        ended, pending, problem = False, 0, ""

        def feed(self, data: bytes) -> list[bytes]:
            raise BrokenPipeError(32, "Broken pipe")

    client = Client(Session(print, print), "a client")
    assert listen(client, lambda: b"data", QUICK, Event(), Gone()) == "the connection was lost (Broken pipe)"


def test_who_goes_on_sending_after_the_goodbye_is_not_listened_to(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(websocket, "GOODBYE_WAIT", 0.2)
    scene, told = short_walk(), []
    with listening(WS, on_finding=told.append) as source:
        with socket.create_connection(source.address) as flooding:
            key = "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA=="
            flooding.sendall(f"GET / HTTP/1.1\r\nHost: here\r\n{key}\r\nSec-WebSocket-Version: 13\r\n\r\n".encode())
            frame = bytes([0x82, 0x85, 0, 0, 0, 0]) + b"\x0a\x03Ada"  # a message before the header
            with pytest.raises(OSError, match=r"reset|pipe"):  # noqa: PT012
                while True:
                    flooding.sendall(frame)
                    time.sleep(0.01)
        with Background(send_scene, url(source), scene):
            setup, samples, _ = received(source)
    assert_arrived(scene, setup, samples)
    assert "before its header" in told[0].sentence


def test_a_port_in_use_is_an_input_error() -> None:
    with listening(WS) as source, pytest.raises(InputError, match="cannot listen there"), open_source(url(source)):
        pass


def test_without_the_library_the_pip_line_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "websockets.server", None)
    with pytest.raises(InputError, match=r"pip install 'vip-factors\[live\]'"), listening(WS):
        pass
