"""Triangles into pixels: what is nearer hides, what turns its back is left out, and both ways of drawing agree."""

import cv2
import numpy as np
import pytest

from vip_factors.body.body_mesh import surface_net
from vip_factors.viz import figure
from vip_factors.viz.figure import COVERED_M, empty_depth, paint

RED, GREEN = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)


def ball(centre: tuple[float, float], radius: float, depth: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels, depths and faces of a ball of a radius in pixels, whose middle is so far away."""
    grid = np.stack(np.meshgrid(*[np.arange(-1.2, 1.25, 0.1)] * 3, indexing="ij"), axis=-1)
    p, faces = surface_net(1.0 - np.linalg.norm(grid, axis=-1))
    p = 0.1 * p - 1.2
    # x right, y up, z towards the eye in the ball's own frame.
    pixels = np.array(centre) + radius * p[:, :2] * [1, -1]
    return pixels, depth - 0.1 * p[:, 2], faces.astype(np.int32)


def painted(*balls: tuple, size: int = 80) -> tuple[np.ndarray, np.ndarray]:
    image, depth = np.zeros((size, size, 3), np.float32), empty_depth(size, size)
    for (pixels, depths, faces), colour in balls:
        paint(image, depth, pixels, depths, faces, np.tile(np.float32(colour), (len(pixels), 1)))
    return image, depth


@pytest.fixture(params=["opencv", "numpy"])
def way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if request.param == "numpy":
        monkeypatch.delattr(cv2, "triangleRasterize", raising=False)
    elif not hasattr(cv2, "triangleRasterize"):
        pytest.skip("this OpenCV draws no triangles")


@pytest.mark.usefixtures("way")
@pytest.mark.parametrize("nearer_first", [True, False])
def test_a_ball_before_another_hides_it(nearer_first: bool) -> None:
    near, far = (ball((45, 40), 12, 2.0), RED), (ball((40, 40), 25, 3.0), GREEN)
    image, depth = painted(*((near, far) if nearer_first else (far, near)))
    x, y = np.meshgrid(np.arange(80), np.arange(80))
    from_near, from_far = np.hypot(x - 45, y - 40), np.hypot(x - 40, y - 40)
    np.testing.assert_allclose(image[from_near < 11.5], np.tile(RED, (np.sum(from_near < 11.5), 1)), atol=1e-6)
    ring = (from_near > 12.5) & (from_far < 24)
    np.testing.assert_allclose(image[ring], np.tile(GREEN, (np.sum(ring), 1)), atol=1e-6)
    assert not image[from_far > 25.5].any()
    assert depth[40, 45] == pytest.approx(1.9, abs=2e-3)
    assert (depth[from_far > 25.5] > COVERED_M).all()


def test_both_ways_of_drawing_agree() -> None:
    if not hasattr(cv2, "triangleRasterize"):
        pytest.skip("this OpenCV draws no triangles")
    pixels, depths, faces = ball((31.3, 44.7), 30.2, 2.0)
    colours = np.random.default_rng(0).uniform(size=(len(pixels), 3)).astype(np.float32)
    results = []
    for draw in (figure._by_opencv, figure._by_numpy):
        image, depth = np.zeros((70, 90, 3), np.float32), empty_depth(70, 90)
        draw(image, depth, pixels, depths, faces, colours)
        results.append((image, depth))
    (one, near), (other, also) = results
    assert np.mean((near < COVERED_M) != (also < COVERED_M)) < 0.002  # pixels on the very edge
    both = (near < COVERED_M) & (also < COVERED_M)
    assert both.mean() > 0.3
    assert np.mean(np.abs(one - other)[both]) < 1e-3
    np.testing.assert_allclose(near[both], also[both], atol=2e-3)


@pytest.mark.usefixtures("way")
def test_backs_are_left_out_and_so_is_what_is_behind_the_eye() -> None:
    pixels, depths, faces = ball((40, 40), 20, 2.0)
    turned = (pixels, depths, np.ascontiguousarray(faces[:, ::-1]))
    image, depth = painted((turned, RED))
    assert depth[40, 40] == pytest.approx(2.1, abs=5e-3)  # its far wall, seen from inside
    image, _ = painted(((pixels, -depths, faces), RED))
    assert not image.any()
