"""Elbows and knees as hinges."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from vip_factors.body.hinges import HINGE_VARIABLES, HINGES, TILTS
from vip_factors.body.skeleton import JOINT_COUNT, joint_index
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
