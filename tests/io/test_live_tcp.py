"""Sources over TCP on this machine: what arrives, and clients that err."""

import os
import signal
import socket
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from live_sender import delimited, live_messages, write_messages
from live_streams import PATIENT, QUICK, Background, assert_arrived, listening, received, send_scene, short_walk

from vip_factors.errors import InputError
from vip_factors.io.live.messages import header_message
from vip_factors.io.live.open import open_source
from vip_factors.sensors.live import stream_head

ROOT = Path(__file__).parents[2]


def send_bytes(address: tuple[str, int], data: bytes) -> bytes:
    """What the other side says to it, which is nothing, once it has closed the connection."""
    with socket.create_connection(address, timeout=20) as connection:
        connection.sendall(data)
        try:
            return connection.recv(100)
        except ConnectionResetError:  # it closed with bytes of ours unread
            return b""


def test_a_scene_arrives() -> None:
    scene = short_walk()
    with listening() as source, Background(send_scene, source.address, scene):
        setup, samples, sentences = received(source)
    assert_arrived(scene, setup, samples)
    assert sentences == []


def test_a_scene_arrives_from_a_sender_that_listens() -> None:
    scene = short_walk()
    server = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        connection, _ = server.accept()
        with connection, connection.makefile("wb") as stream:
            write_messages(scene, stream)

    with server, Background(serve), open_source(f"tcp-connect://127.0.0.1:{server.getsockname()[1]}") as source:
        setup, samples, sentences = received(source)
    assert_arrived(scene, setup, samples)
    assert sentences == []


def test_a_sender_that_breaks_is_connected_to_anew() -> None:
    messages = [delimited(one) for one in live_messages(short_walk())]
    server = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        for data in (b"".join(messages[:3]) + messages[3][:5], messages[0] + b"".join(messages[3:5])):
            connection, _ = server.accept()
            with connection:
                connection.sendall(data)

    address = f"tcp-connect://127.0.0.1:{server.getsockname()[1]}"
    with server, Background(serve), open_source(address, settings=PATIENT) as source:
        _, samples, sentences = received(source)
    assert len(samples) == 4
    assert len(sentences) == 1
    assert "in the middle of a message" in sentences[0]


def header_bytes() -> bytes:
    return delimited(header_message(stream_head(short_walk())).SerializeToString())


BAD_CLIENTS = {
    "silent": (b"", "no header came within 0.4 s"),
    "hypertext": (b"GET / HTTP/1.1\r\nHost: here\r\n\r\n" * 10, "bytes are no LiveMessage"),
    "no varint": (b"\xff" * 64, "the bytes are no live messages"),
    "oversized": (delimited(b"x" * 200)[:1] + b"\xff\xff\x7f", "is announced: expected at most 16,777,216"),
    "unparsable": (delimited(b"\xff" * 20), "20 bytes are no LiveMessage"),
    "sample first": (delimited(b"\x0a\x03Ada\x1a\x00"), "before its header"),
}


@pytest.mark.parametrize("kind", BAD_CLIENTS)
def test_a_bad_client_is_sent_away_with_one_line_and_the_next_one_is_heard(kind: str) -> None:
    data, complaint = BAD_CLIENTS[kind]
    scene, told = short_walk(), []
    with listening(on_finding=told.append) as source:
        with Background(send_bytes, source.address, data):
            pass
        with Background(send_scene, source.address, scene):
            setup, samples, sentences = received(source)
    assert_arrived(scene, setup, samples)
    assert sentences == []
    (finding,) = told
    assert complaint in finding.sentence
    assert "waiting for the next client" in finding.sentence


def test_garbage_after_the_header_ends_that_client_only() -> None:
    scene = short_walk()
    messages = list(live_messages(scene))
    with listening(settings=replace(PATIENT, next_client_wait=1.0)) as source:
        good = b"".join(map(delimited, messages[:11]))
        with Background(send_bytes, source.address, good + b"\xff" * 64):
            pass
        with Background(send_scene, source.address, scene):
            setup, samples, sentences = received(source)
    assert_arrived(scene, setup, samples[10:])
    assert len(sentences) == 2  # and the second client's leaving
    assert "no live messages" in sentences[0]
    assert "has left after" in sentences[1]


def test_a_client_that_vanishes_in_a_message_is_told_and_findings_begin_the_iteration() -> None:
    message = header_bytes()
    scene = short_walk()
    with listening() as source:
        for data in (message[:100], b""):
            with socket.create_connection(source.address) as connection:
                connection.sendall(data)
        with Background(send_scene, source.address, scene):
            setup, samples, sentences = received(source)
    assert_arrived(scene, setup, samples)
    assert "in the middle of a message, 100 bytes after its beginning" in sentences[0]
    assert "ended before a header came" in sentences[1]
    assert len(sentences) == 2


def test_another_session_is_refused() -> None:
    scene = short_walk()
    other = replace(scene, wearers=(replace(scene.wearers[0], subject=replace(scene.wearers[0].subject, name="Bob")),))
    with listening(settings=replace(QUICK, next_client_wait=1.0)) as source:
        with Background(send_scene, source.address, scene):
            source.setup  # noqa: B018
        with socket.create_connection(source.address) as connection:
            connection.sendall(delimited(next(live_messages(other))))
            setup, samples, sentences = received(source)
    assert_arrived(scene, setup, samples)
    assert "other wearers" in sentences[1]


def test_a_port_in_use_is_an_input_error() -> None:
    with listening() as source:
        with (
            pytest.raises(InputError, match="cannot listen there"),
            open_source(f"tcp://127.0.0.1:{source.address[1]}"),
        ):
            pass
        port = source.address[1]
    with open_source(f"tcp://127.0.0.1:{port}"):  # free again
        pass
    with pytest.raises(InputError, match="nobody answers there"), open_source(f"tcp-connect://127.0.0.1:{port}"):
        pass


INTERRUPTED = """
import sys, threading
from vip_factors.io.live.open import open_source
try:
    with open_source(sys.argv[1]) as source:
        print("open", flush=True)
        source.setup
except KeyboardInterrupt:
    print("interrupted", threading.active_count(), flush=True)
"""


@pytest.mark.parametrize("text", ["tcp://127.0.0.1:0", "ws://127.0.0.1:0", "-"])
def test_an_interrupt_ends_the_waiting(text: str) -> None:
    if text.startswith("ws"):
        pytest.importorskip("websockets")
    with subprocess.Popen(
        [sys.executable, "-c", INTERRUPTED, text],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "open\n"
        process.send_signal(signal.SIGINT)
        assert process.stdout.readline() == "interrupted 1\n"
        assert process.wait(20) == 0


def test_the_example_sender_is_understood() -> None:
    script = str(ROOT / "data_schemas" / "example_sender.py")
    with listening() as source:
        host, port = source.address
        command = [sys.executable, script, host, str(port), "1.0"]
        with subprocess.Popen(command, env={**os.environ, "PYTHONPATH": str(ROOT)}) as sender:
            setup, samples, sentences = received(source)
        assert sender.returncode == 0
    assert [wearer.subject.name for wearer in setup.wearers] == ["Ada"]
    placed = {site.sensor for site in setup.wearers[0].placement.sites}
    assert {(one.carrier, one.sensor) for one in samples} == {("Ada", name) for name in placed}
    assert all(one.R_inertial_sensor is not None and one.specific_force is not None for one in samples)
    assert len(samples) > 300
    assert sentences == []
