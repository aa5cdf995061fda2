import shutil
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from scene_sample import estimate_of, scene_sample

from vip_factors.errors import InputError, VipFactorsError
from vip_factors.viz.rerun_scene import show_scene
from vip_factors.viz.rerun_view import SaveTo, show
from vip_factors.viz.screenshot import screenshot
from vip_factors.viz.wearer_colours import wearer_colour


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
    monkeypatch.setattr("vip_factors.viz.screenshot._viewer", lambda: [sys.executable, "-c", "print('no GPU here')"])
    with pytest.raises(VipFactorsError, match=r"no GPU here.*mesa-vulkan-drivers"):
        screenshot(tmp_path / "a.rrd", tmp_path / "b.png")
    assert [path.name for path in tmp_path.iterdir()] == ["a.rrd"]


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("xvfb-run") is None, reason="needs xvfb and mesa-vulkan-drivers")
def test_rerun_draws_the_scene(scene, tmp_path: Path) -> None:
    show(scene.recording, scene.estimate, scene.truth, SaveTo(tmp_path / "a.rrd"))
    screenshot(tmp_path / "a.rrd", tmp_path / "a.png", size=(800, 500))
    image = cv2.imread(str(tmp_path / "a.png"))
    assert image.shape[0] >= 500
    orange = (image[..., 2] > 180) & (image[..., 0] < 110)
    assert orange.mean() > 0.001


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("xvfb-run") is None, reason="needs xvfb and mesa-vulkan-drivers")
def test_rerun_draws_wearers_in_their_colours(tmp_path: Path) -> None:
    sample = scene_sample(0.5)
    show_scene(sample, estimate_of(sample), SaveTo(tmp_path / "a.rrd"))
    screenshot(tmp_path / "a.rrd", tmp_path / "a.png", size=(1200, 700))
    image = cv2.imread(str(tmp_path / "a.png"))[..., ::-1].astype(int)
    for index in (0, 1):
        assert (np.abs(image - wearer_colour(index)).max(axis=-1) < 12).sum() > 300
