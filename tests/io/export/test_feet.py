"""Feet of animations stand still and on the floor, by the command line: where the true feet of the simulator stand."""

from pathlib import Path

import numpy as np
import pytest

from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import joint_index
from vip_factors.cli.main import main
from vip_factors.geometry.rotations import Array
from vip_factors.io.mcap_estimate import read_estimate
from vip_factors.io.mcap_recording import read_scene
from vip_factors.io.motions.bvh import read_bvh

FEET = [joint_index("left_foot"), joint_index("right_foot")]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("feet")
    recording, estimate = folder / "walk.mcap", folder / "walk.estimate.mcap"
    for words in (
        ["simulate", "gestures", recording, "--seconds", "6", "--heading-offset-deg", "20"],
        ["smooth", recording, "--frame-rate", "30", "--solve.max-iterations", "4"],
        ["export", estimate, folder / "planted.bvh"],
        ["export", estimate, folder / "as-it-is.bvh", "--no-plant-feet"],
    ):
        assert main([str(word) for word in words]) == 0
    return folder


def sliding(motion: Motion, standing: Array) -> Array:
    """Speeds of balls in m/s while true ones stand."""
    balls = motion.state.p_world_joint[:, FEET]
    speed = np.linalg.norm(np.gradient(balls[..., :2], 1 / motion.rate, axis=0), axis=-1)
    return speed[standing]


def test_feet_that_stand_do_not_slide(folder: Path) -> None:
    estimate = read_estimate(folder / "walk.estimate.mcap").wearers[0].motion
    truth = read_scene(folder / "walk.mcap").wearers[0].truth.motion
    frames = np.round(estimate.time * truth.rate).astype(int).clip(0, len(truth) - 1)
    balls = truth.state.p_world_joint[:, FEET]
    true_speed = np.linalg.norm(np.gradient(balls, 1 / truth.rate, axis=0), axis=-1)[frames]
    standing = true_speed < 0.02
    for shift in (-2, -1, 1, 2):  # well within a stance
        standing &= np.roll(true_speed, shift, axis=0) < 0.02
    assert standing.sum() > 50
    planted, as_it_is = (read_bvh(folder / f"{name}.bvh") for name in ("planted", "as-it-is"))
    before, after = sliding(as_it_is, standing), sliding(planted, standing)
    assert np.percentile(before, 90) > 0.01
    assert np.percentile(after, 90) < 0.2 * np.percentile(before, 90)
    heights = planted.state.p_world_joint[:, FEET, 2][standing]
    assert np.percentile(heights, 95) - np.percentile(heights, 5) < 0.004
    assert np.abs(as_it_is.state.p_world_joint - estimate.state.p_world_joint).max() < 1e-4
    off = np.linalg.norm(planted.state.p_world_joint - estimate.state.p_world_joint, axis=-1)
    assert np.median(off) < 0.05
    swing = np.linalg.norm(np.diff(planted.state.p_world_joint, axis=0), axis=-1).max()
    assert swing < 1.2 * np.linalg.norm(np.diff(estimate.state.p_world_joint, axis=0), axis=-1).max()  # nothing leaps
