"""Path metrics on motions whose errors are known."""

from dataclasses import replace

import numpy as np
import pytest

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import JOINT_COUNT
from vip_factors.evaluate import trajectory
from vip_factors.geometry.rotations import rotation_z
from vip_factors.simulate.gestures import gestures

RATE = 50.0


def sliding(path: np.ndarray, rate: float = RATE) -> Motion:
    """A stiff person on a path ``(T, 3)``."""
    R = np.broadcast_to(np.eye(3), (len(path), JOINT_COUNT, 3, 3))
    return Motion(skeleton_from_stature(1.75), R, path, rate)


@pytest.fixture(scope="module")
def walk() -> Motion:
    return gestures(5.0, rate=60.0)


def moved(motion: Motion, turn: np.ndarray, shift: np.ndarray) -> Motion:
    R = motion.R_parent_child.copy()
    R[:, 0] = turn @ R[:, 0]
    return replace(motion, R_parent_child=R, p_world_pelvis=motion.p_world_pelvis @ turn.T + shift)


def test_gauge_changes_cost_nothing(walk: Motion) -> None:
    elsewhere = moved(walk, rotation_z(1.1), np.array([3.0, -2.0, 0.5]))
    assert trajectory.root_translation_error(elsewhere, walk) == pytest.approx((0.0, 0.0), abs=1e-6)
    for metric in (trajectory.w_mpjpe, trajectory.wa_mpjpe, trajectory.yaw_aligned_position_error):
        assert metric(elsewhere, walk) == pytest.approx(0.0, abs=1e-6)


def test_tilt_is_no_gauge(walk: Motion) -> None:
    tilted = moved(
        walk, np.array([[1, 0, 0], [0, np.cos(0.1), -np.sin(0.1)], [0, np.sin(0.1), np.cos(0.1)]]), np.zeros(3)
    )
    assert trajectory.yaw_aligned_position_error(tilted, walk) > 1.0
    assert trajectory.wa_mpjpe(tilted, walk) == pytest.approx(0.0, abs=1e-6)


def test_root_translation_error_by_hand() -> None:
    """A straight path of 2 m against one 10 % longer: after centring, the error grows from the middle to 10 cm."""
    s = np.linspace(-1, 1, 201)[:, None] * np.array([1.0, 0.0, 0.0])
    cm, percent = trajectory.root_translation_error(sliding(1.1 * s), sliding(s))
    assert cm == pytest.approx(5.0, rel=0.01)
    assert percent == pytest.approx(2.5, rel=0.01)


def test_root_on_the_spot_has_no_percentage() -> None:
    assert np.isnan(trajectory.root_translation_error(sliding(np.zeros((10, 3))), sliding(np.zeros((10, 3))))[1])


def test_drift_hurts_the_first_frames_alignment_more(walk: Motion) -> None:
    drift = np.linspace(0, 0.5, len(walk))[:, None] * np.array([1.0, 0.0, 0.0])
    drifting = replace(walk, p_world_pelvis=walk.p_world_pelvis + drift)
    assert trajectory.w_mpjpe(drifting, walk) > 1.5 * trajectory.wa_mpjpe(drifting, walk) > 0


def test_chunks_are_aligned_one_by_one(walk: Motion) -> None:
    """A jump exactly between two chunks of 100 frames is invisible; in the middle of one it is not."""
    for frame, seen in ((100, False), (150, True)):
        path = walk.p_world_pelvis.copy()
        path[frame:] += [0.5, 0.0, 0.0]
        assert (trajectory.wa_mpjpe(replace(walk, p_world_pelvis=path), walk) > 1.0) is seen


def test_jitter_of_a_cubic_is_its_third_derivative() -> None:
    t = np.arange(40) / RATE
    path = np.stack([2.0 * t**3, -(t**2), t], axis=1)
    assert trajectory.jitter(sliding(path)) == pytest.approx(12.0, rel=1e-6)
    assert np.isnan(trajectory.jitter(sliding(path[:3])))


def test_foot_sliding_counts_only_while_the_true_foot_stands() -> None:
    still, step = np.zeros((10, 3)), np.array([[0.02, 0.0, 0.0]])
    truth = sliding(np.concatenate([still, np.cumsum(np.repeat(step, 10, axis=0), axis=0)]))
    estimate = sliding(np.arange(20)[:, None] * np.array([[0.003, 0.0, 0.0]]))
    assert trajectory.foot_sliding(truth, truth) == pytest.approx(0.0, abs=1e-9)
    assert trajectory.foot_sliding(estimate, truth) == pytest.approx(3.0)
    always = sliding(np.cumsum(np.repeat(step, 20, axis=0), axis=0))
    assert np.isnan(trajectory.foot_sliding(estimate, always))
