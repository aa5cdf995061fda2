"""Elbows and knees as hinges."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vip_factors.body.joint_priors import (
    HINGE_OF,
    HINGE_SIGMAS,
    HINGE_VARIABLES,
    HINGES,
    LEAST_SIGMA,
    TILTS,
    HingeEstimate,
    HingePrior,
    hinge_estimates,
)
from vip_factors.body.skeleton import JOINT_COUNT, joint_index
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import exp, rotation_x
from vip_factors.terms.hinge import hinge_residual

angles = st.floats(-1.5, 1.5)


def turned(joint: str, R: np.ndarray) -> np.ndarray:
    """All joints straight but one."""
    pose = np.broadcast_to(np.eye(3), (1, JOINT_COUNT, 3, 3)).copy()
    pose[0, joint_index(joint)] = R
    return pose


@given(angles, angles)
def test_an_elbow_bends_about_y_and_the_forearm_turns_about_itself_for_nothing(bend: float, pronation: float) -> None:
    pose = turned("left_elbow", exp([0.0, bend, 0.0]) @ rotation_x(pronation))
    np.testing.assert_allclose(hinge_residual(pose, np.zeros(HINGE_VARIABLES)), 0.0, atol=1e-12)


@given(angles)
def test_a_knee_bends_about_x_for_nothing_and_does_not_turn_about_itself(bend: float) -> None:
    nothing = np.zeros(HINGE_VARIABLES)
    assert np.abs(hinge_residual(turned("right_knee", rotation_x(bend)), nothing)).max() < 1e-12
    assert np.abs(hinge_residual(turned("right_knee", rotation_x(bend) @ exp([0, 0.2, 0])), nothing)).max() > 0.15


@given(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2), angles)
def test_a_personal_axis_is_turned_about_for_nothing(tilt: float, other: float, bend: float) -> None:
    for number, hinge in enumerate(HINGES):
        variables = np.zeros(HINGE_VARIABLES)
        variables[2 * number : 2 * number + 2] = tilt, other
        axis = hinge.direction(variables[2 * number : 2 * number + 2])
        variables[TILTS:][hinge.rows] = axis @ hinge.square
        residual = hinge_residual(turned(hinge.joint, exp(bend * axis)), variables)
        np.testing.assert_allclose(residual[:, hinge.rows], 0.0, atol=1e-12)


@given(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2))
def test_a_limb_that_leads_away_from_the_body_has_a_positive_carrying_angle(tilt: float, angle: float) -> None:
    for number, hinge in enumerate(HINGES):
        outwards = 1.0 if hinge.joint.startswith("left") else -1.0
        # About the forward axis: the left forearm rises, the left foot goes to the left.
        pose = turned(hinge.joint, exp([0.0, 0.0, outwards * angle]))
        variables = np.zeros(HINGE_VARIABLES)
        variables[2 * number] = tilt
        axis = hinge.direction(variables[2 * number : 2 * number + 2])
        variables[TILTS + hinge.rows.start] = axis @ pose[0, hinge.index] @ hinge.square[:, 0]
        found = hinge.carrying_angle(variables[2 * number : 2 * number + 2], variables[TILTS + hinge.rows.start])
        np.testing.assert_allclose(found, angle, atol=1e-9)


def found(joint: str, sigma: float, seed: int = 0) -> HingeEstimate:
    count = len(HINGE_OF[joint].columns)
    return HingeEstimate(joint, 0.1 * np.random.default_rng(seed).normal(size=count), sigma**2 * np.eye(count))


def test_every_variable_belongs_to_one_hinge() -> None:
    columns = np.concatenate([one.columns for one in HINGES])
    assert sorted(columns) == list(range(HINGE_VARIABLES))
    mean = np.random.default_rng(1).normal(size=HINGE_VARIABLES)
    for estimate in hinge_estimates(mean, np.diag(mean**2)):
        np.testing.assert_array_equal(np.diag(estimate.covariance), estimate.variables**2)


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
