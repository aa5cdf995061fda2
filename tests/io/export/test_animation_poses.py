"""Feet of animations stand still and on the floor, by the command line: where the true feet of the simulator stand."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import JOINT_COUNT, joint_index
from vip_factors.cli.main import main
from vip_factors.geometry.rotations import Array, exp
from vip_factors.io.export.animation_poses import _with_feet_moved
from vip_factors.io.mcap_estimate import read_estimate
from vip_factors.io.mcap_recording import read_scene
from vip_factors.io.motions.files import read_bvh
from vip_factors.simulate.gestures import gestures

FEET = [joint_index("left_foot"), joint_index("right_foot")]
KNEES = [joint_index("left_knee"), joint_index("right_knee")]
ANKLES = [joint_index("left_ankle"), joint_index("right_ankle")]
KNEES_AS_SOLVED_FRAME_BY_FRAME = [
    [[0.199859960755, 0.033864040647, 0.529617415112], [0.169105061455, -0.123112538674, 0.515969520004]],
    [[0.50394883175, -0.004574006228, 0.57143730009], [0.243483317639, -0.296110592322, 0.554892525211]],
    [[0.710237908357, 0.202590756118, 0.486695379409], [0.899721131554, 0.389333585005, 0.634886091347]],
]  # metres, of the frames 0, 7 and 20 below


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


def test_legs_follow_their_feet_in_every_frame() -> None:
    random = np.random.default_rng(7)
    motion = gestures(2.0, 10.0)
    turns = exp(0.2 * random.standard_normal((len(motion), JOINT_COUNT, 3)))
    motion = replace(motion, R_parent_child=motion.R_parent_child @ turns)
    shifts = 0.05 * random.standard_normal((2, len(motion), 3))
    moved = _with_feet_moved(motion, shifts).state.p_world_joint
    assert np.abs(moved[[0, 7, 20]][:, KNEES] - KNEES_AS_SOLVED_FRAME_BY_FRAME).max() < 1e-9
    knees_before = motion.state.p_world_joint[:, KNEES]
    off = np.linalg.norm(moved[:, ANKLES] - motion.state.p_world_joint[:, ANKLES] - np.moveaxis(shifts, 0, 1), axis=-1)
    assert np.median(off) < 1e-9  # those that do not reach as far end as near as they can
    assert np.abs(moved[:, KNEES] - knees_before).max() > 0.05
