"""Who may send over the network, how much, and how slowly; a flood that fills no memory."""

import resource
import socket
import threading
import time
from dataclasses import replace
from pathlib import Path

import pytest
from live_sender import delimited, live_messages
from live_streams import PATIENT, QUICK, Background, assert_arrived, listening, received, send_scene, short_walk

from vip_factors.errors import InputError
from vip_factors.io.live.open import VARIABLE, open_source, read_token
from vip_factors.io.live.session import Pace
from vip_factors.io.live.source import MOST_FINDINGS, LiveQueue
from vip_factors.sensors.live import LiveFinding, VideoFrame

TOKEN = "correct horse battery staple"


@pytest.mark.parametrize("text", ["tcp://:0", "tcp://0", "tcp://127.0.0.1:0", "tcp://localhost:0"])
def test_without_a_host_it_listens_on_this_machine_alone(text: str) -> None:
    with listening(text) as source:
        assert source.address[0] == "127.0.0.1"
        assert f"listening at tcp://127.0.0.1:{source.address[1]}, to senders on this machine alone" == source.listens


def test_everybody_is_listened_to_only_if_that_is_said() -> None:
    with listening("tcp://0.0.0.0:0") as source:
        assert "all networks of this machine, that is everybody: no token is asked for" in source.listens
    with listening("tcp://0.0.0.0:0", token=TOKEN) as source:
        assert "whoever has the token; nothing is encrypted" in source.listens
    for text in ("tcp-connect://:5005", "tcp://host", "tcp://99999"):
        with pytest.raises(InputError, match="it names no"):
            open_source(text)


def test_a_sender_needs_the_token() -> None:
    with listening(token=TOKEN) as source:
        for wrong in ("", "correct horse", TOKEN + "s"):
            with socket.create_connection(source.address, timeout=20) as connection:
                connection.sendall(delimited(next(live_messages(short_walk(), token=wrong))))
                assert connection.recv(1) == b""
        with Background(send_scene, source.address, short_walk(), TOKEN):
            setup, samples, sentences = received(source)
    assert_arrived(short_walk(), setup, samples)
    assert len(sentences) == 3
    for sentence in sentences:
        assert "its header has not the token" in sentence
        assert "horse" not in sentence


def test_over_websocket_too() -> None:
    connect = pytest.importorskip("websockets.sync.client", reason="needs the extra live").connect
    from websockets.exceptions import ConnectionClosed

    with open_source("ws://:0", settings=QUICK, token=TOKEN) as source:
        assert "ws://127.0.0.1:" in source.listens
        where = source.listens.split()[2].rstrip(",")
        with connect(where) as client:
            client.send(next(live_messages(short_walk())))
            with pytest.raises(ConnectionClosed):
                client.recv(20)
        with connect(where) as client:
            list(map(client.send, live_messages(short_walk(), token=TOKEN)))
        setup, samples, sentences = received(source)
    assert_arrived(short_walk(), setup, samples)
    assert len(sentences) == 1


def test_a_token_comes_from_a_file_or_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    assert read_token() == ""
    monkeypatch.setenv(VARIABLE, "one")
    assert read_token() == "one"
    (tmp_path / "token").write_text(f"{TOKEN}\n")
    assert read_token(tmp_path / "token") == TOKEN
    (tmp_path / "token").write_text("\n")
    with pytest.raises(InputError, match="it is empty"):
        read_token(tmp_path / "token")


def test_a_client_that_dribbles_is_sent_away() -> None:
    header, first, *_ = live_messages(short_walk())
    with listening(settings=replace(PATIENT, message_wait=0.3)) as source:
        with socket.create_connection(source.address, timeout=20) as connection:
            connection.sendall(delimited(header))
            for byte in delimited(first)[:20]:
                try:
                    connection.sendall(bytes([byte]))
                except OSError:
                    break
                time.sleep(0.05)
        with Background(send_scene, source.address, short_walk()):
            items = iter(source)
            sentence = next(one.sentence for one in items if isinstance(one, LiveFinding))
            assert "a message was not whole 0.3 s after its first byte" in sentence
            assert next(items) is not None  # the next client's


def test_pace() -> None:
    now = [100.0]
    pace = Pace(10.0, lambda: now[0])
    assert [pace.take(5) for _ in range(3)] == pytest.approx([0.0, 0.0, 0.5])
    now[0] = 102.0
    assert pace.take(1) == 0.0
    assert Pace(float("inf")).take(10**9) == 0.0


def test_a_flood_waits_and_fills_no_memory() -> None:
    header, *messages = live_messages(short_walk())
    flood = b"".join(map(delimited, messages)) * (20_000 // len(messages) + 1)
    settings = replace(PATIENT, largest_rate=20_000.0, queue_limit=500)
    with listening(settings=settings) as source:
        over = threading.Event()

        def pour() -> None:
            with socket.create_connection(source.address) as connection:
                connection.sendall(delimited(header))
                for _ in range(2):
                    connection.sendall(flood)
            over.set()

        with Background(pour):
            assert source.setup.wearers
            assert over.wait(20)  # nobody takes anything out of the queue
            before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        assert len(source._queue) <= 500 + MOST_FINDINGS
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 20_000  # KiB


def test_findings_that_nobody_takes_are_bounded() -> None:
    queue = LiveQueue(10)
    for number in range(3 * MOST_FINDINGS):
        queue.put(LiveFinding(str(number)))
        queue.put(VideoFrame("camera", float(number), None, None))
    assert len(queue) <= MOST_FINDINGS + 10
