"""``view``: what is made sure of before a viewer is started."""

from collections.abc import Callable
from pathlib import Path

import pytest

from vip_factors.viz import rerun_view, viewer


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
    assert done.err.startswith("vip-factors: no display: use --rerun-serve PORT")
    assert len(done.err.splitlines()) == 1


@pytest.mark.usefixtures("headless")
def test_without_a_display_a_window_is_refused_in_python_too(files) -> None:
    from vip_factors.errors import InputError
    from vip_factors.io.mcap_recording import read_scene
    from vip_factors.viz.drawn_scene import drawn_wearer

    with pytest.raises(InputError, match="no display"):
        rerun_view.show(drawn_wearer(read_scene(files.recording).wearers[0], None))


def test_a_display_opens_the_viewer(run: Callable, files, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DISPLAY", ":7")
    opened = []
    monkeypatch.setattr("vip_factors.viz.rerun_view.show", lambda drawn, save, overwrite: opened.append(save))
    assert run("view", files.recording).code == 0
    assert opened == [None]


@pytest.mark.parametrize("name", ["x.bvh", "x.npz", "x"])
def test_only_rerun_files_are_written_as_such(run: Callable, files, tmp_path: Path, name: str) -> None:
    for command in (("view", files.recording, "--save"), ("stream", files.recording, "--rerun-save")):
        done = run(*command, tmp_path / name)
        assert done.code == 2
        assert ".rrd" in done.err
        assert "vip-factors export" in done.err
    assert list(tmp_path.iterdir()) == []


def test_what_is_served_is_a_rerun_file(run: Callable, files, monkeypatch: pytest.MonkeyPatch) -> None:
    served = []

    def stand_in(rrd: Path, host: str, port: int, tell: Callable[[str], None]) -> None:
        served.append((rrd.read_bytes()[:3], host, port))
        tell("http://here")

    monkeypatch.setattr(viewer, "serve", stand_in)
    done = run("view", files.recording, "--serve", "--port", "9191")
    assert (done.code, done.out) == (0, "http://here\n")
    assert served == [(b"RRF", "127.0.0.1", 9191)]
