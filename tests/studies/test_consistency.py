"""Covariances are honest where the noise is as the factors suppose; here on a few seeds of small scenes."""

import numpy as np
import pytest

from tests.studies.consistency import Consistency, gaussian_nees, nees_bounds, over_seeds
from tests.studies.gaussian_scene import GaussianSettings, gaussian_scene
from tests.studies.study import markdown, run
from vip_factors.assembly.objective import SceneObjective
from vip_factors.evaluate.calibration import nees

SMALL = GaussianSettings(frames=8, placement="sip6", noise=0.25)


@pytest.mark.parametrize("moving", [False, True])
def test_the_noise_is_as_large_as_the_factors_suppose(moving: bool) -> None:
    """At the truth half a whitened square is expected of each number that was drawn."""
    costs: dict[str, float] = {}
    runs = 8
    for seed in range(runs):
        made = gaussian_scene(GaussianSettings(frames=8, moving=moving), seed)
        for kind, cost in SceneObjective(made.model).cost(made.truth).items():
            costs[kind] = costs.get(kind, 0.0) + cost / runs
        seen = int(made.model.views[0][0].seen.sum())
    T, S = 8, 13
    expected = {
        "orientation": 3 * T * S, "acceleration": 3 * (T - 2) * S, "pose prior": 69 * T, "heading prior": S,
        "mounting prior": 3 * S, "reprojection": 2 * seen,
    }  # fmt: skip
    if moving:
        expected |= {"camera orientation": 3 * T, "camera velocity": 6 * (T - 1)}
    for kind, count in expected.items():
        assert 2 * costs[kind] / count == pytest.approx(1.0, abs=5 * np.sqrt(2 / (count * runs)) + 0.02), kind
    assert costs.get("joint limit", 0.0) == 0


@pytest.mark.parametrize("camera", ["fixed", "hand-held"])
def test_nees_is_within_its_bounds(camera: str) -> None:
    study = Consistency(seeds=6, camera=camera, sizes=(0.25,), gaussian=SMALL)  # type: ignore[arg-type]
    rows = run(study)
    assert [row.of for row in rows] == ["headings", "mountings", "camera", "joints", "root"]
    for row in rows:
        one = row.over_seeds
        assert one.runs == 6
        # Of 99.99 %, not 95: a suite of tests throws these dice with every change.
        assert 1 - 2 * (1 - one.low) < one.nees < 1 + 2.5 * (one.high - 1), row.of
    assert "| 0.25 of what is assumed | headings | 6 |" in markdown(study, rows)


def test_too_small_a_covariance_is_seen() -> None:
    made = gaussian_scene(SMALL, 0)
    ((view,),) = made.model.views
    view.sigma[:] /= 5
    assert np.mean(gaussian_nees(made)["camera"]) > 3


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
