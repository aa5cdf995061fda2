"""Calibration poses as people hold them."""

import numpy as np
import pytest

from vip_factors.body.joint_priors import joint_vector, mirror_joint_vector
from vip_factors.body.skeleton import POSES, calibration_pose, held_pose, joint_index
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import angle_between


@pytest.mark.parametrize("pose", POSES)
def test_a_held_pose_is_alike_on_both_sides(pose: str) -> None:
    held = held_pose(pose)
    vector = joint_vector(held.R_parent_child)
    np.testing.assert_allclose(mirror_joint_vector(vector), vector, atol=1e-12)
    left, right = (held.sigma[joint_index(f"{side}_shoulder")] for side in ("left", "right"))
    np.testing.assert_array_equal(left, right)


@pytest.mark.parametrize("pose", POSES)
def test_the_nominal_pose_is_not_unlikely(pose: str) -> None:
    held = held_pose(pose)
    turned = joint_vector(np.swapaxes(held.R_parent_child, -1, -2) @ calibration_pose(pose)).reshape(-1, 3)
    assert np.all(np.abs(turned) < 2 * held.sigma[1:] + 1e-12)


def test_an_arm_says_least_about_its_own_axis() -> None:
    sigma = held_pose("t-pose").sigma[joint_index("left_shoulder")]
    assert sigma[0] > 1.5 * sigma[1:].max()


def test_arms_in_a_t_pose_hang_a_little_and_elbows_are_bent() -> None:
    held = held_pose("t-pose").R_parent_child
    assert 10 < np.degrees(angle_between(held[joint_index("left_elbow")], np.eye(3))) < 25
    assert (held[joint_index("left_shoulder")] @ [1.0, 0.0, 0.0])[1] < 0 < (held[0] @ [0.0, 1.0, 0.0])[2]


def test_another_pose_is_refused() -> None:
    with pytest.raises(InputError, match="a-pose"):
        held_pose("a-pose")
