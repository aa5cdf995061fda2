from pathlib import Path

import numpy as np
import pytest
from motion_samples import CGSPEED_NAMES, MVN_NAMES, random_pose, rest_skeleton, write_bvh

from vip_factors.body.skeleton import JOINT_NAMES, joint_index
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array, rotation_x, rotation_y, rotation_z
from vip_factors.io.motions.bvh import read_bvh, read_bvh_clip
from vip_factors.io.motions.retarget import retarget

ROOT = np.array([[0.0, 0.95, 0.0]] * 4)
STILL = {name: np.broadcast_to(np.eye(3), (4, 3, 3)) for name in JOINT_NAMES}


def spread_rest(offsets: dict[str, Array], degrees: float) -> dict[str, Array]:
    """The skeleton with its arms lowered by so much at rest (an A-pose)."""
    lowered = dict(offsets)
    for side, sign in (("left", -1.0), ("right", 1.0)):
        for joint in ("elbow", "wrist", "hand"):
            name = f"{side}_{joint}"
            lowered[name] = rotation_z(sign * np.radians(degrees)) @ offsets[name]
    return lowered


@pytest.mark.parametrize("names", [MVN_NAMES, CGSPEED_NAMES], ids=["MVN", "cgspeed"])
def test_the_source_at_rest_is_our_t_pose(tmp_path: Path, names: dict[str, str]) -> None:
    motion = read_bvh(write_bvh(tmp_path / "a.bvh", names, rest_skeleton(), STILL, ROOT))
    R = motion.R_parent_child.copy()
    if names is CGSPEED_NAMES:  # whose arms are turned about themselves, so that elbows bend about y
        for side in ("left", "right"):
            shoulder = joint_index(f"{side}_shoulder")
            R[:, shoulder] = R[:, shoulder] @ rotation_x(np.radians(30.0))
    np.testing.assert_allclose(R[:, 1:], np.broadcast_to(np.eye(3), (4, 23, 3, 3)), atol=1e-6)


def test_joints_stay_where_the_source_has_them(tmp_path: Path) -> None:
    path = write_bvh(tmp_path / "a.bvh", MVN_NAMES, rest_skeleton(), random_pose(3), ROOT)
    clip, motion = read_bvh_clip(path), read_bvh(path)
    for ours, theirs in MVN_NAMES.items():
        source = clip.p_world_node[:, clip.node(theirs)] @ rotation_x(np.pi / 2).T / 100
        np.testing.assert_allclose(motion.state.p_world_joint[:, joint_index(ours)], source, atol=1e-6)


def test_an_a_pose_rest_gives_the_same_motion(tmp_path: Path) -> None:
    pose = dict(STILL)
    pose["left_elbow"] = np.broadcast_to(rotation_y(-1.0), (4, 3, 3))
    straight = read_bvh(write_bvh(tmp_path / "t.bvh", MVN_NAMES, rest_skeleton(), pose, ROOT))
    # In the A-pose file the same world pose is reached by lifting the arm back to the horizontal first.
    lift = {side: rotation_z(sign * np.radians(40)) for side, sign in (("left", 1.0), ("right", -1.0))}
    lifted = dict(pose)
    for side, R in lift.items():
        lifted[f"{side}_shoulder"] = pose[f"{side}_shoulder"] @ R
        lifted[f"{side}_elbow"] = R.T @ pose[f"{side}_elbow"] @ R
    offsets = spread_rest(rest_skeleton(), 40)
    ends = {f"{side}_wrist": lift[side].T @ [x, 0.0, 0.0] for side, x in (("left", 0.2), ("right", -0.2))}
    path = write_bvh(tmp_path / "a.bvh", MVN_NAMES, offsets, lifted, ROOT, ends=ends)
    np.testing.assert_allclose(read_bvh(path).R_parent_child, straight.R_parent_child, atol=1e-6)


