"""Rerun's program as a server and as a window: whom it listens to, and that nothing of it is left."""

import os
import re
import socket
import time
from pathlib import Path

import pytest
import rerun as rr

from vip_factors.errors import InputError
from vip_factors.viz import viewer
from vip_factors.viz.viewer import address, open_viewer, serve

PATIENCE_S = 60.0


@pytest.fixture
def port() -> int:
    """A free one; the one after it is most likely free too."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return min(int(probe.getsockname()[1]), 65000)


def test_ports_that_cannot_be_listened_at_are_said(tmp_path: Path, port: int) -> None:
    with socket.create_server(("127.0.0.1", port + 1)), pytest.raises(InputError, match=f"{port + 1}.*--port"):
        serve(tmp_path / "a.rrd", "127.0.0.1", port, print)


def test_the_address_names_this_machine_where_all_may_come() -> None:
    name = socket.gethostname()
    assert address("0.0.0.0", 80) == f"http://{name}:80/?url=rerun%2Bhttp://{name}:81/proxy"
    assert address("::1", 80).startswith("http://[::1]:80/")


def test_a_window_listens_to_this_machine_and_reports_to_nobody(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:  # fmt: skip
    program = tmp_path / "rerun"
    program.write_text(
        f'#!/bin/sh\nprintf "%s " "$CI" "$@" > {tmp_path}/partial; mv {tmp_path}/partial {tmp_path}/said\n'
    )
    program.chmod(0o755)
    monkeypatch.setattr(viewer, "rerun_command", lambda: str(program))
    monkeypatch.setenv("DISPLAY", ":7")
    monkeypatch.delenv("CI", raising=False)
    open_viewer(rr.RecordingStream("test"), "a file")
    until = time.monotonic() + PATIENCE_S
    while not (tmp_path / "said").exists():
        assert time.monotonic() < until
        time.sleep(0.05)
    assert re.match("true --bind 127.0.0.1 ", (tmp_path / "said").read_text())
    assert "CI" not in os.environ
