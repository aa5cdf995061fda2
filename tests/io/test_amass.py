from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import exp, rotation_x
from vip_factors.io.motions import motion_files, read_motion
from vip_factors.io.motions.amass import read_amass


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


def test_an_upright_wearer_stands_in_a_world_with_z_up(tmp_path: Path) -> None:
    motion = read_motion(write_amass(tmp_path / "a.npz", poses=np.tile([np.pi / 2] + [0.0] * 155, (5, 1))))
    np.testing.assert_allclose(motion.R_parent_child[:, 0], rotation_x(np.full(5, np.pi / 2)), atol=1e-12)
    p = motion.state.p_world_joint
    assert np.all(p[:, 15, 2] - p[:, 7, 2] > 1.2)
    assert motion.rate == 120.0


@pytest.mark.parametrize("gender", [np.array("male"), np.array(b"male"), np.array(["Male"]), np.array("b'male'")])
def test_gender_is_read_however_it_is_stored(tmp_path: Path, gender: np.ndarray) -> None:
    motion = read_amass(write_amass(tmp_path / "a.npz", gender=gender))
    assert "male" in motion.skeleton.source
    assert motion.skeleton.stature == pytest.approx(1.78, abs=0.02)


def test_either_spelling_of_the_rate_is_read_and_none_asks_for_it(tmp_path: Path) -> None:
    path = write_amass(tmp_path / "a.npz", mocap_framerate=None, mocap_frame_rate=np.array(60.0))
    assert read_amass(path).rate == 60.0
    path = write_amass(tmp_path / "a.npz", mocap_framerate=None)
    with pytest.raises(InputError, match="give the rate"):
        read_amass(path)
    assert read_amass(path, rate=30.0, stature_m=1.6).rate == 30.0


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
