"""Poses move as GTSAM's ``Pose3`` does."""

import gtsam
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vip_factors.geometry.poses import (
    Alignment,
    align_rigid,
    align_similarity,
    align_yaw,
    pose_right_jacobian,
    retract_pose,
)
from vip_factors.geometry.rotations import angle_between, exp, rotation_z


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, 9.9e-3, 1.1e-2, 0.4, 3.0])
@given(st.integers(0, 2**32 - 1))
def test_jacobians_and_steps_are_those_of_gtsam(angle: float, seed: int) -> None:
    random = np.random.default_rng(seed)
    step = random.standard_normal(6)
    step[:3] *= angle / np.linalg.norm(step[:3])
    np.testing.assert_allclose(pose_right_jacobian(step), gtsam.Pose3.ExpmapDerivative(step), atol=1e-10)
    R, p = exp(random.standard_normal(3)), random.standard_normal(3)
    moved = gtsam.Pose3(gtsam.Rot3(R), p).retract(step)
    ours_R, ours_p = retract_pose(R[None], p[None], step[None])
    np.testing.assert_allclose(ours_R[0], moved.rotation().matrix(), atol=1e-12)
    np.testing.assert_allclose(ours_p[0], moved.translation(), atol=1e-12)


seeds = st.integers(0, 2**31)


def cloud(seed: int) -> tuple[np.random.Generator, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng, rng.normal(size=(12, 3))


def residual(alignment: Alignment, source: np.ndarray, target: np.ndarray) -> float:
    return float(np.sum((alignment.apply(source) - target) ** 2))


@given(seeds)
def test_rigid_recovers_rotation_and_translation(seed: int) -> None:
    rng, source = cloud(seed)
    R, p = exp(rng.normal(size=3)), rng.normal(size=3)
    found = align_rigid(source, source @ R.T + p)
    assert angle_between(found.R_target_source, R) < 1e-7
    np.testing.assert_allclose(found.p_target_source, p, atol=1e-9)
    np.testing.assert_allclose(found.scale, 1.0)


@given(seeds, st.floats(0.1, 10))
def test_similarity_recovers_scale_too(seed: int, scale: float) -> None:
    rng, source = cloud(seed)
    R, p = exp(rng.normal(size=3)), rng.normal(size=3)
    target = scale * source @ R.T + p
    found = align_similarity(source, target)
    np.testing.assert_allclose(found.scale, scale, rtol=1e-9)
    np.testing.assert_allclose(found.apply(source), target, atol=1e-8)


@given(seeds, st.floats(-3, 3))
def test_yaw_recovers_heading_and_leaves_tilt_alone(seed: int, heading: float) -> None:
    rng, source = cloud(seed)
    p = rng.normal(size=3)
    found = align_yaw(source, source @ rotation_z(heading).T + p)
    assert angle_between(found.R_target_source, rotation_z(heading)) < 1e-7
    np.testing.assert_allclose(found.p_target_source, p, atol=1e-9)
    tilted = align_yaw(source, source @ exp(rng.normal(size=3)).T)
    np.testing.assert_allclose(tilted.R_target_source[2], [0, 0, 1], atol=1e-12)


@settings(max_examples=30)
@given(seeds)
def test_more_freedom_never_fits_worse_and_neighbours_never_better(seed: int) -> None:
    rng, source = cloud(seed)
    target = source @ exp(rng.normal(size=3)).T * 1.3 + 0.3 * rng.normal(size=source.shape)
    yaw, rigid, similar = (align(source, target) for align in (align_yaw, align_rigid, align_similarity))
    errors = [residual(alignment, source, target) for alignment in (yaw, rigid, similar)]
    assert errors[2] <= errors[1] + 1e-9
    assert errors[1] <= errors[0] + 1e-9
    for _ in range(20):
        R = rigid.R_target_source @ exp(0.1 * rng.normal(size=3))
        near = Alignment(R, rigid.p_target_source + 0.1 * rng.normal(size=3), np.ones(()))
        assert residual(near, source, target) >= errors[1] - 1e-9


@given(seeds)
def test_moving_both_sides_alike_changes_no_residual(seed: int) -> None:
    rng, source = cloud(seed)
    target = source + 0.2 * rng.normal(size=source.shape)
    R, p = exp(rng.normal(size=3)), rng.normal(size=3)
    for align in (align_rigid, align_similarity):
        before = residual(align(source, target), source, target)
        moved, moved_target = source @ R.T + p, target @ R.T + p
        assert np.isclose(before, residual(align(moved, moved_target), moved, moved_target), rtol=1e-6, atol=1e-9)


def test_mirrored_and_flat_clouds_still_give_rotations() -> None:
    _, source = cloud(1)
    for points in (source, source * [1, 1, 0]):
        found = align_rigid(points, points * [-1, 1, 1])
        assert np.isclose(np.linalg.det(found.R_target_source), 1.0)


def test_stacks_align_each_frame_by_itself() -> None:
    rng = np.random.default_rng(3)
    source, target = rng.normal(size=(5, 9, 3)), rng.normal(size=(5, 9, 3))
    for align in (align_yaw, align_rigid, align_similarity):
        moved = align(source, target).apply(source)
        np.testing.assert_allclose(moved[2], align(source[2], target[2]).apply(source[2]), atol=1e-12)
