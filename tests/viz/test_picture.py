from pathlib import Path

import cv2
import numpy as np

from vip_factors.body.mannequin import ESTIMATE_COLOURS, Side
from vip_factors.viz.drawn_scene import drawn_wearer
from vip_factors.viz.picture import filmstrip


def share_like(image: np.ndarray, colour: tuple[int, int, int], tolerance: int = 12) -> float:
    return float((np.abs(image[..., ::-1].astype(int) - colour).max(axis=-1) <= tolerance).mean())


def test_both_sides_and_the_curve_are_on_the_picture(scene, tmp_path: Path) -> None:
    filmstrip(drawn_wearer(scene.recording, scene.estimate, scene.truth), tmp_path / "a.png")
    image = cv2.imread(str(tmp_path / "a.png"))
    assert image.shape[1] == 1600
    strip = image[150:560].astype(int)  # light and shadow keep the hue
    for side in (Side.LEFT, Side.RIGHT):
        red, _, blue = ESTIMATE_COLOURS[side]
        assert 0.01 < np.mean((strip[..., 2] - strip[..., 0]) / (red - blue) > 0.5) < 0.2
    assert 0.6 < share_like(image, (255, 255, 255), 0) < 0.95
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]


def test_a_truth_alone_and_a_short_motion_can_be_drawn(scene, tmp_path: Path) -> None:
    filmstrip(drawn_wearer(scene.recording, None), tmp_path / "a.png")
    filmstrip(drawn_wearer(None, None, scene.truth.frames(slice(0, 1))), tmp_path / "b.png")
