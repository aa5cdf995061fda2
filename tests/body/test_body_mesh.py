"""The skin: closed, of a person's volume, symmetric, and moved by its bones."""

from dataclasses import replace

import numpy as np
import pytest

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.body_mesh import BodyMesh, body_mesh, surface_net
from vip_factors.body.kinematics import forward_kinematics
from vip_factors.body.skeleton import Skeleton, joint_index
from vip_factors.geometry.rotations import exp

SKELETON = skeleton_from_stature(1.8)


@pytest.fixture(scope="module")
def mesh() -> BodyMesh:
    return body_mesh(SKELETON)


def volume(p: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = (p[faces[:, i]] for i in range(3))
    return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6)


def test_a_sphere_of_a_field_has_its_volume_and_is_closed() -> None:
    grid = np.stack(np.meshgrid(*[np.arange(24.0)] * 3, indexing="ij"), axis=-1) - 11.7
    p, faces = surface_net(8.0 - np.linalg.norm(grid, axis=-1))
    assert volume(p, faces) == pytest.approx(4 / 3 * np.pi * 8**3, rel=0.03)
    np.testing.assert_allclose(np.linalg.norm(p - 11.7, axis=1), 8, atol=0.2)
    assert_closed(faces)


def assert_closed(faces: np.ndarray) -> None:
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    there, back = (set(map(tuple, one.tolist())) for one in (edges, edges[:, ::-1]))
    assert there == back


def test_the_skin_is_closed_and_weighs_what_a_slim_adult_weighs(mesh: BodyMesh) -> None:
    assert_closed(mesh.faces)
    assert 0.060 < volume(mesh.p_bind, mesh.faces) < 0.085  # m³: a litre of body is about a kilogram
    a, b, c = (mesh.p_bind[mesh.faces[:, i]] for i in range(3))
    outwards = np.einsum("fi,fi->f", np.cross(b - a, c - a), mesh.normal[mesh.faces].mean(axis=1))
    assert np.mean(outwards > 0) > 0.99


def test_weights_are_shares_and_every_bone_has_skin(mesh: BodyMesh) -> None:
    np.testing.assert_allclose(mesh.weights.sum(axis=1), 1, atol=1e-12)
    assert mesh.weights.min() >= 0
    assert set(mesh.bone) == set(range(24))
    hands = mesh.p_bind[mesh.bone == joint_index("left_hand")]
    assert hands[:, 0].min() > SKELETON.p_pelvis_joint[joint_index("left_wrist"), 0]


def test_the_shares_of_graphics_cards_add_up(mesh: BodyMesh) -> None:
    """Or skin is torn far from the world's origin."""
    bones, shares = mesh.four_bones()
    assert (shares.sum(axis=1, dtype=int) == 255).all()
    assert (bones[shares == 0] == 0).all()
    rebuilt = np.zeros(mesh.weights.shape)
    np.add.at(rebuilt, (np.arange(len(bones))[:, None], bones), shares / 255)
    np.testing.assert_allclose(rebuilt, mesh.weights, atol=0.04)


def test_the_skin_moves_with_its_bones(mesh: BodyMesh) -> None:
    p, normal = mesh.posed(mesh.R_bind_bone, mesh.p_bind_bone)
    np.testing.assert_allclose(p, mesh.p_bind, atol=1e-9)
    np.testing.assert_allclose(normal, mesh.normal, atol=1e-9)
    R = np.tile(np.eye(3), (1, 24, 1, 1))
    R[0, 0], R[0, joint_index("left_elbow")] = exp([0.4, 1.0, -0.3]), exp([0.0, -1.2, 0.0])
    state = forward_kinematics(SKELETON, R, np.array([[1.0, 2.0, 3.0]]))
    p, _ = mesh.posed(state.R_world_bone[0], state.p_world_joint[0])
    wrist = joint_index("left_wrist")
    rigid = mesh.weights[:, wrist] > 0.999
    assert rigid.sum() > 20
    p_wrist = (mesh.p_bind[rigid] - mesh.p_bind_bone[wrist]) @ mesh.R_bind_bone[wrist]
    expected = p_wrist @ state.R_world_bone[0, wrist].T + state.p_world_joint[0, wrist]
    np.testing.assert_allclose(p[rigid], expected, atol=1e-3)


def test_head_and_soles_are_where_the_stature_says(mesh: BodyMesh) -> None:
    R = np.tile(np.eye(3), (1, 24, 1, 1))
    state = forward_kinematics(SKELETON, R, np.zeros((1, 3)))
    p, _ = mesh.posed(state.R_world_bone[0], state.p_world_joint[0])
    assert np.ptp(p[:, 1]) == pytest.approx(SKELETON.stature, abs=0.03)


def test_a_skeleton_without_height_has_a_small_skin() -> None:
    offsets = np.zeros((24, 3))
    offsets[1:, 0] = np.linspace(-1, 1, 23)
    assert len(body_mesh(Skeleton(offsets)).p_bind) < 200_000


def test_a_skeleton_without_landmarks_has_a_skin_too() -> None:
    bare = body_mesh(replace(SKELETON, landmarks={}))
    assert 0.04 < volume(bare.p_bind, bare.faces) < 0.085
