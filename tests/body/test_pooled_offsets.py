"""What people teach of a detector: its habit, how far they scatter about it, and how much few of them are believed."""

import numpy as np
import pytest

from vip_factors.body.keypoint_offsets import SHAPE, KeypointOffsets, OffsetTraining, pooled_offsets
from vip_factors.errors import InputError

USUAL = np.full(SHAPE, 0.010)
HABIT = 0.012 * np.random.default_rng(1).standard_normal(SHAPE)


def people(count: int, spread: float, noise: float, seed: int = 2) -> list[KeypointOffsets]:
    random = np.random.default_rng(seed)
    scattered = HABIT + np.hypot(spread, noise) * random.standard_normal((count, *SHAPE))
    return [KeypointOffsets(one, np.full(SHAPE, noise)) for one in scattered]


def test_nobody_teaches_nothing() -> None:
    pooled = pooled_offsets([], USUAL)
    assert pooled.people == 0
    np.testing.assert_array_equal(pooled.offsets.mean, 0.0)
    np.testing.assert_array_equal(pooled.offsets.sigma, USUAL)


def test_many_people_teach_habit_and_spread() -> None:
    pooled = pooled_offsets(people(400, 0.005, 0.003), USUAL).offsets
    np.testing.assert_allclose(pooled.mean, HABIT, atol=0.0015)
    np.testing.assert_allclose(pooled.sigma, 0.005, rtol=0.2)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_few_people_are_believed_little(count: int) -> None:
    few = pooled_offsets(people(count, 0.0, 0.001), USUAL).offsets
    assert np.all(few.sigma < USUAL)
    assert np.all(few.sigma > 0.004)  # how people scatter, so few do not tell
    assert np.abs(few.mean).mean() < np.abs(HABIT).mean()


def test_offsets_to_expect_are_as_sure_as_they_say() -> None:
    """Over many detectors with a habit and a spread as usual: the next person is where the sigmas expect them."""
    random, missed = np.random.default_rng(5), []
    for _ in range(200):
        habit = np.sqrt(0.5) * USUAL * random.standard_normal(SHAPE)
        each = habit + np.sqrt(0.5) * USUAL * random.standard_normal((4, *SHAPE))
        noise = np.full(SHAPE, 0.004)
        found = [KeypointOffsets(one + noise * random.standard_normal(SHAPE), noise) for one in each[:3]]
        pooled = pooled_offsets(found, USUAL).offsets
        missed.append(((each[3] - pooled.mean) / pooled.sigma) ** 2)
    assert 0.85 < np.mean(missed) < 1.15


def test_noisy_ones_count_less() -> None:
    sure = KeypointOffsets(np.full(SHAPE, 0.01), np.full(SHAPE, 0.001))
    vague = KeypointOffsets(np.full(SHAPE, -0.05), np.full(SHAPE, 0.1))
    alone, both = pooled_offsets([sure], USUAL).offsets, pooled_offsets([sure, vague], USUAL).offsets
    np.testing.assert_allclose(both.mean, alone.mean, atol=1e-3)


def test_a_spread_is_never_nothing() -> None:
    settings = OffsetTraining(prior_people=0.1)
    same = [KeypointOffsets(HABIT, np.full(SHAPE, 1e-4))] * 50
    assert pooled_offsets(same, USUAL, settings).offsets.sigma.min() >= settings.least_sigma_m


@pytest.mark.parametrize("sigma", [0.0, -1.0, np.nan])
def test_a_sigma_that_is_none_is_refused(sigma: float) -> None:
    with pytest.raises(InputError, match="sigmas above zero"):
        KeypointOffsets(np.zeros(SHAPE), np.full(SHAPE, sigma))
