"""Bounds of the mean NEES over independent runs."""

import numpy as np
import pytest

from tests.studies.consistency import nees_bounds, over_seeds
from vip_factors.errors import InputError
from vip_factors.evaluate.consistency import nees


def test_bounds_hold_95_percent_of_honest_means() -> None:
    random = np.random.default_rng(0)
    means = (random.standard_normal((4000, 20, 3)) ** 2).mean(axis=(1, 2))
    low, high = nees_bounds(3, 20)
    assert np.mean((means >= low) & (means <= high)) == pytest.approx(0.95, abs=0.01)
    assert np.mean(means < low) == pytest.approx(0.025, abs=0.01)


def test_a_run_counts_once_however_many_frames_it_has() -> None:
    random = np.random.default_rng(2)
    covariance = np.diag([1.0, 4.0, 9.0])
    runs = []
    for _ in range(30):
        error = np.tile(random.standard_normal(3) * [1.0, 2.0, 3.0], (50, 1))  # the same in every frame
        runs.append(nees(error, np.broadcast_to(covariance, (50, 3, 3))))
    assert over_seeds(runs, 3).honest
    assert over_seeds(runs, 3).runs == 30
    assert not over_seeds([4 * run for run in runs], 3).honest
    assert over_seeds([*runs, np.full(50, np.nan)], 3).runs == 30


def test_no_run_has_no_bounds() -> None:
    with pytest.raises(InputError, match="at least one"):
        over_seeds([np.array([np.nan])], 3)
