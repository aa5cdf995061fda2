"""Pose metrics: zero for the truth, blind to what they should be blind to, right on cases done by hand."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import JOINT_COUNT, Skeleton, calibration_pose, joint_index
from vip_factors.errors import InputError
from vip_factors.evaluate import metrics
from vip_factors.geometry.rotations import exp, rotation_x, rotation_z
from vip_factors.simulate.gestures import gestures

SKELETON = skeleton_from_stature(1.75)
T = 6


def random_motion(seed: int, sigma: float = 0.4) -> Motion:
    random = np.random.default_rng(seed)
    return Motion(SKELETON, exp(sigma * random.standard_normal((T, 24, 3))), random.standard_normal((T, 3)), 60.0)


def bent_by(motion: Motion, joint: str, turn: np.ndarray) -> Motion:
    R = motion.R_parent_child.copy()
    R[:, joint_index(joint)] = R[:, joint_index(joint)] @ turn
    return replace(motion, R_parent_child=R)


def moved(motion: Motion, turn: np.ndarray, shift: np.ndarray) -> Motion:
    R = motion.R_parent_child.copy()
    R[:, 0] = turn @ R[:, 0]
    return replace(motion, R_parent_child=R, p_world_pelvis=motion.p_world_pelvis @ turn.T + shift)


def scaled(motion: Motion, factor: float) -> Motion:
    skeleton = Skeleton(factor * motion.skeleton.p_parent_joint)
    return replace(motion, skeleton=skeleton, p_world_pelvis=factor * motion.p_world_pelvis)


vectors = arrays(float, 3, elements=st.floats(-3, 3))
seeds = st.integers(0, 1000)


@pytest.mark.parametrize(
    "metric",
    [
        metrics.mpjpe, metrics.pa_mpjpe, metrics.mpjae, metrics.local_mpjae, metrics.root_relative_mpjpe,
        metrics.global_position_error, metrics.sip_error, metrics.mpjpe_offsets_removed,
    ],
)  # fmt: skip
def test_the_truth_has_no_error(metric) -> None:
    assert metric(random_motion(0), random_motion(0)) == pytest.approx(0.0, abs=1e-6)
    assert metric(random_motion(0), random_motion(1)) > 1.0


@given(seeds, vectors, vectors)
def test_aligned_errors_do_not_see_a_rigid_motion(seed: int, turn: np.ndarray, shift: np.ndarray) -> None:
    estimate, truth = random_motion(seed), random_motion(seed + 1)
    elsewhere = moved(estimate, exp(turn), shift)
    for metric in (metrics.mpjpe, metrics.pa_mpjpe, metrics.mpjae):
        assert metric(elsewhere, truth) == pytest.approx(metric(estimate, truth), abs=1e-6)


@given(seeds, st.floats(-3, 3), vectors)
def test_the_sip_error_does_not_see_one_yaw(seed: int, yaw: float, shift: np.ndarray) -> None:
    truth = random_motion(seed)
    assert metrics.sip_error(moved(truth, rotation_z(yaw), shift), truth) == pytest.approx(0.0, abs=1e-5)
    assert metrics.sip_error(bent_by(truth, "left_hip", rotation_x(0.4)), truth) > 0.1


def test_joints_that_are_defined_elsewhere_on_the_bone_are_no_error_without_offsets() -> None:
    """Hips 3 cm further out: an offset in the pelvis' axes that moves with it."""
    truth = gestures(4.0)
    offsets = truth.skeleton.p_parent_joint.copy()
    offsets[joint_index("left_hip"), 0] += 0.03
    offsets[joint_index("left_knee"), 0] -= 0.03
    estimate = replace(truth, skeleton=Skeleton(offsets))
    assert metrics.mpjpe(estimate, truth) > 2.0
    assert metrics.mpjpe_offsets_removed(estimate, truth) < 0.7 * metrics.mpjpe(estimate, truth)


@given(seeds, st.floats(0.5, 2.0))
def test_only_the_similarity_is_blind_to_scale(seed: int, factor: float) -> None:
    estimate, truth = random_motion(seed), random_motion(seed + 1)
    assert metrics.pa_mpjpe(scaled(estimate, factor), truth) == pytest.approx(metrics.pa_mpjpe(estimate, truth))
    assert metrics.pa_mpjpe(scaled(truth, factor), truth) == pytest.approx(0.0, abs=1e-6)
    if abs(factor - 1) > 0.01:
        assert metrics.mpjpe(scaled(truth, factor), truth) > 1.0


def test_a_turned_joint_by_hand() -> None:
    """The head's bone turned by 0.2 rad: no joint of the 14 lies beyond it, no bone of the 9 hangs from it."""
    truth = random_motion(5)
    estimate = bent_by(truth, "head", rotation_x(0.2))
    assert metrics.mpjpe(estimate, truth) == pytest.approx(0.0, abs=1e-9)
    assert metrics.mpjae(estimate, truth) == pytest.approx(0.0, abs=1e-5)
    # An elbow moves the wrist and the hand; joint rotations see one joint of nine, world orientations too.
    estimate = bent_by(truth, "left_elbow", rotation_x(0.2))
    assert metrics.local_mpjae(estimate, truth) == pytest.approx(np.rad2deg(0.2) / 9)
    # A hip takes hip and knee along in the world, and so counts twice there (but for the alignment) and once locally.
    estimate = bent_by(truth, "left_hip", rotation_x(0.01))
    assert metrics.local_mpjae(estimate, truth) == pytest.approx(np.rad2deg(0.01) / 9)
    world = metrics.orientation_error(estimate, truth)
    leg = [joint_index(f"left_{name}") for name in ("hip", "knee", "foot")]
    assert world[:, leg] == pytest.approx(0.01)
    assert world[:, joint_index("right_hip")] == pytest.approx(0.0, abs=1e-9)


