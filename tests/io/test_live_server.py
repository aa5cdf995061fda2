"""Answers over WebSocket: what readers get, and that nobody who reads holds the tracker up."""

import json
import socket
import time
import urllib.request
from collections.abc import Iterator
from dataclasses import replace
from threading import Event, Thread

import pytest
from live_answers import LAG, answer, live_scene
from websockets.sync.client import connect

from vip_factors.findings import bare
from vip_factors.io import live_server
from vip_factors.io.live_server import ENDED, MOST_FINDINGS, MOST_WAITING, LiveServer, page_policy
from vip_factors.sensors.live import stream_head

SCENE = live_scene(0.5, 1)
ANSWER = answer(SCENE, LAG)


@pytest.fixture
def server() -> Iterator[LiveServer]:
    with LiveServer(stream_head(SCENE), "<p>the page</p>", 0) as served:
        yield served


class Writing:
    """Hands the same answer to a server again and again, until the context ends."""

    def __init__(self, server: LiveServer) -> None:
        self._server, self._stop = server, Event()
        self._thread = Thread(target=self._write, daemon=True)

    def _write(self) -> None:
        while not self._stop.wait(0.01):
            self._server.write(ANSWER)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()


def stream_of(server: LiveServer) -> str:
    return f"ws://127.0.0.1:{server.port}/stream"


def slow_reader(server: LiveServer) -> socket.socket:
    """One that the system buffers less than two answers for."""
    connection = socket.socket()
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 14)
    connection.connect(("127.0.0.1", server.port))
    return connection


def texts(line: str | bytes) -> list[str]:
    return [finding["text"] for finding in json.loads(line)["findings"]]


def test_a_page_and_a_websocket_are_at_one_port(server: LiveServer) -> None:
    assert f"http://127.0.0.1:{server.port}/, for this machine alone" in server.listens
    with urllib.request.urlopen(server.address) as page:
        assert page.read() == b"<p>the page</p>"
    with Writing(server), connect(stream_of(server)) as client:
        first = json.loads(client.recv(20))
        assert first["wearers"][0]["newest"]["joints"]["left_knee"]["position"][2] > 0.2
        assert json.loads(client.recv(20)) == first
        server.close()
        for _ in client:  # until it is closed, in order
            pass
        assert (client.close_code, client.close_reason) == (1001, ENDED)


def test_who_reads_nothing_holds_nobody_up_and_goes_on_with_the_newest(
    server: LiveServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_server, "STALLED_S", 600.0)  # a busy machine may take longer for all frames
    frames, lines = 8 * MOST_WAITING, list[str | bytes]()
    with (
        connect(stream_of(server), sock=slow_reader(server), max_queue=1, close_timeout=0.1) as idle,
        connect(stream_of(server)) as busy,
    ):
        while len(server._readers) < 2:
            time.sleep(0.01)
        for frame in range(frames):
            findings = (bare("somebody tripped"),) if frame == 4 * MOST_WAITING else ()
            server.write(replace(ANSWER, frame=frame, findings=findings))
            assert json.loads(busy.recv(20))["frame"] == frame
        while not lines or json.loads(lines[-1])["frame"] < frames - 1:
            lines.append(idle.recv(20))
    numbers = [json.loads(line)["frame"] for line in lines]
    assert numbers == sorted(numbers)
    assert len(numbers) < frames / 2
    assert [text for line in lines for text in texts(line)] == ["somebody tripped"]


def test_who_is_behind_gets_the_last_findings_alone(server: LiveServer) -> None:
    frames, told = MOST_FINDINGS + 6 * MOST_WAITING, list[str]()
    with connect(stream_of(server), sock=slow_reader(server), max_queue=1, close_timeout=0.1) as idle:
        while not server._readers:
            time.sleep(0.01)
        for frame in range(frames):
            server.write(replace(ANSWER, frame=frame, findings=(bare(f"finding {frame}"),)))
        while f"finding {frames - 1}" not in told:
            told += texts(idle.recv(20))
    assert len(told) < MOST_FINDINGS + 3 * MOST_WAITING


def test_who_takes_nothing_is_let_go(server: LiveServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_server, "STALLED_S", 0.2)
    until = time.monotonic() + 20
    with Writing(server), connect(stream_of(server), sock=slow_reader(server), max_queue=1, close_timeout=0.1):
        while not server._readers:
            assert time.monotonic() < until
        while server._readers:
            assert time.monotonic() < until


def test_a_server_ends_though_nobody_reads(server: LiveServer) -> None:
    with connect(stream_of(server), sock=slow_reader(server), max_queue=1, close_timeout=0.1):
        with Writing(server):
            time.sleep(0.5)
        server.close()
        assert server._readers == set()


def test_who_comes_later_hears_what_was_found_before(server: LiveServer) -> None:
    server.write(replace(ANSWER, findings=(bare("the first"), bare("somebody tripped"))))
    with Writing(server), connect(stream_of(server)) as client:
        lines = [client.recv(20) for _ in range(2)]
    assert [texts(line) for line in lines] == [["somebody tripped"], []]
    assert json.loads(lines[0])["verdict"] == "care"


def test_the_policy_names_each_script_and_style_of_the_page() -> None:
    policy = page_policy("<style>p {}</style><script type='application/json'>{}</script><script>a()</script>")
    assert policy.count("sha256-") == 2
    assert "script-src 'sha256-" in policy
    assert "style-src 'sha256-" in policy
    assert "script-src 'none'; style-src 'none'" in page_policy("<p>no script</p>")
