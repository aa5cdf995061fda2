import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.joint_priors import POSE_SIZE, joint_vector, load_pose_prior, mirror_joint_vector
from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import joint_index
from vip_factors.geometry.rotations import exp


def motion_of(x: np.ndarray, name: str = "1_1", rate: float = 4.0) -> Motion:
    R = np.broadcast_to(np.eye(3), (len(x), 24, 3, 3)).copy()
    R[:, 1:] = exp(x.reshape(len(x), 23, 3))
    return Motion(skeleton_from_stature(1.7), R, np.zeros((len(x), 3)), rate, name=name)


@given(seed=st.integers(0, 10_000))
def test_joint_vector_and_mirror_invert_themselves(seed: int) -> None:
    x = np.random.default_rng(seed).normal(0, 0.5, (4, POSE_SIZE))
    np.testing.assert_allclose(joint_vector(motion_of(x).R_parent_child), x, atol=1e-9)
    np.testing.assert_allclose(mirror_joint_vector(mirror_joint_vector(x)), x)


def test_a_mirrored_pose_has_mirrored_joint_positions() -> None:
    x = np.random.default_rng(0).normal(0, 0.5, (1, POSE_SIZE))
    p = motion_of(x).state.p_world_joint[0]
    q = motion_of(mirror_joint_vector(x)).state.p_world_joint[0]
    for left, right in (("left_wrist", "right_wrist"), ("left_foot", "right_foot"), ("head", "head")):
        np.testing.assert_allclose(q[joint_index(left)], p[joint_index(right)] * [-1, 1, 1], atol=1e-12)


def test_the_shipped_prior_is_symmetric_and_sane() -> None:
    prior = load_pose_prior()
    np.testing.assert_allclose(mirror_joint_vector(prior.mean), prior.mean, atol=1e-5)
    covariance = np.linalg.inv(prior.whitening.T @ prior.whitening)
    mirrored = mirror_joint_vector(mirror_joint_vector(covariance).T).T
    np.testing.assert_allclose(mirrored, covariance, atol=1e-5)
    deviations = np.degrees(np.sqrt(np.linalg.eigvalsh(covariance)))
    assert deviations.min() > 3  # no combination of joints is surer than a rest pose is
    assert deviations.max() < 60
    knee, elbow = (3 * (joint_index(f"left_{name}") - 1) for name in ("knee", "elbow"))
    assert 10 < np.degrees(prior.mean[knee]) < 60  # bent, the right way
    assert np.degrees(prior.mean[elbow + 1]) < -10
