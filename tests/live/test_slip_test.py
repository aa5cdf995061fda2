"""Slips are told from noise, from drift and from calibrations that are still being found."""

import numpy as np

from vip_factors.geometry.rotations import Array
from vip_factors.live.sensor_slips import SlipTest

RATE, EVERY, SENSORS = 60.0, 12, 3
WANDER = np.deg2rad(np.full(4, 0.3))
COLUMNS = np.arange(4 * SENSORS).reshape(SENSORS, 4)


def slips(truth: Array, first_deg: float = 5.0, begin: int = 0) -> tuple[list[tuple[float, int]], list[int]]:
    """Seconds and sensors suspected, and sensors confirmed, where a filter estimates ``truth`` ``(T, 12)`` radians."""
    rng, noise = np.random.default_rng(0), np.deg2rad(8.0)
    test = SlipTest(COLUMNS, WANDER, RATE, begin)
    value, covariance = np.zeros(12), np.deg2rad(first_deg) ** 2 * np.eye(12)
    found, confirmed = list[tuple[float, int]](), list[int]()
    for index, true in enumerate(truth):
        covariance = covariance + np.diag(np.tile(WANDER**2, SENSORS)) * EVERY / RATE
        gain = covariance @ np.linalg.inv(covariance + noise**2 * np.eye(12))
        value = value + gain @ (true + noise * rng.standard_normal(12) - value)
        covariance = covariance - gain @ covariance
        sensor = test.slipped(EVERY * index, value, covariance)
        if sensor is not None:
            found.append((EVERY * index / RATE, sensor))
            test.restart([sensor], EVERY * index)
            loosened = COLUMNS[sensor]
            covariance[loosened, loosened] += np.deg2rad(40.0) ** 2
        confirmed += test.confirmed(EVERY * index, value, covariance)
    return found, confirmed


def test_a_slip_is_found_once() -> None:
    truth = np.zeros((75, 12))
    truth[40:, COLUMNS[1, 2]] = np.deg2rad(40.0)
    found, confirmed = slips(truth)
    assert [sensor for _, sensor in found] == confirmed == [1]
    assert 8.0 < found[0][0] < 10.0


def test_what_does_not_last_is_no_slip() -> None:
    truth = np.zeros((75, 12))
    truth[40:47, COLUMNS[1, 2]] = np.deg2rad(60.0)
    found, confirmed = slips(truth)
    assert found[0][1] == 1
    assert confirmed == []


def test_tissue_is_no_slip() -> None:
    truth = np.zeros((75, 12))
    truth[40:, COLUMNS[1, 1:]] = np.deg2rad([10.0, -15.0, 10.0])
    assert slips(truth) == ([], [])


def test_a_heading_set_anew_is_found() -> None:
    truth = np.zeros((75, 12))
    truth[40:, COLUMNS[2, 0]] = np.deg2rad(-60.0)
    assert slips(truth)[1] == [2]


def test_drift_is_no_slip() -> None:
    truth = np.deg2rad(0.1) * np.arange(300)[:, None] * EVERY / RATE * np.ones(12)
    assert slips(truth) == ([], [])


def test_what_was_not_known_has_not_slipped() -> None:
    truth = np.broadcast_to(np.deg2rad(40.0), (75, 12))
    assert slips(truth, first_deg=40.0) == ([], [])


def test_nothing_is_judged_before_it_is_time() -> None:
    truth = np.zeros((75, 12))
    truth[10:, COLUMNS[0, 1]] = np.deg2rad(40.0)
    assert slips(truth, begin=0)[0] != []
    assert slips(truth, begin=20 * 60)[0] == []
