"""Bodies of one stature: lengths change as they are told to, both sides alike, and every point with them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vip_factors.body.anthropometry import likely_body
from vip_factors.body.kinematics import forward_kinematics
from vip_factors.body.lengths import LENGTHS
from vip_factors.body.skeleton import joint_index
from vip_factors.geometry.rotations import exp

LIKELY = likely_body(1.75)
SKELETON, VARIATION = LIKELY.skeleton, LIKELY.variation
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
    covariance = VARIATION.covariance
    sigma = np.sqrt(np.diag(covariance))
    thigh, trunk = LENGTHS.index("thigh"), LENGTHS.index("trunk")
    assert covariance[thigh, trunk] / (sigma[thigh] * sigma[trunk]) < -0.3
    assert 0.015 < sigma[thigh] < 0.035


def test_bodies_of_one_stature_keep_it() -> None:
    random = np.random.default_rng(3)
    draws = random.multivariate_normal(np.zeros(len(LENGTHS)), VARIATION.covariance, 200)
    statures = [VARIATION.varied(SKELETON, draw).stature for draw in draws]
    # A tape's centimetre, and what the head above its joint and the ankle take from the rest.
    assert np.std(statures) < 0.03 < np.sqrt(np.trace(VARIATION.covariance))


@pytest.mark.parametrize(
    ("name", "joint", "axis"),
    [("hip_depth", "left_hip", 2), ("shoulder_depth", "right_shoulder", 2), ("neck_depth", "neck", 2),
     ("neck", "head", 1), ("hip_height", "right_hip", 1), ("shoulder_height", "left_shoulder", 1)],
)  # fmt: skip
def test_depths_and_heights_move_a_centre_along_one_axis(name: str, joint: str, axis: int) -> None:
    varied = VARIATION.varied(SKELETON, changed(**{name: 0.02}))
    moved = varied.p_pelvis_joint[joint_index(joint)] - SKELETON.p_pelvis_joint[joint_index(joint)]
    np.testing.assert_allclose(moved, 0.02 * np.eye(3)[axis], atol=1e-12)


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
