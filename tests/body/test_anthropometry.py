"""A skeleton from stature: the person keeps their height, measured lengths win, mistakes are named."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.skeleton import JOINT_NAMES, joint_index
from vip_factors.errors import InputError

statures = st.floats(1.0, 2.2)
sexes = st.sampled_from([None, "male", "female"])


@given(statures, sexes)
def test_stature_is_respected(stature: float, sex: str | None) -> None:
    assert np.isclose(skeleton_from_stature(stature, sex).stature, stature)


@given(statures, sexes)
def test_proportions_scale_with_stature(stature: float, sex: str | None) -> None:
    one = skeleton_from_stature(1.0, sex).p_parent_joint
    np.testing.assert_allclose(skeleton_from_stature(stature, sex).p_parent_joint, one * stature, atol=1e-12)


@given(statures, sexes)
def test_the_person_stands_upright_and_even(stature: float, sex: str | None) -> None:
    skeleton = skeleton_from_stature(stature, sex)
    at = {name: skeleton.p_pelvis_joint[joint_index(name)] for name in JOINT_NAMES}
    up = ["left_foot", "left_ankle", "left_knee", "left_hip", "spine1", "spine2", "spine3", "neck", "head"]
    heights = [at[name][1] for name in up]
    assert heights == sorted(heights)
    assert at["left_hip"][0] > 0 > at["right_hip"][0]
    assert at["left_foot"][2] > at["left_ankle"][2]
    for name, position in at.items():
        if name.startswith("left_"):
            mirror = at[name.replace("left_", "right_")] * [-1, 1, 1]
            np.testing.assert_allclose(position, mirror, atol=1e-12)
    for name, landmark in skeleton.landmarks.items():
        if name.startswith("left_"):
            mirror = skeleton.landmarks[name.replace("left_", "right_")].p_bone_point * [-1, 1, 1]
            np.testing.assert_allclose(landmark.p_bone_point, mirror, atol=1e-12)


def test_soles_are_flat() -> None:
    skeleton = skeleton_from_stature(1.75)
    ground = {
        name: skeleton.p_pelvis_joint[mark.bone][1] + mark.p_bone_point[1]
        for name, mark in skeleton.landmarks.items()
        if "heel" in name or "toe" in name
    }
    assert np.ptp(list(ground.values())) < 1e-9


@pytest.mark.parametrize(
    ("segment", "joint"),
    [
        ("thigh", "knee"),
        ("shank", "ankle"),
        ("foot", "foot"),
        ("upper_arm", "elbow"),
        ("forearm", "wrist"),
        ("hand", "hand"),
    ],
)
def test_a_measured_limb_wins_on_the_side_it_names(segment: str, joint: str) -> None:
    plain = skeleton_from_stature(1.8)
    both = skeleton_from_stature(1.8, None, {segment: 0.31})
    left = skeleton_from_stature(1.8, None, {f"left_{segment}": 0.31})
    for side in ("left", "right"):
        assert np.isclose(both.bone_length(f"{side}_{joint}"), 0.31)
    assert np.isclose(left.bone_length(f"left_{joint}"), 0.31)
    assert np.isclose(left.bone_length(f"right_{joint}"), plain.bone_length(f"right_{joint}"))
    assert segment in both.source


def test_measured_widths_and_trunk_win() -> None:
    body = skeleton_from_stature(1.8, None, {"hip_width": 0.2, "shoulder_width": 0.4, "trunk": 0.55})
    at = {name: body.p_pelvis_joint[joint_index(name)] for name in JOINT_NAMES}
    assert np.isclose(at["left_hip"][0] - at["right_hip"][0], 0.2)
    assert np.isclose(at["left_shoulder"][0] - at["right_shoulder"][0], 0.4)
    hips = (at["left_hip"] + at["right_hip"]) / 2
    assert np.isclose(np.linalg.norm(at["neck"] - hips), 0.55, rtol=2e-3)


def test_centimetres_are_caught() -> None:
    with pytest.raises(InputError, match=r"178 looks like centimetres, give 1\.78"):
        skeleton_from_stature(178)
    with pytest.raises(InputError, match="thigh = 45 m: expected metres"):
        skeleton_from_stature(1.78, None, {"thigh": 45})


@pytest.mark.parametrize("stature", [0.0, -1.7, 0.5, 3.0, float("nan")])
def test_implausible_statures_are_refused(stature: float) -> None:
    with pytest.raises(InputError, match=r"expected between 0\.8 and 2\.6 metres"):
        skeleton_from_stature(stature)


def test_unknown_names_are_refused_with_the_known_ones() -> None:
    with pytest.raises(InputError, match="unknown segment 'tibia': expected one of thigh, shank"):
        skeleton_from_stature(1.7, None, {"tibia": 0.4})
    with pytest.raises(InputError, match="unknown segment 'left_trunk'"):
        skeleton_from_stature(1.7, None, {"left_trunk": 0.4})
    with pytest.raises(InputError, match="sex 'm': expected 'male', 'female' or nothing"):
        skeleton_from_stature(1.7, "m")
