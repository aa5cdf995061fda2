"""A turned square: pixels of its crop and of the image are the same points of the world."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from vip_factors.detect.square import MARGIN, Square, square_of

PIXELS = st.floats(-500, 2000)


@given(PIXELS, PIXELS, st.floats(10, 1500), st.floats(-3, 3))
def test_corners_and_centre(x: float, y: float, side: float, angle: float) -> None:
    square = Square(x, y, side, angle)
    assert np.allclose(square.to_image(np.array([128.0, 128.0]), 256), [x, y])
    corners = square.to_image(np.array([[0.0, 0], [256, 0], [256, 256], [0, 256]]), 256)
    assert np.allclose(np.linalg.norm(np.diff(corners, axis=0), axis=1), side)


@given(PIXELS, PIXELS, st.floats(10, 500), st.floats(-3, 3))
def test_the_person_stands_upright_in_the_crop(x: float, y: float, reach: float, angle: float) -> None:
    hip = np.array([x, y])
    top = hip + reach * np.array([np.sin(angle), -np.cos(angle)])
    square = square_of(hip, top)
    assert np.isclose(square.side, 2 * MARGIN * reach)
    upright = square.to_image(np.array([128.0, 128 - 256 / 2 / MARGIN]), 256)
    assert np.allclose(upright, top, atol=1e-6)


def test_the_crop_shows_what_is_there() -> None:
    image = np.zeros((400, 600, 3), np.uint8)
    image[170:190, 310:330] = 255  # its middle is at (320, 180)
    for angle in (0.0, 0.6, -2.0):
        square = Square(300.0, 200.0, 300.0, angle)
        y, x = np.nonzero(square.crop(image, 256)[..., 0] > 128)
        middle = np.array([x.mean() + 0.5, y.mean() + 0.5])
        assert np.allclose(square.to_image(middle, 256), [320, 180], atol=0.5)


def test_beyond_the_image_all_is_black() -> None:
    image = np.full((100, 100, 3), 255, np.uint8)
    crop = Square(0.0, 50.0, 100.0).crop(image, 64)
    assert crop[32, 5].sum() == 0
    assert crop[32, 60].sum() == 3 * 255
