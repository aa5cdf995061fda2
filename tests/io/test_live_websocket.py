"""The source over WebSocket on this machine: what arrives, whose turn it is, and clients that err."""

import json
import os
import resource
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from threading import Event

import pytest
from google.protobuf.json_format import MessageToJson
from live_sender import live_messages
from live_streams import PATIENT, Background, assert_arrived, listening, received, send_scene, short_walk
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from vip_factors.errors import InputError
from vip_factors.io import live_network as network
from vip_factors.io.live_network import MOST_SENDERS
from vip_factors.io.live_open import VARIABLE, open_source, read_token
from vip_factors.io.live_source import MOST_FINDINGS, LiveQueue
from vip_factors.io.schemas.live_message_pb2 import LiveMessage
from vip_factors.sensors.live import LiveFinding, VideoFrame
from vip_factors.sensors.scene import Scene

ROOT = Path(__file__).parents[2]
SCENE = short_walk()
HEADER, *SAMPLES = live_messages(SCENE)
ONCE_MORE = replace(PATIENT, next_client_wait=1.0)


def of_another_wearer() -> Scene:
    wearer = SCENE.wearers[0]
    return replace(SCENE, wearers=(replace(wearer, subject=replace(wearer.subject, name="Mallory")),))


def close_code(client: ClientConnection) -> int | None:
    """The code that the other side closes with."""
    with pytest.raises(ConnectionClosed):
        client.recv(20)
    return client.close_code


@pytest.mark.parametrize("text", ["ws://:0", "ws://127.0.0.1:0", "ws://localhost:0"])
def test_without_a_host_it_listens_on_this_machine_alone(text: str) -> None:
    with listening(text) as source:
        assert source.listens == f"listening at {source.url}, to this machine alone"
        assert source.url.startswith("ws://127.0.0.1:")
        with pytest.raises(InputError, match="cannot listen there"), open_source(source.url):
            pass


def test_a_scene_arrives_and_what_is_no_message_is_left_out() -> None:
    def send(url: str) -> None:
        with connect(url) as client:
            for message in (HEADER, b"\xff\xff", *SAMPLES[:10], "words", b"", HEADER, *SAMPLES[10:]):
                client.send([message[:5], message[5:]] if len(message) > 5 else message)

    with listening() as source, Background(send, source.url):
        setup, samples, sentences = received(source)
    assert_arrived(SCENE, setup, samples)
    problems = "bytes are no LiveMessage", "text of 5 characters is no LiveMessage as JSON", "neither header", "second"
    for sentence, problem in zip(sentences, problems, strict=True):
        assert problem in sentence


