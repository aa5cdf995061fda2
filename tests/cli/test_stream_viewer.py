"""``stream --rerun-connect`` with a server of Rerun's own: it gets what is drawn, and may hang without harm."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from stub_tracker import scene_file

STUB = Path(__file__).parents[1] / "stub_tracker.py"
PATIENCE_S = 60.0


@pytest.fixture
def server() -> Iterator[tuple[subprocess.Popen, int]]:
    """Rerun's program, and the port at which it takes in streams."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = int(probe.getsockname()[1])
    command = [str(Path(sys.executable).with_name("rerun")), "--serve-grpc", "--bind", "127.0.0.1", "--port", str(port)]
    null = subprocess.DEVNULL
    process = subprocess.Popen(
        command, stdout=null, stderr=null, start_new_session=True, env={**os.environ, "CI": "true"}
    )
    until = time.monotonic() + PATIENCE_S
    while True:
        try:
            socket.create_connection(("127.0.0.1", port), timeout=1).close()
            break
        except ConnectionRefusedError:
            assert time.monotonic() < until
            time.sleep(0.05)
    yield process, port
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def stream(scene: Path, port: int, *options: str) -> subprocess.Popen:
    target = f"rerun+http://127.0.0.1:{port}/proxy"
    command = [sys.executable, str(STUB), str(scene), "stream", str(scene), "--rerun-connect", target, *options]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)


@pytest.mark.parametrize("number", [signal.SIGKILL, pytest.param(signal.SIGSTOP, marks=pytest.mark.slow)])
def test_a_viewer_that_ends_or_hangs_changes_nothing(
    tmp_path: Path, server: tuple[subprocess.Popen, int], number: signal.Signals
) -> None:
    rerun, port = server
    with stream(scene_file(tmp_path, seconds=3.0), port, "--real-time", "--json") as process:
        for _ in range(90):
            process.stdout.readline()
        os.killpg(rerun.pid, number)
        told = process.communicate(timeout=PATIENCE_S)[1]
    assert process.returncode == 0, told
    assert "181 frames" in told
    assert "Traceback" not in told
    assert {signal.SIGKILL: "viewer was closed", signal.SIGSTOP: "took nothing"}[number] in told
