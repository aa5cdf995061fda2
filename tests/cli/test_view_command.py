"""``view``: what is made sure of before a viewer is started."""

from collections.abc import Callable

import pytest


@pytest.fixture
def headless(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)


@pytest.mark.usefixtures("headless")
def test_without_a_display_a_window_is_refused_in_one_sentence(run: Callable, files) -> None:
    done = run("view", files.recording)
    assert (done.code, done.out) == (2, "")
    assert done.err == "vip-factors: no display: use --save FILE.rrd or --picture\n"
    done = run("stream", files.recording, "--rerun")
    assert done.code == 2
    assert done.err.startswith("vip-factors: no display: use --rerun-save FILE.rrd")
    assert len(done.err.splitlines()) == 1
