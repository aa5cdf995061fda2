"""Motion files of every kind come onto our skeleton: BVH, AMASS, and what retargeting promises."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from motion_samples import (
    CGSPEED_NAMES,
    MVN_NAMES,
    SMPL_NAMES,
    random_pose,
    rest_skeleton,
    slimevr_body,
    write_bvh,
    write_slimevr,
)

from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import JOINT_NAMES, joint_index
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import Array, exp, rotation_x, rotation_y, rotation_z
from vip_factors.io.motions.files import motion_files, read_amass, read_bvh, read_bvh_clip, read_motion

ROOT = np.array([[0.1, 0.9, 0.2], [0.1, 0.9, 0.3], [0.1, 0.91, 0.4], [0.2, 0.92, 0.5]])
ORDERS = ["".join(order) for order in itertools.permutations("XYZ")]


@pytest.fixture
def sample(tmp_path: Path) -> Path:
    return write_bvh(tmp_path / "walk.bvh", SMPL_NAMES, rest_skeleton(), random_pose(0), ROOT)


@given(
    order=st.sampled_from(ORDERS), seed=st.integers(0, 10_000), scale=st.sampled_from([1.0, 100.0, 1000.0, 1 / 0.0254])
)
def test_any_euler_order_and_unit_gives_the_pose_back(
    tmp_path_factory: pytest.TempPathFactory, order: str, seed: int, scale: float
) -> None:
    pose, offsets = random_pose(seed), rest_skeleton()
    path = tmp_path_factory.mktemp("bvh") / "any.bvh"
    motion = read_bvh(write_bvh(path, SMPL_NAMES, offsets, pose, ROOT, order=order, scale=scale))
    for joint, name in enumerate(JOINT_NAMES[1:], start=1):
        np.testing.assert_allclose(motion.R_parent_child[:, joint], pose[name], atol=1e-6)
        np.testing.assert_allclose(motion.skeleton.p_parent_joint[joint], offsets[name], atol=1e-6)
    np.testing.assert_allclose(motion.R_parent_child[:, 0], rotation_x(np.pi / 2) @ pose["pelvis"], atol=1e-6)
    np.testing.assert_allclose(motion.p_world_pelvis, ROOT @ rotation_x(np.pi / 2).T, atol=1e-6)
    assert motion.rate == 100.0
    assert motion.name == "any"


def test_a_z_up_file_gives_the_same_motion_as_its_y_up_twin(tmp_path: Path) -> None:
    pose, turn = random_pose(1), np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # forward x, left y, up z
    y_up = read_bvh(write_bvh(tmp_path / "y.bvh", MVN_NAMES, rest_skeleton(), pose, ROOT))
    z_up = read_bvh(write_bvh(tmp_path / "z.bvh", MVN_NAMES, rest_skeleton(), pose, ROOT @ turn.T, turn=turn))
    np.testing.assert_allclose(z_up.state.p_world_joint, y_up.state.p_world_joint, atol=1e-6)
    np.testing.assert_allclose(z_up.R_parent_child, y_up.R_parent_child, atol=1e-6)


@pytest.mark.parametrize("foot", [[0.0, -0.1, 0.0], [0.0, -0.05, -0.1]])
def test_a_foot_that_hangs_or_points_backwards_is_not_turned(tmp_path: Path, foot: list[float]) -> None:
    offsets, pose = rest_skeleton(), random_pose(2)
    usual = read_bvh(write_bvh(tmp_path / "usual.bvh", MVN_NAMES, offsets, pose, ROOT))
    offsets = {**offsets, "left_foot": np.array(foot)}
    motion = read_bvh(write_bvh(tmp_path / "foot.bvh", MVN_NAMES, offsets, pose, ROOT))
    ankle = joint_index("left_ankle")
    np.testing.assert_allclose(motion.R_parent_child[:, ankle], usual.R_parent_child[:, ankle], atol=1e-6)


def test_a_file_cut_off_in_its_last_line_gives_its_whole_frames(sample: Path) -> None:
    text = sample.read_text()
    sample.write_text(text[: text.rindex(" ") - 40])
    assert len(read_bvh(sample)) == 3


def test_messages_name_the_line(sample: Path, tmp_path: Path) -> None:
    lines = sample.read_text().splitlines()
    lines[-2] = lines[-2].replace(lines[-2].split()[5], "oops", 1)
    sample.write_text("\n".join(lines))
    with pytest.raises(FileFormatError, match=f"line {len(lines) - 1}"):
        read_bvh(sample)
    (tmp_path / "not.bvh").write_text("<xml/>\n")
    with pytest.raises(FileFormatError, match=r"line 1: .*BVH"):
        read_bvh(tmp_path / "not.bvh")
    with pytest.raises(FileFormatError, match="cannot be read"):
        read_bvh(tmp_path / "absent.bvh")


def test_an_unknown_skeleton_is_refused_with_what_it_lacks(tmp_path: Path) -> None:
    names = {joint: f"bone{number}" for number, joint in enumerate(JOINT_NAMES)}
    path = write_bvh(tmp_path / "a.bvh", names, rest_skeleton(), random_pose(0), ROOT)
    with pytest.raises(InputError, match="none of the known families"):
        read_bvh(path)


@pytest.mark.data
@pytest.mark.parametrize("name", ["cmu_bvh/02/02_01.bvh", "cmu_bvh/12/12_02.bvh", "cmu_bvh/06/06_12.bvh"])
def test_a_cmu_clip_stands_on_the_floor_with_left_on_the_left(data_folder: Path, name: str) -> None:
    motion = read_bvh(data_folder / name)
    p = motion.state.p_world_joint
    assert motion.rate == 120.0
    assert 1.5 < motion.skeleton.stature < 1.8
    marks = [mark for key, mark in motion.skeleton.landmarks.items() if key.endswith(("heel", "toe_tip"))]
    soles = np.min([motion.state.point(mark.bone, mark.p_bone_point)[:, 2] for mark in marks], axis=0)
    assert abs(np.median(soles)) < 0.12  # the database's floor slopes by a percent or two
    assert np.all(p[:, 15, 2] - p[:, 0, 2] > 0.4)
    left = motion.R_parent_child[:, 0, :, 0]
    assert np.all(np.sum((p[:, 1] - p[:, 2]) * left, axis=1) > 0.1)
    assert np.all(np.linalg.norm(np.diff(p[:, 20], axis=0), axis=1) * motion.rate < 12)  # the rest pose is gone


@pytest.mark.data
@pytest.mark.parametrize("name", ["mvnx/upper_body_60hz_v4.bvh", "xsens_vicon_walk/mvn/S02-Trial-Walk-1.bvh"])
def test_mvn_joints_stay_where_they_were(data_folder: Path, name: str) -> None:
    clip, motion = read_bvh_clip(data_folder / name), read_bvh(data_folder / name)
    scale = 1.0 / (1000 if "vicon" in name else 100)
    assert len(motion) == len(clip) - 1  # the identity pose that MVN puts first
    for ours, theirs in (("left_wrist", "LeftWrist"), ("right_ankle", "RightAnkle"), ("head", "Head")):
        source = clip.p_world_node[1:, clip.node(theirs)] @ rotation_x(np.pi / 2).T * scale
        np.testing.assert_allclose(motion.state.p_world_joint[:, JOINT_NAMES.index(ours)], source, atol=1e-3)


def write_amass(path: Path, width: int = 156, **changed: object) -> Path:
    rng = np.random.default_rng(0)
    poses = rng.normal(0, 0.3, (5, width))
    poses[:, :3] = [np.pi / 2, 0, 0]  # upright in a world with Z up
    content = {
        "poses": poses, "trans": np.array([[0, 0, 0.9]] * 5), "betas": np.zeros(16), "gender": np.array("female"),
        "mocap_framerate": np.array(120.0),
    } | changed  # fmt: skip
    np.savez(path, **{name: value for name, value in content.items() if value is not None})  # type: ignore[arg-type]
    return path


@given(width=st.sampled_from([72, 156, 165]), seed=st.integers(0, 1000))
def test_body_rotations_are_taken_over_and_hands_are_rigid(
    tmp_path_factory: pytest.TempPathFactory, width: int, seed: int
) -> None:
    poses = np.random.default_rng(seed).normal(0, 0.5, (3, width))
    path = tmp_path_factory.mktemp("amass") / "a_poses.npz"
    motion = read_amass(write_amass(path, poses=poses, trans=np.zeros((3, 3))))
    np.testing.assert_allclose(motion.R_parent_child[:, :22], exp(poses[:, :66].reshape(3, 22, 3)), atol=1e-12)
    np.testing.assert_allclose(motion.R_parent_child[:, 22:], np.broadcast_to(np.eye(3), (3, 2, 3, 3)))


@pytest.mark.parametrize("gender", [np.array("male"), np.array(b"male"), np.array(["Male"]), np.array("b'male'")])
def test_gender_is_read_however_it_is_stored(tmp_path: Path, gender: np.ndarray) -> None:
    motion = read_amass(write_amass(tmp_path / "a.npz", gender=gender))
    assert "male" in motion.skeleton.source
    assert motion.skeleton.stature == pytest.approx(1.78, abs=0.02)


def test_either_spelling_of_the_rate_is_read_and_none_is_refused(tmp_path: Path) -> None:
    path = write_amass(tmp_path / "a.npz", mocap_framerate=None, mocap_frame_rate=np.array(60.0))
    assert read_amass(path).rate == 60.0
    path = write_amass(tmp_path / "a.npz", mocap_framerate=None)
    with pytest.raises(InputError, match="expected frames per second"):
        read_amass(path)


def test_other_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="lacks poses"):
        read_amass(write_amass(tmp_path / "a.npz", poses=None))
    with pytest.raises(FileFormatError, match=r"poses \(5, 99\)"):
        read_amass(write_amass(tmp_path / "a.npz", width=99))
    bad = np.full((5, 156), np.nan)
    with pytest.raises(FileFormatError, match="not finite"):
        read_amass(write_amass(tmp_path / "a.npz", poses=bad))
    (tmp_path / "text.npz").write_text("hello")
    with pytest.raises(FileFormatError, match="not an AMASS npz"):
        read_amass(tmp_path / "text.npz")
    with pytest.raises(InputError, match=r"\.bvh"):
        read_motion(tmp_path / "a.fbx")


def test_motion_files_are_found_below_a_folder(tmp_path: Path) -> None:
    (tmp_path / "deep").mkdir()
    for name in ("b_poses.npz", "deep/a.bvh", "deep/shape.npz", "notes.txt", "x_neutral_stagei.npz"):
        (tmp_path / name).touch()
    assert [path.name for path in motion_files(tmp_path)] == ["b_poses.npz", "a.bvh"]


@pytest.mark.parametrize("number", [1e300, np.nan])
def test_joint_offsets_that_no_body_has_are_refused(tmp_path: Path, number: float) -> None:
    offsets = np.full((24, 3), number)
    np.savez(
        tmp_path / "a.npz",
        poses=np.zeros((2, 156)),
        trans=np.zeros((2, 3)),
        mocap_framerate=60.0,
        joint_offsets=offsets,
    )
    with pytest.raises(FileFormatError, match="joint_offsets hold numbers beyond 10 m"):
        read_amass(tmp_path / "a.npz")


SIMPLE_ROOT = np.array([[0.0, 0.95, 0.0]] * 4)
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
    motion = read_bvh(write_bvh(tmp_path / "a.bvh", names, rest_skeleton(), STILL, SIMPLE_ROOT))
    R = motion.R_parent_child.copy()
    if names is CGSPEED_NAMES:  # whose arms are turned about themselves, so that elbows bend about y
        for side in ("left", "right"):
            shoulder = joint_index(f"{side}_shoulder")
            R[:, shoulder] = R[:, shoulder] @ rotation_x(np.radians(30.0))
    np.testing.assert_allclose(R[:, 1:], np.broadcast_to(np.eye(3), (4, 23, 3, 3)), atol=1e-6)


def test_joints_stay_where_the_source_has_them(tmp_path: Path) -> None:
    path = write_bvh(tmp_path / "a.bvh", MVN_NAMES, rest_skeleton(), random_pose(3), SIMPLE_ROOT)
    clip, motion = read_bvh_clip(path), read_bvh(path)
    for ours, theirs in MVN_NAMES.items():
        source = clip.p_world_node[:, clip.node(theirs)] @ rotation_x(np.pi / 2).T / 100
        np.testing.assert_allclose(motion.state.p_world_joint[:, joint_index(ours)], source, atol=1e-6)


def test_an_a_pose_rest_gives_the_same_motion(tmp_path: Path) -> None:
    pose = dict(STILL)
    pose["left_elbow"] = np.broadcast_to(rotation_y(-1.0), (4, 3, 3))
    straight = read_bvh(write_bvh(tmp_path / "t.bvh", MVN_NAMES, rest_skeleton(), pose, SIMPLE_ROOT))
    # In the A-pose file the same world pose is reached by lifting the arm back to the horizontal first.
    lift = {side: rotation_z(sign * np.radians(40)) for side, sign in (("left", 1.0), ("right", -1.0))}
    lifted = dict(pose)
    for side, R in lift.items():
        lifted[f"{side}_shoulder"] = pose[f"{side}_shoulder"] @ R
        lifted[f"{side}_elbow"] = R.T @ pose[f"{side}_elbow"] @ R
    offsets = spread_rest(rest_skeleton(), 40)
    ends = {f"{side}_wrist": lift[side].T @ [x, 0.0, 0.0] for side, x in (("left", 0.2), ("right", -0.2))}
    path = write_bvh(tmp_path / "a.bvh", MVN_NAMES, offsets, lifted, SIMPLE_ROOT, ends=ends)
    np.testing.assert_allclose(read_bvh(path).R_parent_child, straight.R_parent_child, atol=1e-6)


def test_a_bent_figure_whose_rest_stands_for_a_t_pose_gets_straight_limbs(tmp_path: Path) -> None:
    offsets = rest_skeleton()
    for side in ("left", "right"):
        offsets[f"{side}_wrist"] = rotation_y(-0.3 if side == "left" else 0.3) @ offsets[f"{side}_wrist"]
    motion = read_bvh(write_bvh(tmp_path / "a.bvh", CGSPEED_NAMES, offsets, STILL, SIMPLE_ROOT))
    forearm = motion.skeleton.p_parent_joint[joint_index("left_wrist")]
    np.testing.assert_allclose(forearm / np.linalg.norm(forearm), [1, 0, 0], atol=1e-6)
    np.testing.assert_allclose(
        motion.R_parent_child[:, joint_index("left_elbow")], np.eye(3)[None].repeat(4, 0), atol=1e-6
    )


def test_a_rest_pose_before_the_take_is_left_out_but_a_t_pose_of_the_take_is_not(tmp_path: Path) -> None:
    frames = 40
    arm = np.zeros(frames)
    arm[1:] = 1.2
    down = rotation_z(-arm)
    pose = {name: np.broadcast_to(np.eye(3), (frames, 3, 3)) for name in JOINT_NAMES} | {"left_shoulder": down}
    root = np.tile(SIMPLE_ROOT[:1], (frames, 1))
    jump = write_bvh(tmp_path / "jump.bvh", MVN_NAMES, rest_skeleton(), pose, root)
    assert len(read_bvh(jump)) == frames - 1
    pose["left_shoulder"] = rotation_z(-np.linspace(0, 1.2, frames))  # 3 rad/s: a person lowers the arm
    slow = write_bvh(tmp_path / "slow.bvh", MVN_NAMES, rest_skeleton(), pose, root)
    assert len(read_bvh(slow)) == frames


def test_an_implausible_size_asks_for_the_unit(tmp_path: Path) -> None:
    path = write_bvh(tmp_path / "a.bvh", MVN_NAMES, rest_skeleton(), STILL, SIMPLE_ROOT, scale=7.0)
    with pytest.raises(InputError, match="scale the file"):
        read_bvh(path)


def test_a_rest_pose_that_lies_is_refused(tmp_path: Path) -> None:
    offsets = {name: np.array([one[1], 0.0, 0.0]) for name, one in rest_skeleton().items()}  # everything on one line
    path = write_bvh(tmp_path / "a.bvh", MVN_NAMES, offsets, STILL, SIMPLE_ROOT)
    with pytest.raises(InputError, match="upright body"):
        read_bvh(path)


@given(seed=st.integers(0, 10_000))
def test_slimevrs_chain_from_the_head_gives_the_motion_back(
    tmp_path_factory: pytest.TempPathFactory, seed: int
) -> None:
    rigid = ("collar", "hand", "foot")  # with the bones above them
    pose = {name: np.eye(3) if name.endswith(rigid) else R[:2] for name, R in random_pose(seed).items()}
    R = np.stack([np.broadcast_to(pose[name], (2, 3, 3)) for name in JOINT_NAMES], axis=1)
    motion = Motion(slimevr_body(), R, ROOT[:2], 50.0)
    found = read_bvh(write_slimevr(tmp_path_factory.mktemp("slimevr") / "a.bvh", motion))
    chosen = [joint for joint, name in enumerate(JOINT_NAMES) if not name.endswith(("collar", "hand"))]
    for ours, theirs in zip(
        (motion.state.R_world_bone, motion.state.p_world_joint),
        (found.state.R_world_bone, found.state.p_world_joint),
        strict=True,
    ):
        np.testing.assert_allclose(theirs[:, chosen], ours[:, chosen], atol=1e-6)
    assert found.rate == 50.0
    assert "SlimeVR" in found.skeleton.source