def test_a_bent_figure_whose_rest_stands_for_a_t_pose_gets_straight_limbs(tmp_path: Path) -> None:
    offsets = rest_skeleton()
    for side in ("left", "right"):
        offsets[f"{side}_wrist"] = rotation_y(-0.3 if side == "left" else 0.3) @ offsets[f"{side}_wrist"]
    motion = read_bvh(write_bvh(tmp_path / "a.bvh", CGSPEED_NAMES, offsets, STILL, ROOT))
    forearm = motion.skeleton.p_parent_joint[joint_index("left_wrist")]
    np.testing.assert_allclose(forearm / np.linalg.norm(forearm), [1, 0, 0], atol=1e-6)
    np.testing.assert_allclose(
        motion.R_parent_child[:, joint_index("left_elbow")], np.eye(3)[None].repeat(4, 0), atol=1e-6
    )


def test_a_spine_joint_that_the_source_lacks_lies_on_the_way_to_the_next(tmp_path: Path) -> None:
    path = write_bvh(tmp_path / "a.bvh", CGSPEED_NAMES, rest_skeleton(), random_pose(5, spread=0.2), ROOT)
    motion = read_bvh(path)
    p = motion.state.p_world_joint
    spine2, spine3, neck = (p[:, joint_index(name)] for name in ("spine2", "spine3", "neck"))
    total = np.linalg.norm(neck - spine2, axis=1)
    parts = np.linalg.norm(spine3 - spine2, axis=1) + np.linalg.norm(neck - spine3, axis=1)
    np.testing.assert_allclose(parts, total, rtol=1e-6)
    np.testing.assert_allclose(motion.R_parent_child[:, joint_index("spine3")], np.eye(3)[None].repeat(4, 0), atol=1e-9)


def test_a_rest_pose_before_the_take_is_left_out_but_a_t_pose_of_the_take_is_not(tmp_path: Path) -> None:
    frames = 40
    arm = np.zeros(frames)
    arm[1:] = 1.2
    down = rotation_z(-arm)
    pose = {name: np.broadcast_to(np.eye(3), (frames, 3, 3)) for name in JOINT_NAMES} | {"left_shoulder": down}
    root = np.tile(ROOT[:1], (frames, 1))
    jump = write_bvh(tmp_path / "jump.bvh", MVN_NAMES, rest_skeleton(), pose, root)
    assert len(read_bvh(jump)) == frames - 1
    assert len(read_bvh(jump, keep_rest_frames=True)) == frames
    pose["left_shoulder"] = rotation_z(-np.linspace(0, 1.2, frames))  # 3 rad/s: a person lowers the arm
    slow = write_bvh(tmp_path / "slow.bvh", MVN_NAMES, rest_skeleton(), pose, root)
    assert len(read_bvh(slow)) == frames


def test_an_implausible_size_asks_for_the_unit(tmp_path: Path) -> None:
    path = write_bvh(tmp_path / "a.bvh", MVN_NAMES, rest_skeleton(), STILL, ROOT, scale=7.0)
    with pytest.raises(InputError, match="unit_m"):
        read_bvh(path)
    motion = retarget(read_bvh_clip(path), unit_m=1 / 7.0)
    assert motion.skeleton.bone_length("left_knee") == pytest.approx(np.linalg.norm(rest_skeleton()["left_knee"]))


def test_a_rest_pose_that_lies_is_refused(tmp_path: Path) -> None:
    offsets = {name: np.array([one[1], 0.0, 0.0]) for name, one in rest_skeleton().items()}  # everything on one line
    path = write_bvh(tmp_path / "a.bvh", MVN_NAMES, offsets, STILL, ROOT)
    with pytest.raises(InputError, match="upright body"):
        read_bvh(path)


def test_a_dummy_end_of_the_hand_does_not_bend_the_wrist(tmp_path: Path) -> None:
    for number, end in enumerate([(0.0, 0.05, 0.0), (0.0, 0.0, 0.0)]):
        ends = {"left_wrist": end, "right_wrist": end}
        path = write_bvh(tmp_path / f"{number}.bvh", MVN_NAMES, rest_skeleton(), STILL, ROOT, ends=ends)
        wrist = read_bvh(path).R_parent_child[:, joint_index("left_wrist")]
        np.testing.assert_allclose(wrist, np.eye(3)[None].repeat(4, 0), atol=1e-6)
