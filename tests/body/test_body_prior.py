"""The prior over bodies: lengths between joint centres are what people's are, and conditioning is Bayes's."""

import numpy as np
import pytest

from vip_factors.body.anthropometry import (
    GROUPS,
    SIZE,
    STATURE_ROW,
    VARIABLES,
    Observation,
    load_body_prior,
)
from vip_factors.body.lengths import BODY_LENGTHS, skeleton_of_lengths
from vip_factors.body.skeleton import joint_index
from vip_factors.errors import InputError

# Fractions of stature between which published and measured people lie: de Leva 1996 (of women all but the thigh), Dumas
# et al. 2007, optical skeletons of five people.
BANDS = {
    "thigh": (0.235, 0.250), "shank": (0.238, 0.253), "upper arm": (0.150, 0.162), "forearm": (0.149, 0.160),
    "hip width": (0.095, 0.108), "shoulder width": (0.190, 0.205), "ankle height": (0.034, 0.042),
}  # fmt: skip


@pytest.mark.parametrize("group", GROUPS)
def test_lengths_are_what_was_measured_of_people(group: str) -> None:
    gaussian = load_body_prior().groups[group]
    lengths = dict(zip(VARIABLES, gaussian.mean / gaussian.stature[0], strict=True))
    for name, (low, high) in BANDS.items():
        assert low < lengths[name] < high, name
    y = skeleton_of_lengths(gaussian.mean[1:], "").p_pelvis_joint[:, 1] / gaussian.stature[0]
    hip, shoulder, neck = (y[joint_index(name)] for name in ("left_hip", "left_shoulder", "neck"))
    assert 0.255 < shoulder - hip < 0.270
    assert 0.305 < neck - hip < 0.340


def test_one_definition_of_the_hip_serves_both_sexes() -> None:
    groups = load_body_prior().groups
    thighs = [groups[sex].mean[VARIABLES.index("thigh")] / groups[sex].stature[0] for sex in ("male", "female")]
    assert abs(thighs[0] - thighs[1]) < 0.003


def test_statures_are_the_surveys() -> None:
    groups = load_body_prior().groups
    for name, stature, sigma in (("male", 1.756, 0.0686), ("female", 1.628, 0.0642)):
        np.testing.assert_allclose(groups[name].stature, (stature, sigma), atol=5e-4)
    assert groups["both"].stature[0] == pytest.approx((1.756 + 1.628) / 2, abs=1e-3)


def test_stature_is_the_sum_of_lengths() -> None:
    lengths = load_body_prior().groups["male"].mean[1:]
    assert skeleton_of_lengths(lengths, "").stature == pytest.approx(STATURE_ROW[1:] @ lengths)
    assert len(lengths) == len(BODY_LENGTHS)


def test_conditioning_is_bayes() -> None:
    prior = load_body_prior().of("female")
    rows = [STATURE_ROW, np.eye(SIZE)[VARIABLES.index("thigh")]]
    seen = [Observation(rows[0], 1.7, 0.01), Observation(rows[1], 0.4, 0.007)]
    found = prior.given(seen)
    information = np.linalg.inv(prior.covariance) + sum(np.outer(o.row, o.row) / o.sigma**2 for o in seen)
    gradient = np.linalg.solve(prior.covariance, prior.mean) + sum(o.row * o.value / o.sigma**2 for o in seen)
    np.testing.assert_allclose(found.covariance, np.linalg.inv(information), atol=1e-9)
    np.testing.assert_allclose(found.mean, np.linalg.solve(information, gradient), atol=1e-6)
    np.testing.assert_allclose(prior.given(seen[:1]).given(seen[1:]).mean, found.mean, atol=1e-9)


def test_unknown_sex_is_refused() -> None:
    with pytest.raises(InputError, match="sex 'm'"):
        load_body_prior().of("m")
