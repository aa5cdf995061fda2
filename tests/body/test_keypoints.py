"""Keypoint tables: every order is whole, sided names have twins, and the points lie where people would point."""

import numpy as np
import pytest

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.keypoints import (
    KEYPOINT_SETS,
    SHAPE,
    KeypointOffsets,
    KeypointSet,
    OffsetTraining,
    keypoint_set,
    pooled_offsets,
)
from vip_factors.body.skeleton import joint_index
from vip_factors.errors import InputError


@pytest.mark.parametrize("keypoints", KEYPOINT_SETS.values(), ids=lambda one: one.name)
def test_every_order_has_its_number_of_keypoints(keypoints: KeypointSet) -> None:
    digits = int("".join(filter(str.isdigit, keypoints.name.removesuffix("b"))))
    assert len(keypoints) == digits
    assert len(set(keypoints.keypoints)) == digits
    mirrored = keypoints.mirrored
    np.testing.assert_array_equal(mirrored[mirrored], np.arange(digits))


def test_keypoints_lie_where_people_point() -> None:
    skeleton = skeleton_from_stature(1.75)
    body25 = keypoint_set("body25")
    at = {
        name: skeleton.p_pelvis_joint[place.bone] + place.p_bone_point
        for name, place in zip(body25.keypoints, body25.on_body(skeleton), strict=True)
        if place is not None
    }
    assert len(at) == 25
    floor = skeleton.p_pelvis_joint[joint_index("left_foot"), 1]
    assert at["left_eye"][1] - floor == pytest.approx(0.93 * 1.75, abs=0.03)
    assert at["nose"][2] > at["left_ear"][2] + 0.08
    assert at["left_shoulder"][0] == pytest.approx(-at["right_shoulder"][0])
    assert at["left_hip"][0] > skeleton.p_pelvis_joint[joint_index("left_hip"), 0]
    assert at["left_heel"][2] < at["left_ankle"][2] < at["left_big_toe"][2]


def test_an_unknown_set_is_refused() -> None:
    with pytest.raises(InputError, match="coco17"):
        keypoint_set("coco")


def test_a_keypoint_whose_twin_is_not_in_the_set_is_its_own() -> None:
    np.testing.assert_array_equal(
        KeypointSet("few", ("left_eye", "nose", "right_hip", "left_hip")).mirrored, [0, 1, 3, 2]
    )


def test_families_of_detectors_have_their_own_definitions() -> None:
    skeleton = skeleton_from_stature(1.75)

    def place(name: str, keypoint: str) -> np.ndarray:
        one = keypoint_set(name)
        found = one.on_body(skeleton)[one.keypoints.index(keypoint)]
        assert found is not None
        return found.p_bone_point

    shoulders = place("body25", "neck")
    assert place("body25b", "neck")[1] - shoulders[1] == pytest.approx(0.065, abs=0.005)  # the upper neck
    heel = place("body25", "left_heel") - skeleton.landmarks["left_heel"].p_bone_point
    assert np.all(heel[1:] > 0.02)  # up and forward
    np.testing.assert_allclose(place("body25", "right_heel"), place("body25", "left_heel") * [-1, 1, 1], atol=1e-9)
    assert place("openpose18", "left_hip")[2] > place("blazepose33", "left_hip")[2] > 0


USUAL = np.full(SHAPE, 0.010)
HABIT = 0.012 * np.random.default_rng(1).standard_normal(SHAPE)


def people(count: int, spread: float, noise: float, seed: int = 2) -> list[KeypointOffsets]:
    random = np.random.default_rng(seed)
    scattered = HABIT + np.hypot(spread, noise) * random.standard_normal((count, *SHAPE))
    return [KeypointOffsets(one, np.full(SHAPE, noise)) for one in scattered]


def test_nobody_teaches_nothing() -> None:
    pooled = pooled_offsets([], USUAL)
    assert pooled.people == 0
    np.testing.assert_array_equal(pooled.offsets.mean, 0.0)
    np.testing.assert_array_equal(pooled.offsets.sigma, USUAL)


def test_many_people_teach_habit_and_spread() -> None:
    pooled = pooled_offsets(people(400, 0.005, 0.003), USUAL).offsets
    np.testing.assert_allclose(pooled.mean, HABIT, atol=0.0015)
    np.testing.assert_allclose(pooled.sigma, 0.005, rtol=0.2)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_few_people_are_believed_little(count: int) -> None:
    few = pooled_offsets(people(count, 0.0, 0.001), USUAL).offsets
    assert np.all(few.sigma < USUAL)
    assert np.all(few.sigma > 0.004)  # how people scatter, so few do not tell
    assert np.abs(few.mean).mean() < np.abs(HABIT).mean()


def test_offsets_to_expect_are_as_sure_as_they_say() -> None:
    """Over many detectors with a habit and a spread as usual: the next person is where the sigmas expect them."""
    random, missed = np.random.default_rng(5), []
    for _ in range(200):
        habit = np.sqrt(0.5) * USUAL * random.standard_normal(SHAPE)
        each = habit + np.sqrt(0.5) * USUAL * random.standard_normal((4, *SHAPE))
        noise = np.full(SHAPE, 0.004)
        found = [KeypointOffsets(one + noise * random.standard_normal(SHAPE), noise) for one in each[:3]]
        pooled = pooled_offsets(found, USUAL).offsets
        missed.append(((each[3] - pooled.mean) / pooled.sigma) ** 2)
    assert 0.85 < np.mean(missed) < 1.15


def test_noisy_ones_count_less() -> None:
    sure = KeypointOffsets(np.full(SHAPE, 0.01), np.full(SHAPE, 0.001))
    vague = KeypointOffsets(np.full(SHAPE, -0.05), np.full(SHAPE, 0.1))
    alone, both = pooled_offsets([sure], USUAL).offsets, pooled_offsets([sure, vague], USUAL).offsets
    np.testing.assert_allclose(both.mean, alone.mean, atol=1e-3)


def test_a_spread_is_never_nothing() -> None:
    settings = OffsetTraining(prior_people=0.1)
    same = [KeypointOffsets(HABIT, np.full(SHAPE, 1e-4))] * 50
    assert pooled_offsets(same, USUAL, settings).offsets.sigma.min() >= settings.least_sigma_m


@pytest.mark.parametrize("sigma", [0.0, -1.0, np.nan])
def test_a_sigma_that_is_none_is_refused(sigma: float) -> None:
    with pytest.raises(InputError, match="sigmas above zero"):
        KeypointOffsets(np.zeros(SHAPE), np.full(SHAPE, sigma))
