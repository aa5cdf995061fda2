"""Clips placed and lengthened, calibration poses before a motion, and the synthetic walk."""

import numpy as np
import pytest

from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import calibration_pose, joint_index
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import angle_between, log, rotation_x, rotation_z, transpose
from vip_factors.simulate.dense import dense_motion
from vip_factors.simulate.gestures import gestures
from vip_factors.simulate.staging import floor_height, lasting, with_initial_pose


@pytest.fixture(scope="module")
def clip() -> Motion:
    return gestures(3.0, rate=60.0)


def test_repeated_clip_has_its_length_and_no_jumps(clip: Motion) -> None:
    long = lasting(clip, 20.0)
    assert len(long) == 1201
    assert np.array_equal(long.p_world_pelvis[:100], clip.p_world_pelvis[:100])
    step = np.linalg.norm(np.diff(long.p_world_pelvis, axis=0), axis=1)
    assert step.max() * 60 < 2.5  # m/s
    turn = angle_between(long.R_parent_child[:-1], long.R_parent_child[1:])
    assert np.rad2deg(turn.max()) * 60 < 600


def test_repeated_clip_stays_on_the_floor_and_near_home(clip: Motion) -> None:
    long = lasting(clip, 40.0)
    assert np.abs(floor_height(clip.skeleton, long.state)).max() < 0.03
    home = clip.p_world_pelvis[:, :2].mean(axis=0)
    assert np.linalg.norm(long.p_world_pelvis[:, :2] - home, axis=1).max() < 4.0


@pytest.fixture(scope="module")
def motion() -> Motion:
    walk = gestures(5.0)
    R = walk.R_parent_child.copy()
    R[:, 0] = rotation_z(2.0) @ R[:, 0]
    return Motion(walk.skeleton, R, walk.p_world_pelvis @ rotation_z(2.0).T + [1.0, 2.0, 0.0], walk.rate)


@pytest.mark.parametrize("pose", ["n-pose", "t-pose"])
def test_pose_is_held_where_the_motion_begins(motion: Motion, pose: str) -> None:
    posed = with_initial_pose(motion, pose, hold_s=2.0, blend_s=1.0)
    held = round(2.0 * motion.rate)
    assert len(posed) == len(motion) + held
    assert posed.R_parent_child[0, 1:] == pytest.approx(calibration_pose(pose)[1:], abs=1e-9)
    assert posed.R_parent_child[: held + 1] == pytest.approx(
        np.broadcast_to(posed.R_parent_child[0], (held + 1, 24, 3, 3))
    )
    assert posed.p_world_pelvis[0, :2] == pytest.approx(motion.p_world_pelvis[0, :2])
    facing, first = posed.R_parent_child[0, 0, :, 2], motion.R_parent_child[0, 0, :, 2]
    assert np.arctan2(facing[1], facing[0]) == pytest.approx(np.arctan2(first[1], first[0]))
    assert np.abs(floor_height(posed.skeleton, posed.state)[0]) < 0.02


def test_the_blend_has_no_jolt(motion: Motion) -> None:
    posed = with_initial_pose(motion, hold_s=2.0, blend_s=1.0)
    time = np.linspace(1.5, 3.5, 800)
    acceleration = dense_motion(posed).bone(joint_index("left_wrist"), time).acceleration
    assert np.linalg.norm(acceleration, axis=1).max() < 25.0  # raising arms within a second; a jolt gives hundreds


def test_feet_stay_on_the_floor_through_the_blend() -> None:
    """Even from a squat, where slerped legs would push the feet through the floor."""
    walk = gestures(3.0)
    R = walk.R_parent_child.copy()
    for side in ("left", "right"):
        R[:, joint_index(f"{side}_hip")] = rotation_x(-1.6)
        R[:, joint_index(f"{side}_knee")] = rotation_x(2.0)
    p = walk.p_world_pelvis.copy()
    p[:, 2] -= floor_height(walk.skeleton, Motion(walk.skeleton, R, p, walk.rate).state)
    posed = with_initial_pose(Motion(walk.skeleton, R, p, walk.rate), hold_s=1.0, blend_s=1.0)
    assert np.abs(floor_height(posed.skeleton, posed.state)).max() < 0.01


def test_an_imperfect_wearer_differs_by_the_sigma_asked_for(motion: Motion) -> None:
    turns = [
        log(
            transpose(with_initial_pose(motion).R_parent_child[0])
            @ with_initial_pose(motion, pose_error_deg=5.0, seed=s).R_parent_child[0]
        )
        for s in range(8)
    ]
    assert np.rad2deg(np.std(turns)) == pytest.approx(5.0, rel=0.15)


def test_unknown_poses_and_short_motions_are_refused(motion: Motion) -> None:
    with pytest.raises(InputError, match="t-pose or n-pose"):
        with_initial_pose(motion, "a-pose")
    with pytest.raises(InputError, match="shorten the blend"):
        with_initial_pose(motion.frames(slice(0, 50)), blend_s=1.0)


@pytest.mark.parametrize("straight", [False, True])
def test_gestures_look_human(straight: bool) -> None:
    walk = gestures(20.0, straight=straight)
    state = walk.state
    assert np.abs(floor_height(walk.skeleton, state)).max() < 1e-9
    feet = state.p_world_joint[:, [joint_index("left_foot"), joint_index("right_foot")], 2]
    assert feet.min() > -0.01
    assert feet.max() < 0.25
    for side in ("left", "right"):
        knee = np.rad2deg(log(walk.R_parent_child[:, joint_index(f"{side}_knee")]))
        assert knee[:, 0].min() > 0
        assert knee[:, 0].max() < 90
        elbow = walk.R_parent_child[:, joint_index(f"{side}_elbow")]
        assert np.rad2deg(angle_between(elbow, np.eye(3))).max() < 120
    speed = np.linalg.norm(np.diff(walk.p_world_pelvis, axis=0), axis=1) * walk.rate
    assert 0.2 < speed.mean() < 1.0
    away = np.linalg.norm(walk.p_world_pelvis[:, :2], axis=1).max()
    assert (away > 10.0) if straight else (away < 4.0)  # stays near the origin
