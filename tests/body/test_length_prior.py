"""Lengths of skeletons, and what is known of those that were found before."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vip_factors.body.anthropometry import likely_body, skeleton_from_stature
from vip_factors.body.length_prior import LEAST_SIGMA, LengthPrior
from vip_factors.body.lengths import LENGTHS
from vip_factors.body.skeleton import joint_index
from vip_factors.body.variation import BodyVariation, lengths_of
from vip_factors.errors import InputError

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
