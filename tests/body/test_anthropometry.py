"""The likeliest body: the person keeps their height, what was measured moves the rest, mistakes are named."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vip_factors.body.anthropometry import LEAST_SIGMA, STATURE_RANGE_M, LengthPrior, likely_body, skeleton_from_stature
from vip_factors.body.lengths import LENGTHS, LIMB_ENDS, BodyVariation, lengths_of
from vip_factors.body.skeleton import JOINT_NAMES, Skeleton, joint_index
from vip_factors.errors import InputError

statures = st.floats(1.1, 2.1)
sexes = st.sampled_from([None, "male", "female"])


def sigmas(**known: Any) -> dict[str, float]:
    """Standard deviations in metres of the lengths of a person of whom this is known."""
    covariance = likely_body(**known).variation.covariance
    return dict(zip(LENGTHS, np.sqrt(np.diag(covariance)).tolist(), strict=True))


def trunk(skeleton: Skeleton) -> float:
    """Rise from mid hip to neck."""
    y = skeleton.p_pelvis_joint[:, 1]
    return float(y[joint_index("neck")] - y[joint_index("left_hip")])


@given(statures, sexes)
def test_stature_is_respected_to_a_tape(stature: float, sex: str | None) -> None:
    assert np.isclose(skeleton_from_stature(stature, sex).stature, stature, atol=0.01)


@given(sexes)
def test_proportions_scale_with_stature_beyond_the_people_measured(sex: str | None) -> None:
    one, other = (skeleton_from_stature(stature, sex).p_parent_joint for stature in (1.2, 1.1))
    np.testing.assert_allclose(one / 1.2, other / 1.1, atol=1e-3)


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
    [(name.replace(" ", "_"), end) for name, end in LIMB_ENDS.items()],
)
def test_a_measured_limb_moves_both_sides_as_far_as_a_tape_is_sure(segment: str, joint: str) -> None:
    usual = skeleton_from_stature(1.8).bone_length(f"left_{joint}")
    measured = usual + 0.03
    for name in (segment, f"left_{segment}"):
        body = skeleton_from_stature(1.8, None, {name: measured})
        for side in ("left", "right"):
            assert usual + 0.012 < body.bone_length(f"{side}_{joint}") <= measured
        assert name in body.source


def test_sides_keep_their_difference_and_their_mean_is_what_one_length_would_say() -> None:
    one = skeleton_from_stature(1.8, None, {"thigh": 0.45})
    two = skeleton_from_stature(1.8, None, {"left_thigh": 0.455, "right_thigh": 0.445})
    left, right = (two.bone_length(f"{side}_knee") for side in ("left", "right"))
    assert np.isclose(left - right, 0.01)
    assert np.isclose((left + right) / 2, one.bone_length("left_knee"))
    assert np.isclose(trunk(one), trunk(two))
    mixed = skeleton_from_stature(1.8, None, {"thigh": 0.445, "left_thigh": 0.455})
    np.testing.assert_allclose(mixed.p_parent_joint, two.p_parent_joint)


@pytest.mark.parametrize("change", [0.04, -0.04])
def test_measured_legs_move_the_trunk_and_the_stature_is_kept(change: float) -> None:
    usual = skeleton_from_stature(1.75, "male")
    legs = {"thigh": usual.bone_length("left_knee") + change, "shank": usual.bone_length("left_ankle") + change}
    body = skeleton_from_stature(1.75, "male", legs)
    assert np.isclose(body.stature, usual.stature, atol=0.008)
    assert np.sign(trunk(usual) - trunk(body)) == np.sign(change)
    assert abs(trunk(usual) - trunk(body)) > 0.7 * abs(change)


def test_measured_widths_and_trunk_are_believed() -> None:
    body = skeleton_from_stature(1.8, None, {"hip_width": 0.2, "shoulder_width": 0.4, "trunk": 0.55})
    at = {name: body.p_pelvis_joint[joint_index(name)] for name in JOINT_NAMES}
    assert np.isclose(at["left_hip"][0] - at["right_hip"][0], 0.2, atol=0.003)
    assert np.isclose(at["left_shoulder"][0] - at["right_shoulder"][0], 0.4, atol=0.003)
    assert np.isclose(trunk(body), 0.55, atol=0.003)


def test_what_was_measured_is_surer_and_so_is_what_follows() -> None:
    before, after = sigmas(stature_m=1.75), sigmas(stature_m=1.75, segment_lengths_m={"thigh": 0.42, "shank": 0.43})
    assert after["thigh"] <= 0.007 < 0.02 < before["thigh"]
    assert after["trunk"] < before["trunk"]
    unknown = sigmas()
    assert unknown["trunk"] > 1.2 * before["trunk"]


def test_mass_tells_widths() -> None:
    slim, heavy = (skeleton_from_stature(1.75, "male", None, mass).p_pelvis_joint for mass in (60, 110))
    assert heavy[joint_index("left_hip"), 0] > slim[joint_index("left_hip"), 0] + 0.003


def test_an_unknown_stature_is_an_adults_and_said_so() -> None:
    body = likely_body()
    assert 1.6 < body.skeleton.stature < 1.8
    assert "stature unknown" in body.skeleton.source
    assert "stature unknown" in body.note
    assert likely_body(1.75).note == ""


@pytest.mark.parametrize(("stature", "children"), [(1.1, True), (2.1, False)])
def test_a_stature_that_no_adult_had_is_noted_and_held_for_less_certain(stature: float, children: bool) -> None:
    body = likely_body(stature)
    assert "standard deviations" in body.note
    assert ("children" in body.note) is children
    inside = 1.5 if children else 1.9
    wide, usual = sigmas(stature_m=stature), sigmas(stature_m=inside)
    assert all(wide[name] / stature > 1.1 * usual[name] / inside for name in LENGTHS)


@pytest.mark.parametrize("stature", STATURE_RANGE_M)
def test_the_smallest_and_tallest_have_a_body(stature: float) -> None:
    assert np.isclose(skeleton_from_stature(stature).stature, stature, atol=0.01)


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
    with pytest.raises(InputError, match="sex 'm': expected 'male' or 'female'"):
        skeleton_from_stature(1.7, "m")
    with pytest.raises(InputError, match="mass 815 kg: expected between 8 and 400"):
        skeleton_from_stature(1.7, mass_kg=815)


USUAL = skeleton_from_stature(1.75)


def covariance_of(variation: BodyVariation) -> np.ndarray:
    return np.linalg.inv(variation.whitening.T @ variation.whitening)


@given(st.lists(st.floats(-0.03, 0.03), min_size=len(LENGTHS), max_size=len(LENGTHS)))
def test_lengths_change_by_what_a_skeleton_is_changed(changes: list[float]) -> None:
    varied = likely_body(USUAL.stature).variation.varied(USUAL, np.array(changes))
    np.testing.assert_allclose(lengths_of(varied) - lengths_of(USUAL), changes, atol=1e-9)


def test_a_limb_without_length_has_none() -> None:
    offsets = USUAL.p_parent_joint.copy()
    offsets[[joint_index("left_wrist"), joint_index("right_wrist")]] = 0.0
    found = dict(zip(LENGTHS, lengths_of(replace(USUAL, p_parent_joint=offsets)), strict=True))
    assert found["forearm"] == pytest.approx(0.0, abs=1e-9)
    assert found["thigh"] == pytest.approx(USUAL.bone_length("left_knee"))


def test_lengths_are_those_of_a_tape() -> None:
    found = dict(zip(LENGTHS, lengths_of(USUAL), strict=True))
    rest = USUAL.p_pelvis_joint
    assert found["thigh"] == pytest.approx(USUAL.bone_length("left_knee"))
    assert found["shoulder width"] == pytest.approx(rest[16, 0] - rest[17, 0])
    assert found["hip width"] == pytest.approx(rest[1, 0] - rest[2, 0])
    assert found["trunk"] == pytest.approx(rest[12, 1])


def test_a_prior_is_about_the_skeleton_and_as_sure_as_told() -> None:
    told = np.diag(np.linspace(0.005, 0.02, len(LENGTHS)) ** 2)
    variation = LengthPrior(LENGTHS, told).variation(USUAL)
    np.testing.assert_array_equal(variation.mean, 0.0)
    np.testing.assert_allclose(covariance_of(variation), told, atol=1e-12)


def test_no_combination_of_lengths_is_surer_than_the_least_sigma() -> None:
    variation = LengthPrior(LENGTHS, np.full((len(LENGTHS),) * 2, 1e-4)).variation(USUAL)  # all err alike
    assert np.linalg.eigvalsh(covariance_of(variation))[0] == pytest.approx(LEAST_SIGMA**2, rel=1e-6)


def test_lengths_without_a_name_are_as_sure_as_anybodys_and_unknown_names_are_passed_over() -> None:
    variation = LengthPrior(("thigh", "tail"), np.diag([1e-4, 1e-2])).variation(USUAL)
    usual, found = covariance_of(likely_body(USUAL.stature).variation), covariance_of(variation)
    thigh = LENGTHS.index("thigh")
    rest = [place for place in range(len(LENGTHS)) if place != thigh]
    np.testing.assert_allclose(found[np.ix_(rest, rest)], usual[np.ix_(rest, rest)], atol=1e-9)
    assert found[thigh, thigh] == pytest.approx(1e-4)
    np.testing.assert_allclose(found[thigh, rest], 0.0, atol=1e-12)


@pytest.mark.parametrize("covariance", [np.eye(3), [[1.0, 0.5], [0.0, 1.0]], [[np.nan, 0], [0, 1]], -np.eye(2)])
def test_what_is_no_covariance_is_refused(covariance: np.ndarray) -> None:
    with pytest.raises(InputError, match="covariance"):
        LengthPrior(("thigh", "shank"), np.asarray(covariance, float))