def test_position_error_by_hand() -> None:
    """The right shank straightened by a right angle: ankle and foot move by √2 of their distance from the knee."""
    pose = np.broadcast_to(calibration_pose("t-pose"), (T, JOINT_COUNT, 3, 3))
    truth = Motion(SKELETON, pose, np.zeros((T, 3)), 60.0)
    error = metrics.position_error(bent_by(truth, "right_knee", rotation_x(np.pi / 2)), truth)
    shank = SKELETON.bone_length("right_ankle")
    assert error[:, joint_index("right_ankle")] == pytest.approx(np.sqrt(2) * shank)
    assert error[:, joint_index("right_knee")] == pytest.approx(0.0, abs=1e-12)


def test_different_frames_are_refused() -> None:
    truth = random_motion(1)
    with pytest.raises(InputError, match="same frames"):
        metrics.mpjpe(truth.frames(slice(0, 3)), truth)


RATE = 50.0


def sliding(path: np.ndarray, rate: float = RATE) -> Motion:
    """A stiff person on a path ``(T, 3)``."""
    R = np.broadcast_to(np.eye(3), (len(path), JOINT_COUNT, 3, 3))
    return Motion(skeleton_from_stature(1.75), R, path, rate)


@pytest.fixture(scope="module")
def walk() -> Motion:
    return gestures(5.0, rate=60.0)


def test_gauge_changes_cost_nothing(walk: Motion) -> None:
    elsewhere = moved(walk, rotation_z(1.1), np.array([3.0, -2.0, 0.5]))
    assert metrics.root_translation_error(elsewhere, walk) == pytest.approx((0.0, 0.0), abs=1e-6)
    for metric in (metrics.w_mpjpe, metrics.wa_mpjpe, metrics.yaw_aligned_position_error):
        assert metric(elsewhere, walk) == pytest.approx(0.0, abs=1e-6)


def test_tilt_is_no_gauge(walk: Motion) -> None:
    tilted = moved(walk, rotation_x(0.1), np.zeros(3))
    assert metrics.yaw_aligned_position_error(tilted, walk) > 1.0
    assert metrics.wa_mpjpe(tilted, walk) == pytest.approx(0.0, abs=1e-6)


def test_root_translation_error_by_hand() -> None:
    """A straight path of 2 m against one 10 % longer: after centring, the error grows from the middle to 10 cm."""
    s = np.linspace(-1, 1, 201)[:, None] * np.array([1.0, 0.0, 0.0])
    cm, percent = metrics.root_translation_error(sliding(1.1 * s), sliding(s))
    assert cm == pytest.approx(5.0, rel=0.01)
    assert percent == pytest.approx(2.5, rel=0.01)


def test_chunks_are_aligned_one_by_one(walk: Motion) -> None:
    """A jump exactly between two chunks of 100 frames is invisible; in the middle of one it is not."""
    for frame, seen in ((100, False), (150, True)):
        path = walk.p_world_pelvis.copy()
        path[frame:] += [0.5, 0.0, 0.0]
        assert (metrics.wa_mpjpe(replace(walk, p_world_pelvis=path), walk) > 1.0) is seen


def test_jitter_of_a_cubic_is_its_third_derivative() -> None:
    t = np.arange(40) / RATE
    path = np.stack([2.0 * t**3, -(t**2), t], axis=1)
    assert metrics.jitter(sliding(path)) == pytest.approx(12.0, rel=1e-6)
    assert np.isnan(metrics.jitter(sliding(path[:3])))


def test_foot_sliding_counts_only_while_the_true_foot_stands() -> None:
    still, step = np.zeros((10, 3)), np.array([[0.02, 0.0, 0.0]])
    truth = sliding(np.concatenate([still, np.cumsum(np.repeat(step, 10, axis=0), axis=0)]))
    estimate = sliding(np.arange(20)[:, None] * np.array([[0.003, 0.0, 0.0]]))
    assert metrics.foot_sliding(truth, truth) == pytest.approx(0.0, abs=1e-9)
    assert metrics.foot_sliding(estimate, truth) == pytest.approx(3.0)
    always = sliding(np.cumsum(np.repeat(step, 20, axis=0), axis=0))
    assert np.isnan(metrics.foot_sliding(estimate, always))


def test_chunks_are_aligned_on_their_first_two_frames() -> None:
    """A first frame alone would show the second one's step of a decimetre where there is none."""
    still = sliding(np.zeros((20, 3)))
    path = np.zeros((20, 3))
    path[0, 0] = 0.1
    assert metrics.w_mpjpe(sliding(path), still) == pytest.approx(50.0, rel=0.05)
