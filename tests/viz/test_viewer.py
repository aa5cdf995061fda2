import os
import shutil
import socket
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from scene_sample import estimate_of, scene_sample

from vip_factors.errors import InputError, VipFactorsError
from vip_factors.viz import viewer as module
from vip_factors.viz.colours import wearer_colour
from vip_factors.viz.drawn_scene import drawn_scene, drawn_wearer
from vip_factors.viz.rerun_view import show
from vip_factors.viz.viewer import address, screenshot, serve


def test_what_cannot_be_rendered_is_said_before_a_viewer_starts(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        screenshot(tmp_path / "none.rrd", tmp_path / "a.png")
    (tmp_path / "a.rrd").write_bytes(b"x")
    (tmp_path / "a.png").write_text("precious")
    with pytest.raises(InputError, match="exists"):
        screenshot(tmp_path / "a.rrd", tmp_path / "a.png")
    assert (tmp_path / "a.png").read_text() == "precious"


def test_a_viewer_that_draws_nothing_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.rrd").write_bytes(b"x")
    monkeypatch.setattr("vip_factors.viz.viewer._viewer", lambda: [sys.executable, "-c", "print('no GPU here')"])
    with pytest.raises(VipFactorsError, match=r"no GPU here.*mesa-vulkan-drivers"):
        screenshot(tmp_path / "a.rrd", tmp_path / "b.png")
    assert [path.name for path in tmp_path.iterdir()] == ["a.rrd"]


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("xvfb-run") is None, reason="needs xvfb and mesa-vulkan-drivers")
def test_rerun_draws_the_scene(scene, tmp_path: Path) -> None:
    show(drawn_wearer(scene.recording, scene.estimate, scene.truth), tmp_path / "a.rrd")
    screenshot(tmp_path / "a.rrd", tmp_path / "a.png", size=(800, 500))
    image = cv2.imread(str(tmp_path / "a.png"))
    assert image.shape[0] >= 500
    orange = (image[..., 2] > 180) & (image[..., 0] < 110)
    assert orange.mean() > 0.001


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("xvfb-run") is None, reason="needs xvfb and mesa-vulkan-drivers")
def test_rerun_draws_wearers_in_their_colours(tmp_path: Path) -> None:
    sample = scene_sample(0.5)
    show(drawn_scene(sample, estimate_of(sample)), tmp_path / "a.rrd")
    screenshot(tmp_path / "a.rrd", tmp_path / "a.png", size=(1200, 700))
    image = cv2.imread(str(tmp_path / "a.png"))[..., ::-1].astype(int)
    for index in (0, 1):
        assert (np.abs(image - wearer_colour(index)).max(axis=-1) < 12).sum() > 300


STAND_IN = """#!{python}
import os, socket, sys, time
given = dict(zip(sys.argv[2:-1], sys.argv[3:]))
open(os.path.join({folder!r}, "pid"), "w").write(str(os.getpid()))
open(os.path.join({folder!r}, "host"), "w").write(given["--bind"])
listening = [socket.create_server((given["--bind"], int(given[one]))) for one in ("--web-viewer-port", "--port")]
time.sleep({seconds})
"""


@pytest.fixture
def port() -> int:
    """A free one; the one after it is most likely free too."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return min(int(probe.getsockname()[1]), 65000)


@pytest.fixture
def rrd(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A file, and a stand-in for Rerun's program that listens as it does."""
    return stand_in(tmp_path, monkeypatch, 30.0)


def stand_in(folder: Path, monkeypatch: pytest.MonkeyPatch, seconds: float) -> Path:
    program = folder / "rerun"
    program.write_text(STAND_IN.format(python=sys.executable, folder=str(folder), seconds=seconds))
    program.chmod(0o755)
    monkeypatch.setattr(module, "rerun_command", lambda: str(program))
    (folder / "a.rrd").write_bytes(b"x")
    return folder / "a.rrd"


def test_ctrl_c_ends_the_servers(rrd: Path, port: int) -> None:
    told = []

    def tell(text: str) -> None:
        told.append(text)
        for one in (port, port + 1):
            socket.create_connection(("127.0.0.1", one), timeout=5).close()
        raise KeyboardInterrupt

    serve(rrd, "127.0.0.1", port, tell)
    assert told == [f"http://127.0.0.1:{port}/?url=rerun%2Bhttp://127.0.0.1:{port + 1}/proxy"]
    assert (rrd.parent / "host").read_text() == "127.0.0.1"
    with pytest.raises(ProcessLookupError):
        os.kill(int((rrd.parent / "pid").read_text()), 0)


def test_a_port_that_is_taken_is_said(rrd: Path, port: int) -> None:
    with socket.create_server(("127.0.0.1", port + 1)), pytest.raises(InputError, match=f"{port + 1}.*--port"):
        serve(rrd, "127.0.0.1", port, print)
    with pytest.raises(InputError, match="expected 1 to 65534"):
        serve(rrd, "127.0.0.1", 65535, print)
    assert not (rrd.parent / "pid").exists()


def test_servers_that_end_by_themselves_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, port: int) -> None:
    rrd = stand_in(tmp_path, monkeypatch, 0.0)
    with pytest.raises(VipFactorsError, match=r"ended by itself|did not start"):
        serve(rrd, "127.0.0.1", port, lambda text: None)


def test_the_address_names_this_machine_where_all_may_come() -> None:
    name = socket.gethostname()
    assert address("0.0.0.0", 80) == f"http://{name}:80/?url=rerun%2Bhttp://{name}:81/proxy"
    assert address("::1", 80).startswith("http://[::1]:80/")
