"""Bodies of one stature: lengths change as they are told to, both sides alike, and every point with them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.kinematics import forward_kinematics
from vip_factors.body.skeleton import joint_index
from vip_factors.body.variation import LENGTHS, BodyVariation
from vip_factors.geometry.rotations import exp

SKELETON = skeleton_from_stature(1.75)
VARIATION = BodyVariation.of(SKELETON)
ENDS = {"thigh": "knee", "shank": "ankle", "upper arm": "elbow", "forearm": "wrist", "hand": "hand", "foot": "foot"}


def changed(**lengths: float) -> np.ndarray:
    return np.array([lengths.get(name.replace(" ", "_"), 0.0) for name in LENGTHS])


@pytest.mark.parametrize("name", ENDS)
@given(metres=st.floats(-0.05, 0.05))
def test_a_limb_grows_by_so_much_on_both_sides_and_nothing_else_does(name: str, metres: float) -> None:
    varied = VARIATION.varied(SKELETON, changed(**{name.replace(" ", "_"): metres}))
    ends = [joint_index(f"{side}_{ENDS[name]}") for side in ("left", "right")]
    before, after = (np.linalg.norm(one.p_parent_joint, axis=1) for one in (SKELETON, varied))
    np.testing.assert_allclose(after[ends] - before[ends], metres, atol=1e-12)
    rest = np.delete(np.arange(24), ends)
    np.testing.assert_array_equal(varied.p_parent_joint[rest], SKELETON.p_parent_joint[rest])


def test_widths_and_trunk_are_what_their_names_say() -> None:
    varied = VARIATION.varied(SKELETON, changed(hip_width=0.02, shoulder_width=0.03, trunk=0.04))
    before, after = SKELETON.p_pelvis_joint, varied.p_pelvis_joint
    for joint, metres in (("hip", 0.02), ("shoulder", 0.03)):
        left, right = joint_index(f"left_{joint}"), joint_index(f"right_{joint}")
        grown = (after[left] - after[right]) - (before[left] - before[right])
        np.testing.assert_allclose(grown, [metres, 0, 0], atol=1e-12)
    neck = joint_index("neck")
    assert after[neck, 1] - before[neck, 1] == pytest.approx(0.04)


def test_a_gaussian_about_a_changed_body_is_the_same_gaussian() -> None:
    lengths, step = changed(thigh=0.02, trunk=-0.03), changed(shank=0.01)
    moved = VARIATION.about(lengths)
    whole = VARIATION.whitening @ (lengths + step - VARIATION.mean)
    np.testing.assert_allclose(moved.whitening @ (step - moved.mean), whole)


def test_trunk_and_thigh_take_from_each_other() -> None:
    covariance = np.linalg.inv(VARIATION.whitening.T @ VARIATION.whitening)
    sigma = np.sqrt(np.diag(covariance))
    thigh, trunk = LENGTHS.index("thigh"), LENGTHS.index("trunk")
    assert covariance[thigh, trunk] / (sigma[thigh] * sigma[trunk]) < -0.5
    assert 0.015 < sigma[thigh] < 0.025


def test_joints_move_as_their_derivatives_say() -> None:
    random = np.random.default_rng(0)
    R, p = exp(random.standard_normal((3, 24, 3))), random.standard_normal((3, 3))
    body, step = forward_kinematics(SKELETON, R, p), 0.01 * random.standard_normal(len(LENGTHS))
    moved = forward_kinematics(VARIATION.varied(SKELETON, step), R, p)
    expected = body.p_world_joint + body.joints_by_offsets(VARIATION.directions) @ step
    np.testing.assert_allclose(moved.p_world_joint, expected, atol=1e-12)


def test_a_sensor_keeps_its_share_of_the_limb() -> None:
    knee = SKELETON.p_parent_joint[joint_index("left_knee")]
    bone, place = joint_index("left_hip"), 0.6 * knee + np.array([0.05, 0.0, 0.0])
    shift = VARIATION.of_points(SKELETON, (bone,), place[None])[0] @ changed(thigh=0.1)
    np.testing.assert_allclose(shift, 0.06 * knee / np.linalg.norm(knee), atol=1e-12)