@pytest.mark.parametrize(
    ("messages", "problem", "code"),
    [
        ((), "no header came within 0.4 s", 1008),
        ((b"x" * 16_777_217,), "larger than 16,777,216 bytes", 1009),
        ((b"\x0a\x03Ada\x1a\x00",), "before its header", 1008),
    ],
)
def test_a_bad_client_is_sent_away_with_one_line_and_the_next_is_heard(
    messages: tuple[bytes, ...], problem: str, code: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(network, "HEADER_S", 0.4)
    findings: list[LiveFinding] = []
    with listening(on_finding=findings.append) as source:
        with connect(source.url) as client:
            for message in messages:
                client.send(message)
            assert close_code(client) == code
        with Background(send_scene, source.url, SCENE):
            setup, samples, sentences = received(source)
    assert_arrived(SCENE, setup, samples)
    assert sentences == []
    (finding,) = findings
    assert problem in finding.sentence
    assert "waiting for the next client" in finding.sentence


@pytest.mark.parametrize("sent", [1, 50])
@pytest.mark.parametrize("stays", [True, False])
def test_a_header_claims_nothing(sent: int, stays: bool) -> None:
    """Whoever connects first, even with a few samples, does not keep the sender out."""
    stranger = list(live_messages(of_another_wearer()))[:sent]
    with listening() as source:
        with connect(source.url) as client:
            for message in stranger:
                client.send(message)
            if stays:
                with Background(send_scene, source.url, SCENE):
                    setup, samples, _ = received(source)
        if not stays:
            with Background(send_scene, source.url, SCENE):
                setup, samples, _ = received(source)
    assert_arrived(SCENE, setup, samples)


def test_a_second_sender_waits_until_the_first_has_gone_or_is_silent() -> None:
    with listening(settings=ONCE_MORE) as source, connect(source.url) as first:
        for message in (HEADER, *SAMPLES):
            first.send(message)
        source.setup  # noqa: B018
        for _ in range(2):  # the first is connected all the time
            with Background(send_scene, source.url, SCENE):
                pass
        first.close()
        setup, samples, sentences = received(source)
    for turn in range(3):
        assert_arrived(SCENE, setup, samples[turn * len(SAMPLES) : (turn + 1) * len(SAMPLES)])
    assert ["has left after" in sentence for sentence in sentences] == [True, True, True]


def test_senders_that_say_nothing_make_room() -> None:
    with listening() as source, ExitStack() as stack:
        for _ in range(MOST_SENDERS):
            stack.enter_context(connect(source.url)).send(HEADER)
        time.sleep(network.SILENCE_S)
        with Background(send_scene, source.url, SCENE):
            setup, samples, _ = received(source)
    assert_arrived(SCENE, setup, samples)


def test_another_set_up_is_refused() -> None:
    with listening(settings=ONCE_MORE) as source:
        with Background(send_scene, source.url, SCENE):
            source.setup  # noqa: B018
        with connect(source.url) as client:
            client.send(next(live_messages(of_another_wearer())))
            assert close_code(client) == 1008
        setup, samples, sentences = received(source)
    assert_arrived(SCENE, setup, samples)
    assert any("other wearers" in sentence for sentence in sentences)


def test_a_sender_that_vanishes_is_told_and_may_come_back() -> None:
    with listening(settings=ONCE_MORE) as source:
        with connect(source.url) as client:
            for message in (HEADER, *SAMPLES):
                client.send(message)
            source.setup  # noqa: B018
            client.socket.close()
        with Background(send_scene, source.url, SCENE):
            setup, samples, sentences = received(source)
    assert_arrived(SCENE, setup, samples[-len(SAMPLES) :])
    assert "connection was lost" in sentences[0]
    assert len(sentences) == 2


def test_a_token_comes_from_a_file_or_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    assert read_token() == ""
    monkeypatch.setenv(VARIABLE, "secret")
    assert read_token() == "secret"
    (tmp_path / "token").write_text("of a file\n")
    assert read_token(tmp_path / "token") == "of a file"
    (tmp_path / "token").write_text("\n")
    with pytest.raises(InputError, match="it is empty"):
        read_token(tmp_path / "token")


def test_a_flood_waits_and_fills_no_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(network, "LARGEST_RATE", 500.0)
    with listening(settings=replace(PATIENT, queue_limit=500)) as source:
        is_over = Event()

        def pour() -> None:
            with connect(source.url, close_timeout=0.5) as client:  # nobody reads its goodbye
                client.send(HEADER)
                for _ in range(1200 // len(SAMPLES)):
                    for message in SAMPLES:
                        client.send(message)
            is_over.set()

        with Background(pour):
            assert source.setup.wearers
            before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            assert is_over.wait(20)  # nobody takes anything out of the queue
        assert len(source._queue) <= 500 + MOST_FINDINGS
        waiting = [*source._early, *(item for _, item in source._queue._items)]
        assert any("has to wait" in item.sentence for item in waiting if isinstance(item, LiveFinding))
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 20_000  # KiB


def test_findings_that_nobody_takes_are_bounded() -> None:
    queue = LiveQueue(10)
    for number in range(3 * MOST_FINDINGS):
        queue.put(LiveFinding(str(number)))
        queue.put(VideoFrame("camera", float(number), None, None))
    assert len(queue) <= MOST_FINDINGS + 10


INTERRUPTED = """
import sys, threading
from vip_factors.io.live_open import open_source
try:
    with open_source(sys.argv[1]) as source:
        print("open", flush=True)
        source.setup
except KeyboardInterrupt:
    print("interrupted", threading.active_count(), flush=True)
"""


@pytest.mark.parametrize("text", ["ws://127.0.0.1:0", "-"])
def test_an_interrupt_ends_the_waiting(text: str) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", INTERRUPTED, text],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "open\n"
        process.send_signal(signal.SIGINT)
        assert process.stdout.readline() == "interrupted 1\n"
        assert process.wait(20) == 0


def test_the_example_sender_is_understood() -> None:
    script = str(ROOT / "data_schemas" / "example_sender.py")
    assert "vip_factors." not in Path(script).read_text(encoding="utf-8")
    with listening(token="secret") as source:
        address = source.url.partition("?")[0]
        environment = {**os.environ, VARIABLE: "secret"}
        with subprocess.Popen([sys.executable, script, address, "1.5"], env=environment) as sender:
            setup, samples, sentences = received(source)
        assert sender.returncode == 0
    assert [wearer.subject.name for wearer in setup.wearers] == ["Ada"]
    placed = {site.sensor for site in setup.wearers[0].placement.sites}
    assert {(sample.carrier, sample.sensor) for sample in samples} == {("Ada", name) for name in placed}
    assert all(sample.R_inertial_sensor is not None and sample.specific_force is not None for sample in samples)
    assert sentences == []


def test_samples_as_json_are_those_of_the_binary_messages() -> None:
    def send(url: str) -> None:
        with connect(url) as client:
            for message in (HEADER, *SAMPLES[:20], b"", *SAMPLES[20:]):
                client.send(MessageToJson(LiveMessage.FromString(message), preserving_proto_field_name=True))
            client.send('{"imu": {"sensor": "head", "secnods": 1}}')
            client.send("[" * 100_000)

    with listening() as source, Background(send, source.url):
        setup, samples, sentences = received(source)
    assert_arrived(SCENE, setup, samples)
    assert len(sentences) == 3
    assert "neither header nor sample" in sentences[0]
    assert any('no field named "secnods"' in sentence for sentence in sentences[1:])


def test_the_page_says_what_the_stream_waits_for_and_why_angles_of_six_sensors_are_missing() -> None:
    """The command, and the documented sender: nobody there, then a stream."""
    command = [sys.executable, "-m", "vip_factors", "stream", "ws://:0", "--web", str(free_port()), "--json"]
    command += ["--limits.next-client-wait", "0"]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as stream:
        told = [stream.stderr.readline() for _ in range(2)]
        where, page = (line.split(" at ")[1].split(",")[0] for line in told)

        def shown() -> str:
            with urllib.request.urlopen(page) as answer:
                return answer.read().decode()

        assert f"waiting for a sender at {where} (a header, then a second of samples" in shown()
        script = str(ROOT / "data_schemas" / "example_sender.py")
        sender = subprocess.Popen([sys.executable, script, where, "4"])
        first = json.loads(stream.stdout.readline())
        assert first["wearers"][0]["guessed_angles"]["left_knee"] == "no sensor on left thigh"
        live = shown()
        assert "waiting for a sender" not in live
        assert "<li>left knee: no sensor on left thigh</li>" in live
        assert "a second of samples of head, pelvis, left_forearm" in live
        _, told_last = stream.communicate(timeout=60)
        assert (sender.wait(), stream.returncode) == (0, 0)
        assert "verdict: " in told_last
        assert "DOUBT" not in told_last


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as found:
        return found.getsockname()[1]
