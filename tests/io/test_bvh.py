import contextlib
import itertools
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from motion_samples import MVN_NAMES, SMPL_NAMES, random_pose, rest_skeleton, write_bvh

from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import rotation_x
from vip_factors.io.motions.bvh import read_bvh, read_bvh_clip

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


def test_frame_times_with_few_digits_mean_whole_rates(tmp_path: Path) -> None:
    path = write_bvh(tmp_path / "a.bvh", SMPL_NAMES, rest_skeleton(), random_pose(0), ROOT, frame_time=0.016667)
    assert read_bvh(path).rate == 60.0


def test_a_file_cut_off_in_its_last_line_gives_its_whole_frames(sample: Path) -> None:
    text = sample.read_text()
    sample.write_text(text[: text.rindex(" ") - 40])
    assert len(read_bvh(sample)) == 3


@given(cut=st.floats(0, 1), garbage=st.sampled_from(["", "nan", "}", "CHANNELS x", "{", "\x00"]))
def test_a_damaged_file_is_read_or_refused_but_never_breaks(
    tmp_path_factory: pytest.TempPathFactory, cut: float, garbage: str
) -> None:
    path = tmp_path_factory.mktemp("bvh") / "damaged.bvh"
    text = write_bvh(path, SMPL_NAMES, rest_skeleton(), random_pose(0), ROOT).read_text()
    path.write_text(text[: int(cut * len(text))] + garbage)
    with contextlib.suppress(InputError):
        assert len(read_bvh(path)) >= 1


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
