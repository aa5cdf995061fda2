"""The landmark model's numbers become pixels of the image."""

import numpy as np
import pytest

from vip_factors.detect.landmarks import INPUT, LandmarkModel, refined
from vip_factors.detect.square import Square


def outputs(points: np.ndarray, presence: float = 0.9, heat: np.ndarray | None = None) -> list[np.ndarray]:
    """As the file has them: the others are the mask and the landmarks in metres."""
    rows = np.zeros((39, 5), np.float32)
    rows[:, :2], rows[:, 3:] = points, 20.0
    rows[5, 3] = -20.0
    maps = np.full((1, 64, 64, 39), -20.0, np.float32) if heat is None else heat[None]
    mask, world = np.zeros((1, 256, 256, 1), np.float32), np.zeros((1, 117), np.float32)
    return [rows.reshape(1, 195), np.array([[presence]], np.float32), mask, maps.astype(np.float32), world]


def test_landmarks_are_turned_back_into_the_image() -> None:
    points = np.full((39, 2), 100.0)
    points[33], points[34] = (128, 128), (128, 28)
    square = Square(400.0, 300.0, 512.0, np.pi / 2)  # the person's up is to the right in the image
    seen = LandmarkModel(lambda given: outputs(points)).look(np.zeros((600, 800, 3), np.uint8), square)
    assert seen.pixels.shape == (33, 2)
    assert np.allclose(seen.pixels, [400 + 2 * 28, 300 - 2 * 28])
    assert seen.confidence[4] == pytest.approx(1.0)
    assert seen.confidence[5] == pytest.approx(0.0, abs=1e-6)
    assert seen.presence == pytest.approx(0.9)
    assert np.allclose(seen.following.centre, [400, 300])
    assert seen.following.side == pytest.approx(2 * 1.25 * 200)
    assert seen.following.angle == pytest.approx(np.pi / 2)


def test_heat_moves_a_landmark_to_its_centre() -> None:
    points = np.full((39, 2), 128.0)  # cell 32, 32
    heat = np.full((64, 64, 39), -20.0)
    heat[34, 33, 0] = 20.0  # row, column
    heat[40, 32, 1] = 20.0  # beyond the window
    heat[32, 33, 2] = -0.5  # not hot enough
    moved = refined(points, heat)
    assert np.allclose(moved[0], [33 / 64 * INPUT, 34 / 64 * INPUT])
    assert np.allclose(moved[1:], 128.0)


def test_a_landmark_outside_the_crop_stays() -> None:
    points = np.full((39, 2), 300.0)
    assert np.allclose(refined(points, np.full((64, 64, 39), 20.0)), 300.0)
