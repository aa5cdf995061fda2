"""Errors of headings and mountings, and whether covariances are honest."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vip_factors.errors import InputError
from vip_factors.evaluate.calibration import (
    calibration_error,
    nees,
    sensor_consistency,
)
from vip_factors.geometry.rotations import exp
from vip_factors.sensors.calibration import SensorCalibration

NAMES = ("head", "pelvis", "left_foot", "right_foot")


def calibrated(headings: np.ndarray, turns: np.ndarray, sigma: float = 0.1) -> dict[str, SensorCalibration]:
    return {
        name: SensorCalibration(float(heading), exp(turn), sigma, np.full(3, sigma))
        for name, heading, turn in zip(NAMES, headings, turns, strict=True)
    }


@given(st.floats(-10, 10))
def test_a_common_yaw_is_no_error_even_across_the_wrap(yaw: float) -> None:
    headings = np.array([-3.0, -1.0, 2.0, 3.1])
    errors = np.array([0.02, -0.02, 0.01, -0.01])
    result = calibration_error(
        calibrated(headings + errors + yaw, np.zeros((4, 3))), calibrated(headings, np.zeros((4, 3)))
    )
    assert list(result.heading.values()) == pytest.approx(errors, abs=1e-6)


def test_mounting_errors_are_about_the_axes_of_the_sensor() -> None:
    random = np.random.default_rng(0)
    true, error = random.standard_normal((2, 4, 3))
    error *= 0.1
    estimate = {name: SensorCalibration(0.0, exp(t) @ exp(-e)) for name, t, e in zip(NAMES, true, error, strict=True)}
    result = calibration_error(estimate, calibrated(np.zeros(4), true))
    assert np.stack(list(result.mounting.values())) == pytest.approx(error)
    assert result.mounting_magnitude == pytest.approx(np.linalg.norm(error, axis=1))


def test_only_shared_sensors_count() -> None:
    truth = calibrated(np.zeros(4), np.zeros((4, 3)))
    one = {"pelvis": truth["pelvis"], "spare": truth["head"]}
    assert list(calibration_error(one, truth).heading) == ["pelvis"]
    with pytest.raises(InputError, match="share no sensor"):
        calibration_error({"spare": truth["head"]}, truth)


def test_honest_errors_have_nees_one() -> None:
    random = np.random.default_rng(0)
    root = random.standard_normal((3, 3))
    error = random.standard_normal((20_000, 3)) @ root.T
    covariance = np.broadcast_to(root @ root.T, (20_000, 3, 3))
    assert nees(error, covariance).mean() == pytest.approx(1.0, abs=0.03)
    assert nees(error, covariance / 4).mean() == pytest.approx(4.0, abs=0.1)


def test_calibration_nees_uses_the_reported_sigmas() -> None:
    headings = np.array([0.2, -0.2, 0.1, -0.1])
    estimate = calibrated(headings, np.full((4, 3), 0.0), sigma=0.1)
    truth = calibrated(np.zeros(4), np.full((4, 3), 0.1 / np.sqrt(3)))
    error = calibration_error(estimate, truth)
    honesty = sensor_consistency({0: (error, estimate)}, None)
    assert honesty["nees_heading"].value == pytest.approx(2.5, rel=1e-6)
    assert honesty["nees_mounting"].value == pytest.approx(1 / 3)
    unknown = {name: SensorCalibration(one.heading, one.R_bone_sensor) for name, one in estimate.items()}
    assert sensor_consistency({0: (calibration_error(unknown, truth), unknown)}, None) == {}
