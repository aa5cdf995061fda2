"""Poses move as GTSAM's ``Pose3`` does."""

import gtsam
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vip_factors.geometry.poses import pose_right_jacobian, retract_pose
from vip_factors.geometry.rotations import exp


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, 9.9e-3, 1.1e-2, 0.4, 3.0])
@given(st.integers(0, 2**32 - 1))
def test_jacobians_and_steps_are_those_of_gtsam(angle: float, seed: int) -> None:
    random = np.random.default_rng(seed)
    step = random.standard_normal(6)
    step[:3] *= angle / np.linalg.norm(step[:3])
    np.testing.assert_allclose(pose_right_jacobian(step), gtsam.Pose3.ExpmapDerivative(step), atol=1e-10)
    R, p = exp(random.standard_normal(3)), random.standard_normal(3)
    moved = gtsam.Pose3(gtsam.Rot3(R), p).retract(step)
    ours_R, ours_p = retract_pose(R[None], p[None], step[None])
    np.testing.assert_allclose(ours_R[0], moved.rotation().matrix(), atol=1e-12)
    np.testing.assert_allclose(ours_p[0], moved.translation(), atol=1e-12)
