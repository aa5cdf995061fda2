"""Forward kinematics against plain 4x4 products, and its Jacobians against central differences."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.kinematics import MOVES, BodyState, forward_kinematics, local_rotations
from vip_factors.body.skeleton import JOINT_COUNT, JOINT_NAMES, PARENTS, joint_index
from vip_factors.geometry.rotations import exp, log, transpose

SKELETON = skeleton_from_stature(1.75)
SCALES = pytest.mark.parametrize("scale", [0.8, 1e-6], ids=["generic", "near rest"])
seeds = st.integers(0, 2**31)


def random_pose(seed: int, scale: float = 0.8, frames: int = 3) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return exp(scale * rng.normal(size=(frames, JOINT_COUNT, 3))), rng.normal(size=(frames, 3))


@settings(max_examples=20)
@given(seeds)
def test_composition_equals_products_of_transforms(seed: int) -> None:
    R, p = random_pose(seed)
    state = forward_kinematics(SKELETON, R, p)
    for frame in range(len(p)):
        T_world_bone = []
        for joint, parent in enumerate(PARENTS):
            T_parent_child = np.eye(4)
            T_parent_child[:3, :3] = R[frame, joint]
            T_parent_child[:3, 3] = p[frame] if parent < 0 else SKELETON.p_parent_joint[joint]
            T_world_bone.append(T_parent_child if parent < 0 else T_world_bone[parent] @ T_parent_child)
        expected = np.stack(T_world_bone)
        np.testing.assert_allclose(state.R_world_bone[frame], expected[:, :3, :3], atol=1e-12)
        np.testing.assert_allclose(state.p_world_joint[frame], expected[:, :3, 3], atol=1e-12)


def test_rest_is_the_t_pose() -> None:
    state = forward_kinematics(SKELETON, np.tile(np.eye(3), (1, JOINT_COUNT, 1, 1)), np.zeros((1, 3)))
    np.testing.assert_allclose(state.p_world_joint[0], SKELETON.p_pelvis_joint)


@given(seeds)
def test_local_rotations_undo_forward_kinematics(seed: int) -> None:
    R, p = random_pose(seed)
    found = local_rotations(forward_kinematics(SKELETON, R, p).R_world_bone)
    np.testing.assert_allclose(found, R, atol=1e-12)


def test_inputs_stay_as_they_were() -> None:
    R, p = random_pose(0)
    state = forward_kinematics(SKELETON, R, p)
    before = R.copy(), p.copy(), state.R_world_bone.copy()
    local_rotations(state.R_world_bone)
    for kept, now in zip(before, (R, p, state.R_world_bone), strict=True):
        np.testing.assert_array_equal(kept, now)


def perturbed(R: np.ndarray, p: np.ndarray, joint: int, delta: np.ndarray) -> BodyState:
    R = R.copy()
    R[:, joint] = R[:, joint] @ exp(delta)
    return forward_kinematics(SKELETON, R, p)


@SCALES
@pytest.mark.parametrize("bone", ["pelvis", "left_hand", "right_foot", "right_knee", "head"])
def test_twists_of_points_by_screws_of_joints_are_derivatives(bone: str, scale: float) -> None:
    (R, p), index, h = random_pose(1, scale), joint_index(bone), 1e-6
    state, point = forward_kinematics(SKELETON, R, p), np.array([0.05, -0.1, 0.2])
    points = state.points(np.array([index]), point[None])
    np.testing.assert_allclose(points[:, 0], state.point(index, point), atol=1e-12)
    found = np.einsum("tak,tjkb->tjab", state.point_twists(points)[:, 0], state.screws * MOVES[:, index, None, None])
    np.testing.assert_allclose(found[:, -1], np.broadcast_to(np.eye(3), (len(p), 3, 3)), atol=1e-12)
    for joint in range(JOINT_COUNT):
        for axis in range(3):
            delta = h * np.eye(3)[axis]
            ahead, behind = (perturbed(R, p, joint, sign * delta) for sign in (1, -1))
            numeric = (ahead.point(index, point) - behind.point(index, point)) / (2 * h)
            np.testing.assert_allclose(found[:, joint, :, axis], numeric, atol=1e-8, err_msg=JOINT_NAMES[joint])
            turn = log(ahead.R_world_bone[:, index] @ transpose(behind.R_world_bone[:, index])) / (2 * h)
            expected = MOVES[joint, index] * state.screws[:, joint, :3, axis]  # on the left, in the world
            np.testing.assert_allclose(expected, turn, atol=1e-8, err_msg=JOINT_NAMES[joint])


def test_a_stretch_of_all_frames_is_the_body_itself() -> None:
    state = forward_kinematics(SKELETON, *random_pose(4, frames=5))
    assert state.at(slice(0, 5)) is state
    np.testing.assert_array_equal(state.at(slice(1, 3)).screws, state.screws[1:3])
