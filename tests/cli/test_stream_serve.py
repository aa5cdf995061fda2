"""``stream --rerun-serve`` with Rerun's own program: it listens, speaks gRPC, and nothing of it is left."""

import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from live_sender import write_messages
from stub_tracker import scene_file

from tests.studies.processes import begun_by, is_running
from vip_factors.io.mcap_recording import read_scene

STUB = Path(__file__).parents[1] / "stub_tracker.py"
PATIENCE_S = 60.0
HTTP2 = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"
SETTINGS = bytes([0, 0, 0, 4, 0, 0, 0, 0, 0])  # a frame without content; its fourth byte says what it is


@pytest.mark.slow  # Rerun itself takes seconds
@pytest.mark.skipif(sys.platform != "linux", reason="processes are looked for in /proc")
def test_rerun_serves_and_ends_with_the_stream(tmp_path: Path) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = int(probe.getsockname()[1])
    scene = scene_file(tmp_path)
    command = [sys.executable, str(STUB), str(scene), "stream", "-", "--rerun-serve", str(port)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE}
    process = subprocess.Popen(command, **pipes, env={**os.environ, "OMP_NUM_THREADS": "1"})  # type: ignore[call-overload]
    try:
        write_messages(read_scene(scene), process.stdin)  # which stays open: the stream goes on
        with connected(port) as connection:
            connection.sendall(HTTP2 + SETTINGS)
            assert connection.recv(9)[3] == SETTINGS[3]
        below = begun_by(process.pid)
        assert len(below) >= 2  # the process that draws, and Rerun's program
        process.send_signal(signal.SIGTERM)
        told = process.stderr.read().decode()
        assert process.wait(PATIENCE_S) == 143, told
        assert "Traceback" not in told
        until = time.monotonic() + PATIENCE_S
        while any(map(is_running, below)) and time.monotonic() < until:
            time.sleep(0.05)
        assert not any(map(is_running, below))
    finally:
        process.kill()
        process.stdin.close()
        process.stderr.close()
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.1", port), timeout=1)


def connected(port: int) -> socket.socket:
    until = time.monotonic() + PATIENCE_S
    while True:
        try:
            return socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)
        except ConnectionRefusedError:
            if time.monotonic() > until:
                raise
            time.sleep(0.05)
