"""The random processes have the statistics that their docstrings promise."""

import numpy as np
import pytest

from vip_factors.simulate.recording import gauss_markov, random_walk, received, smooth_process

STEP = 0.01
COUNT = 300_000


def autocorrelation(values: np.ndarray, lag: int) -> float:
    return float(np.mean(values[lag:] * values[:-lag]) / np.mean(values**2))


def test_gauss_markov_has_its_sigma_and_correlation_time() -> None:
    values = gauss_markov(np.random.default_rng(1), COUNT, STEP, np.array([1.0, 2.0, 0.0]), time_constant=0.5)
    assert values.std(axis=0) == pytest.approx([1.0, 2.0, 0.0], rel=0.05)
    for lag in (10, 50, 100):
        assert autocorrelation(values[:, 0], lag) == pytest.approx(np.exp(-lag * STEP / 0.5), abs=0.03)


def test_smooth_process_is_a_matern_process() -> None:
    values = smooth_process(np.random.default_rng(3), COUNT, STEP, 2.0, time_constant=0.5)
    assert values.std() == pytest.approx(2.0, rel=0.05)
    for lag in (10, 50, 100):
        x = np.sqrt(5) * lag * STEP / 0.5
        assert autocorrelation(values[:, 0], lag) == pytest.approx((1 + x + x**2 / 3) * np.exp(-x), abs=0.05)


def test_random_walk_spreads_with_the_root_of_time() -> None:
    ends = [random_walk(np.random.default_rng(seed), 24_001, STEP, 2.0)[[0, 6000, 24_000]] for seed in range(300)]
    assert np.std(ends, axis=0) == pytest.approx([0.0, 2.0, 4.0], rel=0.15)


def test_received_keeps_the_ends_and_loses_what_it_is_told() -> None:
    here = received(np.random.default_rng(5), 100_000, 100.0, packet_loss=0.05, gap_s=0.0)
    assert here[0]
    assert here[-1]
    assert np.mean(~here) == pytest.approx(0.05, abs=0.005)
    gap = ~received(np.random.default_rng(6), 1000, 100.0, packet_loss=0.0, gap_s=0.4)
    assert gap.sum() == 40
    assert np.ptp(np.flatnonzero(gap)) == 39
