import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vip_factors.body.joint_priors import POSE_SIZE, load_joint_limits, load_pose_prior, mirror_joint_vector
from vip_factors.body.skeleton import joint_index


def pose(**degrees: tuple[float, float, float]) -> np.ndarray:
    x = np.zeros((23, 3))
    for name, angles in degrees.items():
        x[joint_index(name) - 1] = np.radians(angles)
    return x.ravel()


@given(seed=st.integers(0, 10_000))
def test_limits_are_alike_on_both_sides(seed: int) -> None:
    limits, x = load_joint_limits(), np.random.default_rng(seed).normal(0, 1.5, POSE_SIZE)
    mirrored = limits.violation(mirror_joint_vector(x))
    np.testing.assert_allclose(mirrored, mirror_joint_vector(limits.violation(x)), atol=1e-12)


@pytest.mark.parametrize(
    "x",
    [
        pose(),  # the T-pose
        pose(left_shoulder=(0, 0, -85), right_shoulder=(0, 0, 85)),  # arms hanging
        pose(left_shoulder=(0, 0, 85), right_shoulder=(0, 0, -85)),  # arms overhead
        pose(left_hip=(-95, 0, 0), right_hip=(-95, 0, 0), left_knee=(95, 0, 0), right_knee=(95, 0, 0)),  # sitting
        pose(left_elbow=(0, -140, 0), right_elbow=(0, 140, 0)),
        pose(spine1=(30, 0, 0), spine2=(25, 0, 0), spine3=(20, 0, 0)),  # bending forward
        load_pose_prior().mean,
    ],
)
def test_what_people_do_is_allowed(x: np.ndarray) -> None:
    assert np.all(load_joint_limits().violation(x) == 0)


@pytest.mark.parametrize(
    ("x", "name", "degrees"),
    [
        (pose(left_knee=(-40, 0, 0)), "left_knee", -35),  # bent backwards
        (pose(right_elbow=(0, -40, 0)), "right_elbow", -25),
        (pose(left_knee=(30, 0, 40)), "left_knee", 25),  # bent sideways
        (pose(right_hip=(60, 0, 0)), "right_hip", 25),
    ],
)
def test_what_hurts_is_refused_by_as_much(x: np.ndarray, name: str, degrees: float) -> None:
    violation = np.degrees(load_joint_limits().violation(x)).reshape(-1, 3)
    assert violation[joint_index(name) - 1].sum() == pytest.approx(degrees)
    assert np.count_nonzero(violation) == 1
