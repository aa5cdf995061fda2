"""Rerun's window: whom it listens to."""

import os
import re
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from vip_factors.viz import viewer
from vip_factors.viz.viewer import open_viewer

PATIENCE_S = 60.0


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
    open_viewer(SimpleNamespace(connect_grpc=lambda: None), "a file")  # type: ignore[arg-type]
    until = time.monotonic() + PATIENCE_S
    while not (tmp_path / "said").exists():
        assert time.monotonic() < until
        time.sleep(0.05)
    assert re.match("true --bind 127.0.0.1 ", (tmp_path / "said").read_text())
    assert "CI" not in os.environ
