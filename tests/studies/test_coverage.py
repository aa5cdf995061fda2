"""Coverage of what is told: on errors that are as they are said, and in a table."""

from pathlib import Path

import numpy as np

from tests.studies.coverage import Coverage, coverage_rows
from tests.studies.study import markdown
from vip_factors.body.model_errors import FILMED, UNFILMED
from vip_factors.body.skeleton import joint_index


def test_errors_as_they_are_told_are_nine_times_of_ten_inside(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    sigma = rng.uniform(1, 5, (4000, 2))
    (row,) = coverage_rows("judging", "walk", True, iter([("lengths, m", sigma * rng.normal(size=(4000, 2)), sigma)]))
    assert abs(row.inside - 0.9) < 0.02
    assert abs(row.nees - 1) < 0.05
    study = Coverage(simulator=tmp_path, motions=tmp_path, folder=tmp_path)
    assert "| judging | camera | lengths, mm | 1 | 9" in markdown(study, [row])


def test_a_limb_without_sensors_is_told_less_surely() -> None:
    knee, shoulder = joint_index("left_knee"), joint_index("left_shoulder")
    near, far = FILMED.positions({"left_hip"}), FILMED.positions({"head"})
    assert near[knee] < far[knee]
    assert near[shoulder] == far[shoulder]
    assert np.all(FILMED.position <= UNFILMED.position)
