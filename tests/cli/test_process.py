"""The command line among other processes: its streams, its signals, its exit code."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from vip_factors.cli.main import main


def test_no_output_is_there_or_it_knows_no_degrees(files) -> None:
    info = [sys.executable, "-m", "vip_factors", "info", str(files.estimate)]
    ascii_only = {**os.environ, "PYTHONIOENCODING": "ascii:strict"}
    told = subprocess.run(info, capture_output=True, env=ascii_only, check=False)
    assert (told.returncode, told.stderr) == (0, b"")
    assert b"\\xb0" in told.stdout
    closed = subprocess.run(["sh", "-c", '"$@" >&-', "sh", *info], stderr=subprocess.PIPE, check=False)
    assert (closed.returncode, closed.stderr) == (0, b"")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full (Linux)")
@pytest.mark.parametrize("words", ["--version", "info --help", "info"])
def test_a_full_disk_behind_standard_output_is_named(files, words: str) -> None:
    given = [*words.split(), *([str(files.estimate)] if words == "info" else [])]
    with open("/dev/full", "w") as full:
        told = subprocess.run(
            [sys.executable, "-m", "vip_factors", *given], stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert (told.returncode, told.stderr) == (2, "vip-factors: standard output: No space left on device\n")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_leave_nothing_half_written(run, files, tmp_path: Path, monkeypatch, number: int) -> None:
    def signalled(*_: object, **__: object) -> None:
        os.kill(os.getpid(), number)

    monkeypatch.setattr("vip_factors.io.mcap_messages.MessageWriter.add_in_order", signalled)
    before = signal.getsignal(number)
    told = run(
        "smooth", files.recording, "--out", tmp_path / "e.mcap", "--frame-rate", "5", "--solve.max-iterations", "1"
    )
    assert told.code == 128 + number
    assert told.err == "vip-factors: interrupted; nothing half-written is left\n"
    assert list(tmp_path.iterdir()) == []
    assert signal.getsignal(number) == before


def test_a_signal_while_a_compiled_module_is_loaded(monkeypatch: pytest.MonkeyPatch) -> None:
    def loaded(name: str) -> None:
        try:
            os.kill(os.getpid(), signal.SIGINT)
        except KeyboardInterrupt:
            raise ImportError("initialization failed") from None

    monkeypatch.setattr("vip_factors.cli.main.import_module", loaded)
    assert main(["smooth"]) == 130
