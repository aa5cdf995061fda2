"""The skeleton: topology, names, and what it refuses."""

from dataclasses import replace

import numpy as np
import pytest

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.mannequin import Side, mannequin, side_of
from vip_factors.body.skeleton import JOINT_COUNT, JOINT_NAMES, PARENTS, Landmark, Skeleton, ancestors, joint_index
from vip_factors.errors import InputError


def test_parents_come_before_their_children() -> None:
    assert PARENTS[0] == -1
    assert all(0 <= parent < child for child, parent in enumerate(PARENTS) if child)


def test_the_sides_mirror_each_other() -> None:
    mirrored = [name.replace("left_", "*").replace("right_", "left_").replace("*", "right_") for name in JOINT_NAMES]
    for joint, name in enumerate(mirrored):
        parent = PARENTS[joint]
        if parent >= 0:
            assert PARENTS[joint_index(name)] == joint_index(mirrored[parent])


def test_chains_run_from_the_root() -> None:
    assert [JOINT_NAMES[j] for j in ancestors(joint_index("left_wrist"))] == [
        "pelvis", "spine1", "spine2", "spine3", "left_collar", "left_shoulder", "left_elbow", "left_wrist"
    ]  # fmt: skip
    assert ancestors(0) == (0,)


def test_people_may_say_shank() -> None:
    assert joint_index("left_shank") == joint_index("left_knee")
    assert joint_index("sternum") == joint_index("spine3")
    with pytest.raises(InputError, match="unknown bone 'tail': expected one of pelvis"):
        joint_index("tail")


def test_rest_positions_add_up_along_chains() -> None:
    offsets = np.random.default_rng(0).normal(size=(24, 3))
    offsets[0] = 0
    skeleton = Skeleton(offsets)
    for joint in range(24):
        np.testing.assert_allclose(skeleton.p_pelvis_joint[joint], offsets[list(ancestors(joint))].sum(axis=0))
    assert np.isclose(skeleton.bone_length("left_knee"), np.linalg.norm(offsets[4]))


def test_stature_is_from_heel_to_head_top() -> None:
    offsets = np.zeros((24, 3))
    offsets[joint_index("head")] = [0, 0.7, 0]
    offsets[joint_index("left_ankle")] = [0, -0.8, 0]
    landmarks = {
        "head_top": Landmark(joint_index("head"), np.array([0, 0.15, 0])),
        "left_heel": Landmark(joint_index("left_ankle"), np.array([0, -0.05, -0.04])),
    }
    assert np.isclose(Skeleton(offsets, landmarks).stature, 1.7)


@pytest.mark.parametrize("offsets", [np.zeros((22, 3)), np.full((24, 3), np.nan)])
def test_offsets_that_are_none_are_refused(offsets: np.ndarray) -> None:
    with pytest.raises(InputError, match="expected 24 finite rows"):
        Skeleton(offsets)


def test_a_bone_that_nobody_has_is_refused() -> None:
    offsets = np.zeros((24, 3))
    offsets[joint_index("left_knee")] = [0, -420.0, 0]
    with pytest.raises(InputError, match=r"skeleton \(a clip\): left_knee is at .* expected metres, less than 10"):
        Skeleton(offsets, source="a clip")


def test_segments_reach_every_joint_and_mirror() -> None:
    skeleton = skeleton_from_stature(1.8)
    segments = mannequin(skeleton)
    ends = {(s.bone, tuple(np.round(s.p_bone_end, 6))) for s in segments}
    for joint in range(1, JOINT_COUNT):
        assert (PARENTS[joint], tuple(np.round(skeleton.p_parent_joint[joint], 6))) in ends
    left = [s for s in segments if side_of(s.bone) is Side.LEFT]
    right = [s for s in segments if side_of(s.bone) is Side.RIGHT]
    assert len(left) == len(right) > 5
    for one, other in zip(left, right, strict=True):
        np.testing.assert_allclose(one.p_bone_end * [-1, 1, 1], other.p_bone_end, atol=1e-12)


def test_the_crown_is_as_high_as_the_person() -> None:
    skeleton = skeleton_from_stature(1.8)
    head = next(s for s in mannequin(skeleton) if s.bone == joint_index("head") and s.p_bone_start.any())
    top = skeleton.p_pelvis_joint[head.bone, 1] + head.p_bone_end[1] + head.radius_end
    heel = skeleton.landmarks["left_heel"]
    sole = skeleton.p_pelvis_joint[heel.bone, 1] + heel.p_bone_point[1]
    assert top - sole == pytest.approx(skeleton.stature, abs=1e-9)


def test_a_skeleton_without_landmarks_is_drawn_without_their_segments() -> None:
    skeleton = replace(skeleton_from_stature(1.8), landmarks={})
    assert 0 < len(mannequin(skeleton)) < len(mannequin(skeleton_from_stature(1.8)))
