"""What is shown while one waits: lines in a pipe, nothing that steers a terminal."""

import io
import sys
from dataclasses import replace
from pathlib import Path

import pytest

import vip_factors as vip
from vip_factors.cli import terminal
from vip_factors.io.mcap_recording import read_scene


def test_a_pipe_hears_stage_and_share_now_and_then(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = [0.0]
    monkeypatch.setattr(terminal.time, "monotonic", lambda: clock[0])
    with terminal.progress_bar() as progress, terminal.waiting("a moment"):
        progress("calibration", 0.1)
        clock[0] = terminal.LINE_S + 1.0
        progress("calibration", 0.4)
        progress("calibration", 0.5)
    assert capsys.readouterr().err == "calibration, 40 % (6 s)\n"


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_terminal_shows_bars_of_stages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", Terminal())
    with terminal.progress_bar() as progress:
        progress("calibration", 1.0)
        progress("windows of [bold]Ada\x1b[2J", 0.25)
    shown = sys.stderr.getvalue()  # type: ignore[attr-defined]
    assert r"windows of [bold]Ada\x1b[2J" in shown
    assert "25%" in shown


def test_a_stream_in_a_pipe_tells_its_status_now_and_then(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = [0.0]
    monkeypatch.setattr(terminal.time, "monotonic", lambda: clock[0])
    with terminal.StatusLine() as line, terminal.StatusLine(wanted=False) as silent:
        line.show("1 s tracked")  # too soon
        clock[0] = terminal.STREAM_LINE_S
        assert line.shown
        assert not silent.shown
        line.show("10 s tracked")
        assert not line.shown
    assert capsys.readouterr().err == "10 s tracked\n"


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


@pytest.mark.parametrize(
    "words",
    ["smooth RECORDING --frame-rate 10 --solve.max-iterations 1", "info RECORDING", "graph RECORDING --picture PICTURE",
     "stream RECORDING --frame-rate 10 --recalibration.no-use", "export none\x1b]0.mcap out.bvh"],
)  # fmt: skip
def test_names_of_files_do_not_steer_the_terminal(words: str, run, files, tmp_path: Path) -> None:
    scene = read_scene(files.recording)
    wearer = scene.wearers[0]
    placement = replace(
        wearer.placement,
        sites=tuple(replace(site, sensor=f"{site.sensor}\x1b[2J") for site in wearer.placement.sites),
    )
    wearer = replace(
        wearer,
        name="walk\x1b[2J",
        subject=replace(wearer.subject, name="Ada\x1b]0;title\x07"),
        imus={f"{name}\x1b[2J": replace(stream, name=f"{name}\x1b[2J") for name, stream in wearer.imus.items()},
        placement=placement,
        truth=None,
    )
    recording = vip.write(replace(scene, wearers=(wearer,)), tmp_path / "walk.mcap")
    named = {"RECORDING": recording, "PICTURE": tmp_path / "graph.svg"}
    outcome = run(*(named.get(word, word) for word in words.split()))
    told = outcome.out + outcome.err
    assert set(terminal.CONTROL.findall(told)) == {"\n"}
    assert words.startswith("stream") or "\\x1b" in told
