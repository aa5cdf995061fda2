from dataclasses import replace

import numpy as np
import pytest

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.mannequin import Side, mannequin
from vip_factors.body.skeleton import JOINT_COUNT, PARENTS


def test_segments_reach_every_joint_and_mirror() -> None:
    skeleton = skeleton_from_stature(1.8)
    segments = mannequin(skeleton)
    ends = {(s.bone, tuple(np.round(s.p_bone_end, 6))) for s in segments}
    for joint in range(1, JOINT_COUNT):
        assert (PARENTS[joint], tuple(np.round(skeleton.p_parent_joint[joint], 6))) in ends
    left = [s for s in segments if s.side is Side.LEFT]
    right = [s for s in segments if s.side is Side.RIGHT]
    assert len(left) == len(right) > 5
    for one, other in zip(left, right, strict=True):
        np.testing.assert_allclose(one.p_bone_end * [-1, 1, 1], other.p_bone_end, atol=1e-12)


def test_the_crown_is_as_high_as_the_person() -> None:
    skeleton = skeleton_from_stature(1.8)
    head = next(s for s in mannequin(skeleton) if s.part == "head" and s.p_bone_start.any())
    top = skeleton.p_pelvis_joint[head.bone, 1] + head.p_bone_end[1] + head.radius_end
    heel = skeleton.landmarks["left_heel"]
    sole = skeleton.p_pelvis_joint[heel.bone, 1] + heel.p_bone_point[1]
    assert top - sole == pytest.approx(skeleton.stature, abs=1e-9)


def test_a_skeleton_without_landmarks_is_drawn_without_their_segments() -> None:
    skeleton = replace(skeleton_from_stature(1.8), landmarks={})
    assert 0 < len(mannequin(skeleton)) < len(mannequin(skeleton_from_stature(1.8)))
