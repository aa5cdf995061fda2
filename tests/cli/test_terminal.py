"""Where stderr is no terminal, long work says now and then how far it is."""

import sys
from dataclasses import replace
from io import StringIO
from pathlib import Path
from threading import Event

import pytest

import vip_factors as vip
from vip_factors.cli import terminal
from vip_factors.io.mcap_recording import read_scene


class Pipe(StringIO):
    """Standard error of a program in a pipe, that tells when a line came."""

    def __init__(self) -> None:
        super().__init__()
        self.came = Event()

    def write(self, text: str) -> int:
        written = super().write(text)
        self.came.set()
        return written

    def wait(self) -> str:
        self.came.clear()
        assert self.came.wait(30), "nothing was said"
        return self.getvalue()


def piped(monkeypatch: pytest.MonkeyPatch) -> Pipe:
    """In the test itself: between fixtures and test pytest puts its own standard error back."""
    made = Pipe()
    monkeypatch.setattr(sys, "stderr", made)
    monkeypatch.setattr(terminal, "LINE_S", 0.01)
    return made


def test_a_pipe_hears_stage_and_share(monkeypatch: pytest.MonkeyPatch) -> None:
    pipe = piped(monkeypatch)
    with terminal.progress_bar() as tell:
        tell("sparse inertial poser", 0.4)
        pipe.wait()
        pipe.wait()
    assert "sparse inertial poser, 40 % (0 s)\n" in pipe.getvalue()
    said = pipe.getvalue()
    assert "\x1b" not in said  # no colours, no moving cursor
    assert "\r" not in said


def test_stages_tell_frames_share_and_time_left_and_are_never_wholly_done(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [0.0]
    monkeypatch.setattr(terminal.time, "monotonic", lambda: clock[0])
    stages = terminal.Stages(36_000)
    assert str(stages) == "starting"
    stages.update("calibration", 0.0)
    assert str(stages) == "calibration, 36,000 frames"  # nothing is known yet
    clock[0] = 10.0
    stages.update("calibration", 0.25)
    assert str(stages) == "calibration, 36,000 frames, 25 %, 30 s left"
    stages.update("calibration", 0.2)  # a solve that was further before
    clock[0] = 20.0
    assert str(stages) == "calibration, 36,000 frames, 25 %, 20 s left"
    stages.update("calibration", 1.0)
    assert str(stages) == "calibration, 36,000 frames, 99 %"
    stages.update("calibration", 0.5)
    assert str(stages).startswith("calibration 2, 36,000 frames, 50 %")
    clock[0] = 620.0
    stages.update("windows", 0.0)
    clock[0] += 600.0
    stages.update("windows", 0.5)
    assert str(stages) == "windows, 36,000 frames, 50 %, 10 min left"


def test_a_pipe_hears_what_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    pipe = piped(monkeypatch)
    with terminal.waiting("reading a log"):
        assert pipe.wait().startswith("reading a log (")


def test_short_work_says_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    pipe = Pipe()
    monkeypatch.setattr(sys, "stderr", pipe)
    with terminal.progress_bar() as tell, terminal.waiting("a moment"):
        tell("stage", 0.5)
    assert pipe.getvalue() == ""


def test_errors_pass_and_the_thread_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    pipe = piped(monkeypatch)
    with pytest.raises(ZeroDivisionError), terminal.waiting("dividing"):
        raise ZeroDivisionError
    said = pipe.getvalue()
    assert not pipe.came.wait(0.05) or pipe.getvalue() == said


def test_a_stream_in_a_pipe_tells_its_status_now_and_then(monkeypatch: pytest.MonkeyPatch) -> None:
    pipe, clock = Pipe(), [0.0]
    monkeypatch.setattr(sys, "stderr", pipe)
    monkeypatch.setattr(terminal.time, "monotonic", lambda: clock[0])
    with terminal.StatusLine() as line, terminal.StatusLine(wanted=False) as silent:
        line.show("1 s tracked")  # too soon
        clock[0] = terminal.STREAM_LINE_S
        assert line.shown
        assert not silent.shown
        line.show("10 s tracked")
        assert not line.shown
    assert pipe.getvalue() == "10 s tracked\n"


@pytest.mark.parametrize(
    ("name", "escaped"),
    [
        ("Ada \x1b]0;title\x07\x1b[2J", r"Ada \x1b]0;title\x07\x1b[2J"),
        ("a\nb\r\x9bc\u202etxt\u2028", r"a\nb\r\x9bc\u202etxt\u2028"),
        ("Zoë ± 3°, 名前", "Zoë ± 3°, 名前"),
    ],
)
def test_names_do_not_steer_the_terminal(name: str, escaped: str, capsys: pytest.CaptureFixture[str]) -> None:
    terminal.note(f"note: {name}")
    assert capsys.readouterr().err == f"note: {escaped}\n"


def test_wearers_of_files_do_not_steer_the_terminal(run, files, tmp_path: Path) -> None:
    scene = read_scene(files.recording)
    wearer = replace(scene.wearers[0], name="walk\x1b[2J")
    recording = vip.write(replace(scene, wearers=(wearer,)), tmp_path / "walk.mcap")
    outcome = run("smooth", recording, "--frame-rate", "10", "--solve.max-iterations", "1")
    assert r"walk\x1b[2J" in outcome.out
    missing = run("smooth", tmp_path / "\x1b[2Jnone.mcap")
    assert "\x1b" not in outcome.out + outcome.err + missing.err
