"""``view``: what is made sure of before a viewer is started, and to whom its page is served."""

import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from urllib.request import urlopen

import pytest

from tests.studies.processes import begun_by, is_running

PATIENCE_S = 60.0


@pytest.fixture
def headless(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)


@pytest.mark.usefixtures("headless")
def test_without_a_display_a_window_is_refused_in_one_sentence(run: Callable, files) -> None:
    done = run("view", files.recording)
    assert (done.code, done.out) == (2, "")
    assert done.err == "vip-factors: no display: use --serve, --save FILE.rrd or --picture\n"
    done = run("stream", files.recording, "--rerun")
    assert done.code == 2
    assert done.err.startswith("vip-factors: no display: use --rerun-save FILE.rrd")
    assert len(done.err.splitlines()) == 1


@pytest.mark.parametrize("name", ["x.bvh", "x.npz", "x"])
def test_only_rerun_files_are_written_as_such(run: Callable, files, tmp_path: Path, name: str) -> None:
    for command in (("view", files.recording, "--save"), ("stream", files.recording, "--rerun-save")):
        done = run(*command, tmp_path / name)
        assert done.code == 2
        assert ".rrd" in done.err
        assert "vip-factors export" in done.err
    assert list(tmp_path.iterdir()) == []


def listening(port: int) -> set[str]:
    """Hexadecimal addresses at which somebody listens at a port."""
    lines = [line.split() for name in ("tcp", "tcp6") for line in Path(f"/proc/net/{name}").read_text().splitlines()]
    return {one[1].partition(":")[0] for one in lines if one[1].endswith(f":{port:04X}") and one[3] == "0A"}


@pytest.mark.skipif(sys.platform != "linux", reason="listeners are looked for in /proc")
def test_a_page_is_served_to_this_machine_until_sigterm(files) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = min(int(probe.getsockname()[1]), 65000)
    command = [sys.executable, "-m", "vip_factors", "view", str(files.recording), "--serve", "--port", str(port)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline().startswith(f"http://127.0.0.1:{port}/?url=")
        until = time.monotonic() + PATIENCE_S
        while not (listening(port) and listening(port + 1)):
            assert time.monotonic() < until
            time.sleep(0.05)
        assert listening(port) | listening(port + 1) == {"0100007F"}  # 127.0.0.1
        with urlopen(f"http://127.0.0.1:{port}/") as page:
            assert b"rerun" in page.read().lower()
        below = begun_by(process.pid)
        assert below
        process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE_S) == 0
    while any(map(is_running, below)) and time.monotonic() < until:
        time.sleep(0.05)
    assert not any(map(is_running, below))
