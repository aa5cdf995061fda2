"""Hinges that were found: what follows from their variables, and what the next recording believes of them."""

import numpy as np
import pytest

from vip_factors.body.hinge_estimate import LEAST_SIGMA, HingeEstimate, HingePrior, hinge_estimates
from vip_factors.body.hinges import HINGE_OF, HINGE_SIGMAS, HINGE_VARIABLES, HINGES
from vip_factors.errors import InputError


def found(joint: str, sigma: float, seed: int = 0) -> HingeEstimate:
    count = len(HINGE_OF[joint].columns)
    return HingeEstimate(joint, 0.1 * np.random.default_rng(seed).normal(size=count), sigma**2 * np.eye(count))


def test_every_variable_belongs_to_one_hinge() -> None:
    columns = np.concatenate([one.columns for one in HINGES])
    assert sorted(columns) == list(range(HINGE_VARIABLES))
    mean = np.random.default_rng(1).normal(size=HINGE_VARIABLES)
    for one in hinge_estimates(mean, np.diag(mean**2)):
        np.testing.assert_array_equal(np.diag(one.covariance), one.variables**2)


@pytest.mark.parametrize("joint", HINGE_OF)
def test_an_axis_tells_its_tilt(joint: str) -> None:
    hinge, tilt = HINGE_OF[joint], np.array([0.2, -0.1])
    np.testing.assert_allclose(hinge.tilt_to(hinge.direction(tilt)), tilt)


@pytest.mark.parametrize("joint", HINGE_OF)
def test_the_carrying_angle_is_as_sure_as_what_it_follows_from(joint: str) -> None:
    one, rng = found(joint, 0.02), np.random.default_rng(2)
    drawn = one.variables + 0.02 * rng.normal(size=(4000, len(one.variables)))
    angles = [HingeEstimate(joint, each, one.covariance).carrying_angle for each in drawn]
    assert np.std(angles) == pytest.approx(one.carrying_sigma, rel=0.05)


def test_what_was_found_is_likely_the_next_time_and_the_rest_is_anybodys() -> None:
    knee = found("left_knee", 0.2 * LEAST_SIGMA)
    prior = HingePrior.about([knee])
    [elbow, _, left, right] = prior.hinges()
    np.testing.assert_array_equal(left.variables, knee.variables)
    np.testing.assert_allclose(left.covariance, LEAST_SIGMA**2 * np.eye(4), atol=1e-12)  # and no surer than that
    np.testing.assert_array_equal(right.variables, np.zeros(4))
    np.testing.assert_allclose(np.diag(elbow.covariance), HINGE_SIGMAS[elbow.hinge.columns] ** 2)
    np.testing.assert_allclose(
        prior.whitening.T @ prior.whitening @ prior.covariance, np.eye(HINGE_VARIABLES), atol=1e-9
    )


def test_what_is_no_hinge_is_told() -> None:
    with pytest.raises(InputError, match="'neck' is no hinge: expected one of left_elbow"):
        HingeEstimate("neck", np.zeros(3), np.eye(3))
    with pytest.raises(InputError, match=r"left_elbow has 4 variables.*expected 3"):
        HingeEstimate("left_elbow", np.zeros(4), np.eye(4))
