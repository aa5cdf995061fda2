"""The dense motion obeys rigid-body kinematics, checked by integrating back rather than by its own formulas."""

import numpy as np
import pytest

from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import joint_index
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import angle_between, exp, rotation_z
from vip_factors.simulate.dense import DenseMotion, dense_motion
from vip_factors.simulate.gestures import gestures

WRIST = joint_index("left_wrist")
P_BONE_POINT = np.array([0.05, 0.02, -0.03])


@pytest.fixture(scope="module")
def motion() -> Motion:
    return gestures(4.0, rate=100.0)


@pytest.fixture(scope="module")
def dense(motion: Motion) -> DenseMotion:
    return dense_motion(motion)


def integrate(values: np.ndarray, step: float) -> np.ndarray:
    """Simpson's rule, cumulative at every second sample."""
    parts = (values[:-2:2] + 4 * values[1:-1:2] + values[2::2]) * step / 3
    return np.concatenate([np.zeros((1, 3)), np.cumsum(parts, axis=0)])


def test_without_a_filter_it_passes_through_every_frame(motion: Motion, dense: DenseMotion) -> None:
    again = dense.sample(motion.rate)
    assert len(again) == len(motion)
    assert again.time == pytest.approx(motion.time)
    assert again.R_parent_child == pytest.approx(motion.R_parent_child, abs=1e-9)
    assert again.p_world_pelvis == pytest.approx(motion.p_world_pelvis, abs=1e-12)


def test_angular_rate_integrates_to_orientation(dense: DenseMotion) -> None:
    time, step = np.linspace(0.5, 1.5, 4001, retstep=True)
    middle = dense.bone(WRIST, time[:-1] + step / 2)
    R = dense.bone(WRIST, time[:1]).R_world_bone[0]
    for turn in exp(middle.rate * step):
        R = turn @ R
    assert angle_between(R, dense.bone(WRIST, time[-1:]).R_world_bone[0]) < 1e-6


def test_acceleration_integrates_to_velocity_and_velocity_to_position(dense: DenseMotion) -> None:
    time, step = np.linspace(1.0, 3.0, 8001, retstep=True)
    position, velocity, acceleration = dense.bone(WRIST, time).point(P_BONE_POINT)
    assert integrate(velocity, step) + position[0] == pytest.approx(position[::2], abs=1e-8)
    assert integrate(acceleration, step) + velocity[0] == pytest.approx(velocity[::2], abs=1e-6)


def test_a_point_sliding_on_the_bone_moves_as_kinematics_says(dense: DenseMotion) -> None:
    time, step = np.linspace(1.0, 3.0, 8001, retstep=True)
    swing = np.stack([np.sin(9 * time), np.cos(7 * time), np.sin(5 * time)], axis=1) * 0.02
    rate = np.stack([9 * np.cos(9 * time), -7 * np.sin(7 * time), 5 * np.cos(5 * time)], axis=1) * 0.02
    second = -swing * np.array([81.0, 49.0, 25.0])
    position, velocity, acceleration = dense.bone(WRIST, time).point(P_BONE_POINT + swing, rate, second)
    assert integrate(velocity, step) + position[0] == pytest.approx(position[::2], abs=1e-8)
    assert integrate(acceleration, step) + velocity[0] == pytest.approx(velocity[::2], abs=1e-6)


def test_half_turns_leave_no_jump() -> None:
    """Quaternions change sign on the way round; the filtered rotation must not notice."""
    still = gestures(4.0, rate=100.0)
    R = still.R_parent_child.copy()
    R[:, 0] = rotation_z(np.linspace(0, 4 * np.pi, len(R))) @ R[0, 0]
    turning = Motion(still.skeleton, R, still.p_world_pelvis, still.rate)
    time = np.linspace(0.5, 3.5, 600)
    rate = dense_motion(turning, lowpass_hz=10.0).bone(0, time).rate
    assert rate == pytest.approx(np.broadcast_to([0, 0, np.pi], rate.shape), abs=0.02)


def test_the_filter_removes_jitter_and_keeps_the_motion() -> None:
    motion = gestures(4.0, rate=120.0)
    noise = np.random.default_rng(0).standard_normal(motion.p_world_pelvis.shape) * 0.001
    shaken = Motion(motion.skeleton, motion.R_parent_child, motion.p_world_pelvis + noise, motion.rate)
    time = np.linspace(0.5, 3.5, 500)
    truth = dense_motion(motion).bone(0, time)
    error = [
        np.sqrt(np.mean((dense_motion(shaken, cutoff).bone(0, time).acceleration - truth.acceleration) ** 2))
        for cutoff in (None, 10.0)
    ]
    assert error[1] < 0.05 * error[0]
    assert dense_motion(shaken, 10.0).bone(0, time).position == pytest.approx(truth.position, abs=0.002)


def test_short_motions_are_refused(motion: Motion) -> None:
    with pytest.raises(InputError, match="at least 8"):
        dense_motion(motion.frames(slice(0, 5)))
