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
@pytest.mark.parametrize("bone", ["pelvis", "left_hand", "right_foot", "head"])
def test_point_jacobian_by_central_differences(bone: str, scale: float) -> None:
    (R, p), index, h = random_pose(1, scale), joint_index(bone), 1e-6
    point = np.array([0.05, -0.1, 0.2])
    chain, jacobian = forward_kinematics(SKELETON, R, p).point_jacobian(index, point)
    for joint in range(JOINT_COUNT):
        for axis in range(3):
            delta = h * np.eye(3)[axis]
            ahead, behind = (perturbed(R, p, joint, sign * delta).point(index, point) for sign in (1, -1))
            numeric = (ahead - behind) / (2 * h)
            expected = jacobian[:, chain.index(joint), :, axis] if joint in chain else np.zeros((len(p), 3))
            np.testing.assert_allclose(expected, numeric, atol=1e-8, err_msg=JOINT_NAMES[joint])


@SCALES
@pytest.mark.parametrize("bone", ["pelvis", "left_hand", "right_foot"])
def test_orientation_jacobian_by_central_differences(bone: str, scale: float) -> None:
    (R, p), index, h = random_pose(2, scale), joint_index(bone), 1e-6
    chain, jacobian = forward_kinematics(SKELETON, R, p).orientation_jacobian(index)
    for column, joint in enumerate(chain):
        for axis in range(3):
            delta = h * np.eye(3)[axis]
            ahead, behind = (perturbed(R, p, joint, sign * delta).R_world_bone[:, index] for sign in (1, -1))
            numeric = log(ahead @ transpose(behind)) / (2 * h)  # a turn in the world, on the left
            np.testing.assert_allclose(jacobian[:, column, :, axis], numeric, atol=1e-8, err_msg=JOINT_NAMES[joint])


@SCALES
def test_twists_of_points_by_screws_of_joints_are_point_jacobians(scale: float) -> None:
    R, p = random_pose(3, scale)
    state, bones = forward_kinematics(SKELETON, R, p), np.array([joint_index("left_hand"), joint_index("right_knee")])
    places = np.array([[0.05, -0.1, 0.2], [0.0, -0.3, 0.1]])
    points = state.points(bones, places)
    found = np.einsum("tnak,tjkb->tnjab", state.point_twists(points), state.screws)
    for n, bone in enumerate(bones):
        np.testing.assert_allclose(points[:, n], state.point(bone, places[n]), atol=1e-12)
        chain, expected = state.point_jacobian(bone, places[n])
        np.testing.assert_allclose(found[:, n, chain], expected, atol=1e-12)
        np.testing.assert_allclose(found[:, n, -1], np.broadcast_to(np.eye(3), (len(p), 3, 3)), atol=1e-12)
        assert tuple(np.flatnonzero(MOVES[:-1, bone])) == tuple(sorted(chain))


def test_a_stretch_of_all_frames_is_the_body_itself() -> None:
    state = forward_kinematics(SKELETON, *random_pose(4, frames=5))
    assert state.at(slice(0, 5)) is state
    np.testing.assert_array_equal(state.at(slice(1, 3)).screws, state.screws[1:3])
