"""``vip-factors stream``: sources in, sinks out, and every way to end."""

import json
import os
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from live_answers import answer, live_scene
from running_processes import begun_by
from stub_tracker import scene_file, tracker_class

from vip_factors.cli.main import main
from vip_factors.cli.stream import Session, status, summary
from vip_factors.cli.terminal import Interrupts, StatusLine
from vip_factors.evaluate.evaluation import evaluate_scene
from vip_factors.findings import sentences
from vip_factors.io.mcap_estimate import read_estimate
from vip_factors.io.mcap_reader import McapWarning
from vip_factors.io.mcap_recording import read_scene
from vip_factors.live.stream import Stream
from vip_factors.live_estimate import LiveEstimate
from vip_factors.sensors.live import LiveFinding, LiveItem, LiveLoss, live_samples

STUB = Path(__file__).parents[1] / "stub_tracker.py"
FRAMES = 61  # of a second
TRACKER = "vip_factors.live.stream.FixedLagTracker"


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return scene_file(tmp_path_factory.mktemp("stream"))


@pytest.fixture(scope="module")
def long_scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return scene_file(tmp_path_factory.mktemp("long"), seconds=3.0)


@pytest.fixture
def stubbed(monkeypatch: pytest.MonkeyPatch, scene: Path) -> None:
    monkeypatch.setattr(TRACKER, tracker_class(read_scene(scene)))


@pytest.mark.usefixtures("stubbed")
def test_a_recording_is_played_into_all_sinks(run: Callable, scene: Path, tmp_path: Path) -> None:
    out, rrd = tmp_path / "e.mcap", tmp_path / "e.rrd"
    done = run("stream", scene, "--out", out, "--json", "--rerun-save", rrd, "--frame-rate", 60)
    assert done.code == 0, done.err
    lines = [json.loads(line) for line in done.out.splitlines()]
    assert [line["frame"] for line in lines] == list(range(FRAMES))
    assert lines[0]["findings"][0]["text"] == "the stream has begun"
    told = done.err.splitlines()
    assert told[0] == "care: the stream has begun"
    assert f"{FRAMES} frames; update: median 5.0 ms" in told[1]
    assert told[2:] == ["verdict: CARE, usable with care: Other remark", str(out), str(rrd)]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["e.mcap", "e.rrd"]
    estimate = read_estimate(out)
    assert estimate.settings["lag_s"] == "0.25"
    assert len(estimate.wearers) == 2
    evaluation = run("evaluate", out, "--truth", scene)
    assert evaluation.code == 0, evaluation.err
    assert run("view", out, scene, "--save", tmp_path / "view.rrd").code == 0
    assert "fixed lag" in run("info", out).out


