"""Decoding the person detector: answers that are put in come out as people, once each."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vip_factors.detect.blazepose import (
    DETECTOR_INPUT,
    INPUT,
    MARGIN,
    LandmarkModel,
    PersonDetector,
    Square,
    anchor_centres,
    refine,
    square_of,
)

ANCHORS = anchor_centres()


class Answering:
    """A model that sees the same people in every image: hip, top (fractions), logit, at some anchors."""

    def __init__(self, people: list[tuple[tuple[float, float], tuple[float, float], float, int]]) -> None:
        self.rows, self.logit = np.zeros((1, 2254, 12), np.float32), np.full((1, 2254, 1), -90.0, np.float32)
        for hip, top, logit, at in people:
            self.rows[0, at, 2:4] = 0.2 * DETECTOR_INPUT
            self.rows[0, at, 4:6] = (np.array(hip) - ANCHORS[at]) * DETECTOR_INPUT
            self.rows[0, at, 6:8] = (np.array(top) - ANCHORS[at]) * DETECTOR_INPUT
            self.logit[0, at, 0] = logit
        self.given: list[np.ndarray] = []

    def __call__(self, given: np.ndarray) -> list[np.ndarray]:
        self.given.append(given)
        return [self.rows, self.logit]


def at(x: float, y: float) -> int:
    """The nearest anchor."""
    return int(np.argmin(np.linalg.norm(ANCHORS - [x, y], axis=1)))


def test_a_person_is_where_the_model_says() -> None:
    detector = PersonDetector(Answering([((0.5, 0.5), (0.5, 0.2), 2.0, at(0.5, 0.25))]))
    image = np.zeros((400, 200, 3), np.uint8)
    (found,) = detector.find(image, Square(100.0, 200.0, 400.0))
    assert np.allclose(found.square.centre, [100, 200], atol=1e-3)
    assert found.square.side == pytest.approx(2 * MARGIN * 0.3 * 400, rel=1e-5)
    assert found.square.angle == pytest.approx(0.0, abs=1e-6)
    assert found.score == pytest.approx(1 / (1 + np.exp(-2.0)), rel=1e-5)


def test_neighbouring_answers_are_one_person_and_unsure_ones_nobody() -> None:
    here, there = ((0.3, 0.5), (0.3, 0.2)), ((0.8, 0.5), (0.8, 0.2))
    people = [(*here, 3.0, at(0.3, 0.25)), (*here, 1.0, at(0.32, 0.25)), (*there, 2.0, at(0.8, 0.25))]
    people.append(((0.5, 0.9), (0.5, 0.8), -1.0, at(0.5, 0.9)))
    found = PersonDetector(Answering(people)).find(np.zeros((100, 100, 3), np.uint8), Square(50, 50, 100))
    assert [round(one.square.x) for one in found] == [30, 80]
    assert found[0].score > found[1].score


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
    moved = refine(points, heat)
    assert np.allclose(moved[0], [33 / 64 * INPUT, 34 / 64 * INPUT])
    assert np.allclose(moved[1:], 128.0)


PIXELS = st.floats(-500, 2000)


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
