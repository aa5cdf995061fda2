"""The source over WebSocket on this machine: what arrives, and clients that err."""

import socket
from dataclasses import replace

import pytest
from live_streams import PATIENT, QUICK, Background, assert_arrived, listening, received, short_walk

from vip_factors.errors import InputError
from vip_factors.io.live.open import live_messages, open_source
from vip_factors.io.live.streams import NetworkSource
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
    assert all("did not open a WebSocket" in one.sentence for one in told)


def test_a_second_client_at_a_time_is_sent_away() -> None:
    scene = short_walk()
    header, *messages = live_messages(scene)
    with listening(WS) as source:
        with connect(url(source)) as client:
            client.send(header)
            source.setup  # noqa: B018
            assert sent_away(url(source)) == 1013
            for message in messages:
                client.send(message)
        setup, samples, sentences = received(source)
    assert_arrived(scene, setup, samples)
    (told,) = sentences
    assert "another client is connected" in told


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


def test_a_port_in_use_is_an_input_error() -> None:
    with listening(WS) as source, pytest.raises(InputError, match="cannot listen there"), open_source(url(source)):
        pass


def test_without_the_library_the_pip_line_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "websockets.sync.server", None)
    with pytest.raises(InputError, match=r"pip install 'vip-factors\[live\]'"), listening(WS):
        pass
