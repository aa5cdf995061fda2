"""Answers over WebSocket and as lines over HTTP: who gets them, and that nobody who reads holds the tracker up."""

import json
import socket
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from dataclasses import replace
from threading import Event, Thread

import pytest
from live_answers import LAG, answer, live_scene

from vip_factors.errors import InputError
from vip_factors.findings import bare
from vip_factors.io import live_server
from vip_factors.io.live_server import ENDED, MOST_WAITING, LiveServer
from vip_factors.sensors.live import stream_head

connect = pytest.importorskip("websockets.sync.client", reason="needs the extra live").connect
exceptions = pytest.importorskip("websockets.exceptions")

SCENE = live_scene(0.5, 1)
ANSWER = answer(SCENE, LAG)
TOKEN = "correct horse"


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


def got(url: str, **headers: str) -> tuple[int, str]:
    try:
        with urllib.request.urlopen(urllib.request.Request(url, headers=headers), timeout=20) as response:
            return response.status, response.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode()


def stream_of(server: LiveServer, token: str = "") -> str:
    return f"ws://127.0.0.1:{server.port}/stream" + (f"?token={token}" if token else "")


def test_a_page_a_websocket_and_lines_are_at_one_port(server: LiveServer) -> None:
    assert f"http://127.0.0.1:{server.port}/, for this machine alone" in server.listens
    assert got(server.address) == (200, "<p>the page</p>")
    assert got(f"{server.address}else")[0] == 404
    with Writing(server), connect(stream_of(server)) as client:
        assert client.ping().wait(20)
        first = json.loads(client.recv(20))
        assert first["wearers"][0]["newest"]["joints"]["left_knee"]["position"][2] > 0.2
        with urllib.request.urlopen(f"{server.address}lines", timeout=20) as lines:
            assert [json.loads(next(lines)) for _ in range(3)] == [first] * 3


def test_the_end_is_said(server: LiveServer) -> None:
    with Writing(server), connect(stream_of(server)) as client:
        client.recv(20)
        server.close()
        for _ in client:  # until it is closed, in order
            pass
        assert (client.close_code, client.close_reason) == (1001, ENDED)


def test_who_reads_nothing_holds_nobody_up_and_goes_on_with_the_newest(server: LiveServer) -> None:
    number, last = 0, -1
    with socket.socket() as idle, connect(stream_of(server)) as busy:
        idle.settimeout(20)
        idle.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 14)  # less than two answers
        idle.connect(("127.0.0.1", server.port))
        idle.sendall(b"GET /lines HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        while len(server._readers) < 2:
            time.sleep(0.01)
        for _ in range(8 * MOST_WAITING):
            findings = (bare("somebody tripped"),) if number == 4 * MOST_WAITING else ()
            server.write(replace(ANSWER, frame=number, findings=findings))
            number += 1
            last = json.loads(busy.recv(20))["frame"]
        told, frames = [], []
        lines = idle.makefile("rb")
        while lines.readline().strip():
            pass  # the head
        while not frames or frames[-1] < number - 1:
            line = json.loads(lines.readline())
            frames.append(line["frame"])
            told += [one["text"] for one in line["findings"]]
    assert last == number - 1
    assert frames == sorted(frames)
    assert len(frames) < number / 2
    assert told == ["somebody tripped"]


def test_who_comes_later_hears_what_was_found_before(server: LiveServer) -> None:
    server.write(replace(ANSWER, findings=(bare("the first"), bare("somebody tripped"))))
    with Writing(server), connect(stream_of(server)) as client:
        lines = [json.loads(client.recv(20)) for _ in range(2)]
    assert [[one["text"] for one in line["findings"]] for line in lines] == [["somebody tripped"], []]
    assert lines[0]["verdict"] == "care"


def test_pages_of_other_sites_get_nothing_without_the_token(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_server, "WRONG_TOKEN_S", 0.0)
    with LiveServer(stream_head(SCENE), "page", 0, token=TOKEN) as server:
        here = f"127.0.0.1:{server.port}"
        for headers, status in (
            ({}, 200), ({"Origin": f"http://{here}"}, 200), ({"Origin": "http://elsewhere.org"}, 403),
            ({"Origin": "null"}, 403), ({"Host": f"elsewhere.org:{server.port}"}, 403),
            ({"Origin": "null", "Authorization": f"Bearer {TOKEN}"}, 200),
        ):  # fmt: skip
            assert got(server.address, **headers)[0] == status, headers
        with pytest.raises(exceptions.InvalidStatus), connect(stream_of(server), origin="http://elsewhere.org"):
            pass
        with Writing(server), connect(stream_of(server, "correct%20horse"), origin="http://elsewhere.org") as client:
            assert json.loads(client.recv(20))["version"] == 1


def test_beyond_this_machine_a_token_is_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_server, "WRONG_TOKEN_S", 0.0)
    with LiveServer(stream_head(SCENE), "page", 0, "0.0.0.0") as server:
        assert "whoever has the token; nothing is encrypted" in server.listens
        made_up = server.address.partition("?token=")[2]
        assert len(made_up) >= 16
        page = f"http://127.0.0.1:{server.port}/"
        assert got(page)[0] == got(f"{page}lines")[0] == got(f"{page}?token={made_up}x")[0] == 403
        assert got(f"{page}?token={made_up}") == (200, "page")
        with pytest.raises(exceptions.InvalidStatus), connect(stream_of(server)):
            pass
        with Writing(server), connect(stream_of(server, made_up)) as client:
            client.recv(20)
    with LiveServer(stream_head(SCENE), "page", 0, "0.0.0.0", TOKEN) as server:
        assert "horse" not in server.listens
        assert got(f"http://127.0.0.1:{server.port}/", Authorization=f"Bearer {TOKEN}")[0] == 200


def test_what_is_no_request_is_let_go(server: LiveServer) -> None:
    for data in (b"hello\r\n\r\n", b"\x00" * 100_000, b"GET /stream HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"):
        with socket.create_connection(("127.0.0.1", server.port), timeout=20) as client:
            client.sendall(data)
            try:
                while client.recv(1000):
                    pass
            except ConnectionResetError:
                pass
    assert got(server.address)[0] == 200


def test_a_port_in_use_is_an_input_error(server: LiveServer) -> None:
    with pytest.raises(InputError, match="cannot listen there"):
        LiveServer(stream_head(SCENE), "page", server.port)