@pytest.mark.usefixtures("stubbed")
def test_avatars_get_poses(run: Callable, scene: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ear:
        ear.bind(("127.0.0.1", 0))
        ear.settimeout(10)
        port = ear.getsockname()[1]
        done = run("stream", scene, "--vmc", f"127.0.0.1:{port}")
        assert done.code == 0, done.err
        heard = b"".join(ear.recv(65536) for _ in range(40))  # of 122: more may not fit into the socket's buffer
    assert heard.count(b"/VMC/Ext/OK") == 20
    assert f"ann on port {port}, bob on port {port + 1}" in done.err
    done = run("stream", scene, "--vmc", "nowhere")
    assert done.code == 2
    assert "host:port" in done.err


@pytest.mark.usefixtures("stubbed")
def test_a_live_page_says_where_it_is_and_for_whom(run: Callable, scene: Path, tmp_path: Path) -> None:
    pytest.importorskip("websockets", reason="needs the extra live")
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    done = run("stream", scene, "--web", port)
    assert done.code == 0, done.err
    assert f"note: the live page is at http://127.0.0.1:{port}/, for this machine alone" in done.err
    (tmp_path / "token").write_text("correct horse\n")
    done = run("stream", scene, "--web", port, "--web-host", "0.0.0.0", "--token-file", tmp_path / "token")
    assert f":{port}/?token=…, for whoever has the token; nothing is encrypted" in done.err


@pytest.mark.usefixtures("stubbed")
def test_settings_come_from_a_file_and_options_win(run: Callable, scene: Path, tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text("lag_s = 0.5\nstart_s = 2\n[walk]\nheading_deg = 0.7\n")
    out = tmp_path / "e.mcap"
    done = run("stream", scene, "--settings", tmp_path / "s.toml", "--lag", "0.1", "--out", out)
    assert done.code == 0, done.err
    settings = read_estimate(out).settings
    assert (settings["lag_s"], settings["start_s"], settings["walk.heading_deg"]) == ("0.1", "2.0", "0.7")
    (tmp_path / "bad.toml").write_text("lagg_s = 0.5\n")
    done = run("stream", scene, "--settings", tmp_path / "bad.toml")
    assert done.code == 2
    assert "did you mean 'lag_s'" in done.err


@pytest.mark.usefixtures("stubbed")
def test_bad_input_is_one_sentence(run: Callable, scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "e.mcap"
    out.write_bytes(b"mine")
    for arguments, sentence in (
        ((scene, "--out", out), "exists already"),
        ((scene, "--lag", "-1"), "lag_s is -1.0: expected a finite number, more than 0"),
        ((tmp_path / "none.mcap",), "no such file"),
        (("carrier-pigeon://host:1",), "carrier-pigeon"),
        (("ws://127.0.0.1:9", "--follow"), "MCAP files only"),
    ):
        done = run("stream", *arguments)
        assert done.code == 2, arguments
        assert sentence in done.err
        assert done.err.startswith("vip-factors: ")
        assert len(done.err.splitlines()) == 1
    assert out.read_bytes() == b"mine"


def test_a_stream_too_short_leaves_nothing(
    run: Callable, scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tracker = tracker_class(read_scene(scene))
    monkeypatch.setattr(tracker, "push", lambda self, sample: [])
    monkeypatch.setattr(tracker, "finish", lambda self: [])
    monkeypatch.setattr(TRACKER, tracker)
    done = run("stream", scene, "--out", tmp_path / "e.mcap")
    assert done.code == 2
    assert "ended before there was anything to answer" in done.err
    assert list(tmp_path.iterdir()) == []


def start(scene: Path, *arguments: object) -> subprocess.Popen:
    command = [sys.executable, str(STUB), str(scene), "stream", str(scene), *map(str, arguments)]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)


def test_ctrl_c_ends_the_stream_in_order(long_scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "e.mcap"
    process = start(long_scene, "--real-time", "--json", "--out", out, "--rerun-save", tmp_path / "e.rrd")
    lines = [json.loads(process.stdout.readline()) for _ in range(40)]
    process.send_signal(signal.SIGINT)
    rest, told = process.stdout.read(), process.stderr.read()
    assert process.wait(60) == 130, told
    lines += [json.loads(line) for line in rest.splitlines()]  # no half line
    assert [line["frame"] for line in lines] == list(range(len(lines)))
    assert len(lines) < 150
    assert "frames; update" in told
    assert "Traceback" not in told
    estimate = read_estimate(out)
    assert len(estimate.wearers[0].motion) == len(lines) - 15
    assert sorted(path.name for path in tmp_path.iterdir()) == ["e.mcap", "e.rrd"]


def test_nobody_reads_the_lines_any_more(long_scene: Path, tmp_path: Path) -> None:
    process = start(long_scene, "--json", "--out", tmp_path / "e.mcap")
    for _ in range(40):
        process.stdout.readline()
    process.stdout.close()
    told = process.stderr.read()
    assert process.wait(60) == 0, told
    assert "Traceback" not in told
    assert "Exception ignored" not in told
    assert len(read_estimate(tmp_path / "e.mcap").wearers) == 2


def test_a_killed_stream_leaves_what_it_had(run: Callable, long_scene: Path, tmp_path: Path) -> None:
    process = start(long_scene, "--real-time", "--json", "--out", tmp_path / "e.mcap")
    for _ in range(90):
        process.stdout.readline()
    process.kill()
    process.communicate()
    with pytest.warns(McapWarning, match="cut off"):
        estimate = read_estimate(tmp_path / "e.partial.mcap")
    assert len(estimate.wearers[0].motion) >= 90 - 15 - 32
    again = run("stream", long_scene, "--out", tmp_path / "e.mcap")
    assert again.code == 2
    assert "killed" in again.err


def test_sigterm_ends_a_server_that_waits(scene: Path) -> None:
    command = [sys.executable, str(STUB), str(scene), "stream", "ws://127.0.0.1:0"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert "127.0.0.1" in process.stderr.readline()
    process.terminate()
    told = process.stderr.read()
    assert process.wait(60) == 143
    assert told == "vip-factors: interrupted\n"
    process.stdout.close()
    process.stderr.close()


LIMITED = """
import resource, runpy, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), int(sys.argv[1])))
sys.argv = sys.argv[2:]
sys.path.insert(0, sys.argv[0].rpartition("/")[0])
runpy.run_path(sys.argv[0], run_name="__main__")
"""


@pytest.mark.parametrize(
    ("option", "name", "told"),
    [
        ("--out", "e.mcap", "vip-factors: {partial}: File too large"),
        (
            "--rerun-save",
            "e.rrd",
            "vip-factors: {out}: it was not written whole; what there is of it is in {partial}",
        ),
    ],
)
def test_a_full_disk_is_told_with_the_file(long_scene: Path, tmp_path: Path, option: str, name: str, told: str) -> None:
    out = tmp_path / name
    partial = out.with_suffix(f".partial{out.suffix}")
    command = [sys.executable, "-c", LIMITED, "100000", str(STUB), str(long_scene), "stream", str(long_scene)]
    done = subprocess.run([*command, option, str(out)], capture_output=True, text=True, check=False)
    assert done.returncode == 2, done.stderr
    assert done.stderr.splitlines()[-1] == told.format(out=out, partial=partial)
    assert "Traceback" not in done.stderr
    assert not out.exists()
    if option == "--out":
        with pytest.warns(McapWarning, match="cut off"):
            assert len(read_estimate(partial).wearers) == 2


class Silent:
    """A tracker that answers at the end."""

    def __init__(self, *_: object) -> None:
        self.is_told_of_loss, self.behind_s = False, 0.0

    def note_loss(self) -> None:
        self.is_told_of_loss = True

    def note_behind(self, seconds: float) -> None:
        self.behind_s = seconds

    def push(self, sample: object) -> list[LiveEstimate]:
        return []

    def finish(self) -> list[LiveEstimate]:
        return [answer(live_scene(0.1), 0)]


def test_findings_of_the_source_are_told_at_once_and_answered(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(TRACKER, Silent)
    scene = live_scene(0.1)
    session = Session([], [], StatusLine(False))
    stream = Stream(scene, on_finding=session.report)
    assert stream.take(LiveFinding("sensor 'x' is nobody's: its samples are left out")) == []
    assert capsys.readouterr().err == "care: sensor 'x' is nobody's: its samples are left out\n"
    assert stream.take(next(iter(live_samples(scene))), 0.25) == []
    assert stream._tracker.behind_s == 0.25
    stream.take(LiveLoss("the tracker does not keep up", is_repeat=True))
    assert stream._tracker.is_told_of_loss
    (last,) = stream.finish()
    assert sentences(last.findings) == (
        "sensor 'x' is nobody's: its samples are left out",
        "the stream has begun",
    )
    assert capsys.readouterr().err == "care: the stream has begun\n"


def test_an_interrupt_waits_for_the_update_to_end() -> None:
    def forever() -> object:
        while True:
            yield LiveFinding("x")

    seen = 0
    with Interrupts() as interrupts:
        for _ in interrupts.until_asked(forever()):
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.01)  # an update, which is not disturbed
            seen += 1
    assert seen == 1
    assert interrupts.asked
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler

    def waiting() -> object:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(5)
        yield LiveFinding("x")

    with Interrupts() as interrupts:
        items: list[LiveItem] = list(interrupts.until_asked(waiting()))
    assert items == []
    assert interrupts.asked


def test_an_interrupt_before_the_wait_is_not_waited_over() -> None:
    with Interrupts() as interrupts:
        os.kill(os.getpid(), signal.SIGTERM)
        with pytest.raises(KeyboardInterrupt):
            interrupts.waiting_for(lambda: pytest.fail("waited"))
        assert list(interrupts.until_asked(iter([LiveFinding("x")]))) == []
    assert interrupts.exit_code == 128 + signal.SIGTERM


def test_the_status_and_the_summary() -> None:
    line = status(answer(live_scene(0.3), 9), np.array([0.004, 0.006]))
    assert line == "frame 9 | 0.1 s | update 5.0 ms, p99 6.0 ms | seen: ann, bob | headings ±2.9°, head ±2.9°"
    told = summary([0.005] * 99 + [0.02], 60.0)
    assert told == "100 frames; update: median 5.0 ms, 95 % 5.0 ms, 99 % 5.2 ms, worst 20.0 ms (a frame lasts 16.7 ms)"


@pytest.mark.skipif(sys.platform != "linux", reason="processes are looked for in /proc")
def test_an_answer_that_never_comes_does_not_keep_the_stream_from_ending(tmp_path: Path) -> None:
    recording, out = tmp_path / "walk.mcap", tmp_path / "live.mcap"
    assert main(["simulate", "gestures", str(recording), "--seconds", "6", "--placement", "sip6"]) == 0
    command = [sys.executable, "-m", "vip_factors", "stream", str(recording), "--json", "--out", str(out)]
    command += ["--frame-rate", "20"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    lines = 0
    try:
        while not (below := begun_by(process.pid)):  # until the calibration is looked for in a process of its own
            lines += bool(process.stdout.readline())
        os.kill(below[0], signal.SIGSTOP)
        while select.select([process.stdout], [], [], 1.0)[0] and process.stdout.readline():
            lines += 1
        process.terminate()
        rest, told = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 143, told
    assert "Traceback" not in told
    assert lines + rest.count("\n") < 6 * 20
    assert len(read_estimate(out).wearers[0].motion) > 20


def test_the_real_tracker_end_to_end(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recording, out = tmp_path / "walk.mcap", tmp_path / "live.mcap"
    assert main(["simulate", "gestures", str(recording), "--seconds", "2", "--placement", "sip6"]) == 0
    capsys.readouterr()
    assert main(["stream", str(recording), "--out", str(out), "--json", "--frame-rate", "20"]) == 0
    told = capsys.readouterr()
    lines = [json.loads(line) for line in told.out.splitlines()]
    assert [line["frame"] for line in lines] == list(range(len(lines)))
    assert len(lines) > 3 * 20
    assert lines[-1]["wearers"][0]["smoothed"] is not None
    estimate, scene = read_estimate(out), read_scene(recording)
    assert len(estimate.wearers[0].motion) > 2.7 * 20
    metrics = evaluate_scene(estimate, scene).wearers[scene.wearers[0].subject.name].metrics
    assert metrics["mpjpe"].value < 150.0
