"""Decoding the person detector: answers that are put in come out as people, once each."""

import numpy as np
import pytest

from vip_factors.detect.anchors import INPUT, anchor_centres
from vip_factors.detect.person_detector import PersonDetector, intersection_over_union, merged
from vip_factors.detect.square import MARGIN, Square

ANCHORS = anchor_centres()


class Answering:
    """A model that sees the same people in every image: hip, top (fractions), logit, at some anchors."""

    def __init__(self, people: list[tuple[tuple[float, float], tuple[float, float], float, int]]) -> None:
        self.rows, self.logit = np.zeros((1, 2254, 12), np.float32), np.full((1, 2254, 1), -90.0, np.float32)
        for hip, top, logit, at in people:
            self.rows[0, at, 2:4] = 0.2 * INPUT
            self.rows[0, at, 4:6] = (np.array(hip) - ANCHORS[at]) * INPUT
            self.rows[0, at, 6:8] = (np.array(top) - ANCHORS[at]) * INPUT
            self.logit[0, at, 0] = logit
        self.given: list[np.ndarray] = []

    def __call__(self, given: np.ndarray) -> list[np.ndarray]:
        self.given.append(given)
        return [self.rows, self.logit]


def at(x: float, y: float) -> int:
    """The nearest anchor."""
    return int(np.argmin(np.linalg.norm(ANCHORS - [x, y], axis=1)))


def test_a_person_is_where_the_model_says() -> None:
    detector = PersonDetector(Answering([((0.5, 0.5), (0.5, 0.2), 2.0, at(0.5, 0.25))]), 0.5, 0.3)
    image = np.zeros((400, 200, 3), np.uint8)
    (found,) = detector.find(image, Square(100.0, 200.0, 400.0))
    assert np.allclose(found.square.centre, [100, 200], atol=1e-3)
    assert found.square.side == pytest.approx(2 * MARGIN * 0.3 * 400, rel=1e-5)
    assert found.square.angle == pytest.approx(0.0, abs=1e-6)
    assert found.score == pytest.approx(1 / (1 + np.exp(-2.0)), rel=1e-5)


def test_the_model_is_shown_the_part_with_black_around() -> None:
    model = Answering([])
    image = np.full((400, 200, 3), 255, np.uint8)
    assert PersonDetector(model, 0.5, 0.3).find(image, Square(100.0, 200.0, 400.0)) == []
    (shown,) = model.given
    assert shown.shape == (1, INPUT, INPUT, 3)
    assert shown[0, 112, 10, 0] == -1.0
    assert shown[0, 112, 112, 0] == 1.0


def test_somebody_who_lies_is_turned_upright() -> None:
    detector = PersonDetector(Answering([((0.5, 0.5), (0.8, 0.5), 2.0, at(0.75, 0.5))]), 0.5, 0.3)
    (found,) = detector.find(np.zeros((100, 100, 3), np.uint8), Square(50.0, 50.0, 100.0))
    assert found.square.angle == pytest.approx(np.pi / 2)


def test_neighbouring_answers_are_one_person_and_unsure_ones_nobody() -> None:
    here, there = ((0.3, 0.5), (0.3, 0.2)), ((0.8, 0.5), (0.8, 0.2))
    people = [(*here, 3.0, at(0.3, 0.25)), (*here, 1.0, at(0.32, 0.25)), (*there, 2.0, at(0.8, 0.25))]
    people.append(((0.5, 0.9), (0.5, 0.8), -1.0, at(0.5, 0.9)))
    found = PersonDetector(Answering(people), 0.5, 0.3).find(np.zeros((100, 100, 3), np.uint8), Square(50, 50, 100))
    assert [round(one.square.x) for one in found] == [30, 80]
    assert found[0].score > found[1].score


def test_suppression_takes_the_mean_weighed_by_score() -> None:
    rows = np.zeros((3, 12))
    rows[:, 2:4] = 0.2
    rows[:, 0] = [0.30, 0.32, 0.9]
    found = merged(rows, np.array([0.9, 0.3, 0.6]), 0.3)
    assert [score for _, score in found] == [0.9, 0.6]
    assert found[0][0][0] == pytest.approx((0.9 * 0.30 + 0.3 * 0.32) / 1.2)


def test_intersection_over_union() -> None:
    rows = np.zeros((4, 12))
    rows[:, 2:4] = 2.0
    rows[:, 0] = [0, 1, 2, 0]
    rows[3, 2:4] = 0.0
    assert np.allclose(intersection_over_union(rows[0], rows), [1.0, 1 / 3, 0.0, 0.0])
