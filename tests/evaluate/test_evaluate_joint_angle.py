"""Knee flexion from segment orientations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vip_factors.body.skeleton import joint_index
from vip_factors.evaluate.joint_angle import knee_flexion_deg, knee_flexion_of, rmse, rmse_without_offset
from vip_factors.geometry.rotations import exp, rotation_x, rotation_y, rotation_z
from vip_factors.simulate.gestures import gestures

angles = st.floats(-0.5, 0.5)


@given(st.floats(-20, 140), angles, angles, angles)
def test_flexion_is_found_whatever_the_other_angles_are(
    flexion: float, adduction: float, turn: float, tilt: float
) -> None:
    R_world_thigh = exp([tilt, 1.0, -tilt])
    R_world_shank = R_world_thigh @ rotation_x(np.deg2rad(flexion)) @ rotation_z(adduction) @ rotation_y(turn)
    assert knee_flexion_deg(R_world_thigh, R_world_shank) == pytest.approx(flexion, abs=1e-9)


def test_flexion_of_a_motion_whose_knees_are_hinges() -> None:
    walk = gestures(3.0, rate=60.0)
    for side in ("left", "right"):
        R = walk.R_parent_child[:, joint_index(f"{side}_knee")]
        assert knee_flexion_of(walk, side) == pytest.approx(np.rad2deg(np.arctan2(R[:, 2, 1], R[:, 1, 1])))
        assert knee_flexion_of(walk, side).max() > 40  # positive: the shank goes back


def test_rmse_with_and_without_offset() -> None:
    truth = np.array([0.0, 10.0, 20.0, np.nan])
    assert rmse(truth + 3.0, truth) == pytest.approx(3.0)
    assert rmse_without_offset(truth + 3.0, truth) == pytest.approx(0.0)
    assert rmse_without_offset(truth + np.array([2.0, 4.0, 3.0, 0.0]), truth) == pytest.approx(np.sqrt(2 / 3))
