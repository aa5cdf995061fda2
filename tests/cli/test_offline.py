"""Nothing that runs needs a network, or even tries one."""

import os
import shutil
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from cli import offline

# Of a program's own network, without any way out; where the kernel lets users have one.
ALONE = ["unshare", "--map-root-user", "--net"]
HASTY = ("--frame-rate", "20", "--solve.max-iterations", "3")
EXPORTS = ("walk.bvh", "walk.npz", "walk.csv", "walk.trc", "walk.mot", "walk.sto")


class Refusals:
    """What was tried; an audit hook stays for good, so it can be switched off."""

    def __init__(self) -> None:
        self.tried: list[str] = []
        self.active = False
        sys.addaudithook(self._heard)

    def _heard(self, event: str, arguments: tuple) -> None:
        if self.active:
            offline.refuse(event, arguments, self.tried.append)


@pytest.fixture(scope="module")
def refusals() -> Refusals:
    return Refusals()


@pytest.fixture
def tried(refusals: Refusals) -> Iterator[list[str]]:
    refusals.tried.clear()
    refusals.active = True
    yield refusals.tried
    refusals.active = False


def commands(folder: Path, recording: Path, estimate: Path) -> Iterator[list[object]]:
    """The README's, on one wearer's files."""
    yield ["info", recording]
    yield ["info", estimate]
    yield ["convert", recording, folder / "again.mcap"]
    yield ["evaluate", estimate, "--truth", recording]
    yield ["export", estimate, *(folder / name for name in EXPORTS)]
    yield ["report", estimate, "--recording", recording, "--out", folder / "walk.html"]
    yield ["view", estimate, recording, "--save", folder / "walk.rrd"]
    yield ["stream", recording, "--out", folder / "live.mcap", "--frame-rate", "10", "--recalibration.no-use"]


def test_what_is_tried_is_refused_and_noted(tried: list[str]) -> None:
    with pytest.raises(PermissionError):
        socket.create_connection(("192.0.2.1", 80), timeout=0.1)
    with pytest.raises(PermissionError):
        socket.getaddrinfo("example.org", 80)
    with socket.create_server(("127.0.0.1", 0)) as server:
        socket.create_connection(server.getsockname(), timeout=5).close()
    assert tried == ["socket.getaddrinfo 192.0.2.1", "socket.getaddrinfo example.org"]


def test_no_command_tries_the_network(run: Callable, files: object, tmp_path: Path, tried: list[str]) -> None:
    for words in commands(tmp_path, files.recording, files.estimate):
        told = run(*words)
        assert told.code == 0, told.err
    assert not tried


@pytest.mark.slow
def test_whole_programs_without_a_network(tmp_path: Path) -> None:
    """Each in a network of its own that leads nowhere, if the system allows it; its children note what they try."""
    hooks, notes = tmp_path / "hooks", tmp_path / "notes"
    hooks.mkdir()
    shutil.copy(offline.__file__, hooks / "sitecustomize.py")
    environment = {
        **{name: value for name, value in os.environ.items() if name != "CI"},
        "PYTHONPATH": os.pathsep.join([str(hooks), *filter(None, [os.environ.get("PYTHONPATH")])]),
        offline.NOTES: str(notes),
    }
    can = shutil.which("unshare") and subprocess.run([*ALONE, "true"], check=False, capture_output=True).returncode == 0

    def program(*words: object) -> None:
        command = [*(ALONE if can else []), sys.executable, "-m", "vip_factors", *map(str, words)]
        done = subprocess.run(
            command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False, timeout=600
        )
        assert done.returncode == 0, f"{words}: {done.stderr}"

    program("demo")
    made = tmp_path / "vip_factors_demo"
    for words in commands(tmp_path, made / "recording.mcap", made / "estimate.mcap"):
        program(*words)
    two = ("--also", "gestures", "--camera", "hand-held", "--seconds", 2, "--heading-offset-deg", 45, "--seed", 1)
    program("simulate", "gestures", "scene.mcap", *two)
    program("smooth", "scene.mcap", *HASTY)
    program("evaluate", "scene.estimate.mcap", "--truth", "scene.mcap")
    program("view", "scene.estimate.mcap", "scene.mcap", "--save", "scene.rrd")
    program("stream", "scene.mcap", "--rerun-save", "live.rrd", "--frame-rate", 15)
    assert not notes.exists(), notes.read_text()
