"""Keypoint tables: every order is whole, sided names have twins, and the points lie where people would point."""

import numpy as np
import pytest

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.keypoints import (
    KEYPOINT_SETS,
    KeypointSet,
    keypoint_set,
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
