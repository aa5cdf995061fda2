"""Precision and recall of labels."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vip_factors.errors import InputError
from vip_factors.evaluate.association import association_score

LABELS = st.lists(st.tuples(st.integers(-1, 2), st.integers(-1, 2)), max_size=30)


def test_by_hand() -> None:
    truth = np.array([0, 0, 0, 1, 1, -1, -1, 2])
    labels = np.array([0, 1, -1, 1, 1, -1, 0, -1])
    score = association_score(labels, truth)
    assert (score.given, score.true, score.correct) == (5, 6, 3)
    assert (score.swapped, score.strangers, score.missed) == (1, 1, 2)
    assert score.precision == pytest.approx(3 / 5)
    assert score.recall == pytest.approx(3 / 6)
    assert score.recall_of == pytest.approx({0: 1 / 3, 1: 1.0, 2: 0.0})


@given(LABELS)
def test_every_label_is_counted_once(pairs: list[tuple[int, int]]) -> None:
    labels, truth = np.array(pairs, int).reshape(-1, 2).T
    score = association_score(labels, truth)
    assert score.correct + score.swapped + score.strangers == score.given
    assert score.correct + score.swapped + score.missed == score.true


def test_nothing_given_has_no_precision_and_no_recall() -> None:
    score = association_score(np.full(3, -1), np.array([0, 1, -1]))
    assert np.isnan(score.precision)
    assert score.recall == 0


def test_labels_of_other_detections_are_refused() -> None:
    with pytest.raises(InputError, match="same scene"):
        association_score(np.zeros(3, int), np.zeros(4, int))
