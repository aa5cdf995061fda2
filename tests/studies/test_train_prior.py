"""The prior over poses, learnt from motions."""

from pathlib import Path

import numpy as np
import pytest

from tests.studies.pose_prior_training import (
    HELD_OUT_CLIPS,
    PriorTraining,
    held_out_names,
    save_pose_prior,
    train_pose_prior,
)
from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.joint_priors import POSE_SIZE, PosePrior, load_pose_prior
from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import joint_index
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import exp


def motion_of(x: np.ndarray, name: str = "1_1", rate: float = 4.0) -> Motion:
    R = np.broadcast_to(np.eye(3), (len(x), 24, 3, 3)).copy()
    R[:, 1:] = exp(x.reshape(len(x), 23, 3))
    return Motion(skeleton_from_stature(1.7), R, np.zeros((len(x), 3)), rate, name=name)


def test_training_recovers_a_gaussian_beyond_the_floor() -> None:
    rng = np.random.default_rng(1)
    x = np.zeros((6000, POSE_SIZE))
    knees = [3 * (joint_index(f"{side}_knee") - 1) for side in ("left", "right")]
    x[:, knees] = rng.multivariate_normal([0.6, 0.6], [[0.09, 0.04], [0.04, 0.09]], 6000).clip(-0.1, 2.0)
    settings = PriorTraining(minimum_sigma_deg=3.0, shrinkage=0.0, longest_clip=1e9)
    prior = train_pose_prior([motion_of(x)], settings)
    covariance = np.linalg.inv(prior.whitening.T @ prior.whitening)
    assert prior.mean[knees] == pytest.approx([0.6, 0.6], abs=0.02)
    assert covariance[knees[0], knees[1]] == pytest.approx(0.04, rel=0.1)
    assert np.sqrt(covariance[knees[0], knees[0]]) == pytest.approx(0.3, rel=0.05)
    head = joint_index("head") * 3 - 3
    assert np.degrees(np.sqrt(covariance[head, head])) == pytest.approx(3.0, rel=1e-6)


def test_a_subject_of_many_clips_weighs_no_more_than_one_of_few() -> None:
    bent, straight = np.zeros((200, POSE_SIZE)), np.zeros((200, POSE_SIZE))
    knee = 3 * (joint_index("left_knee") - 1)
    bent[:, [knee, 3 * (joint_index("right_knee") - 1)]] = 1.0
    many = [motion_of(straight, f"walker_{clip}") for clip in range(9)]
    prior = train_pose_prior([*many, motion_of(bent, "sitter_1")])
    assert prior.mean[knee] == pytest.approx(0.5, abs=1e-6)


def test_broken_frames_are_dropped_and_too_few_are_refused() -> None:
    x = np.zeros((200, POSE_SIZE))
    x[::2, 3 * (joint_index("left_knee") - 1)] = -2.5  # a knee bent backwards
    assert np.abs(train_pose_prior([motion_of(x)]).mean).max() < 1e-9
    with pytest.raises(InputError, match="expected at least 69"):
        train_pose_prior([motion_of(x[:10])])


def test_saved_priors_come_back(tmp_path: Path) -> None:
    prior = PosePrior(np.arange(POSE_SIZE) * 0.01, np.eye(POSE_SIZE) * 7.0, "by hand")
    save_pose_prior(prior, tmp_path / "prior.npz")
    back = load_pose_prior(tmp_path / "prior.npz")
    np.testing.assert_allclose(back.mean, prior.mean, atol=1e-6)
    assert back.provenance == "by hand"


def test_clips_are_held_out_of_every_kind() -> None:
    assert all(len(clips) >= 2 for clips in HELD_OUT_CLIPS.values())
    assert len(set(held_out_names())) == len(held_out_names())
    provenance = load_pose_prior().provenance
    assert all(clip in provenance for clips in HELD_OUT_CLIPS.values() for clip in clips)
