"""AMASS files that we write are read as the motion that they are of."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from animated import TENTH_MM, smpl_joints

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.errors import InputError
from vip_factors.estimate import Estimate, WearerEstimate
from vip_factors.io.export.files import ExportSettings, export
from vip_factors.io.motions.amass import BODY_JOINTS, read_amass
from vip_factors.simulate.gestures import gestures


def _scene(*names: str) -> Estimate:
    motion = gestures(seconds=0.5)
    return Estimate("walk", "VIP", tuple(WearerEstimate(name, "VIP", motion, {}) for name in names))


def test_poses_and_root_come_back(tmp_path: Path) -> None:
    scene = _scene("Ada")
    motion = scene.wearers[0].motion
    (written,) = export(scene, tmp_path / "walk.npz")
    found = read_amass(written)
    body = slice(0, BODY_JOINTS)
    assert np.allclose(found.R_parent_child[:, body], motion.R_parent_child[:, body], atol=1e-9)
    assert np.allclose(found.p_world_pelvis, motion.p_world_pelvis, atol=1e-9)
    assert found.rate == motion.rate


def test_plain_numpy_finds_the_joints_where_the_estimate_has_them(tmp_path: Path) -> None:
    scene = _scene("Ada")
    (path,) = export(scene, tmp_path / "walk.npz", ExportSettings(frame_rate=60.0))
    with np.load(path) as file:
        assert not file["poses"][:, 66:].any()  # hands, which SMPL has as two more joints
        p_pelvis = file["trans"] + [0.0, -0.23, 0.03]  # the pelvis of the mean shape at rest
        found = smpl_joints(file["poses"][:, :72], p_pelvis, file["joint_offsets"])
    known = scene.wearers[0].motion.state.p_world_joint[::2]
    assert np.abs(found - known)[:, :22].max() < TENTH_MM / 1000


def test_a_wearers_name_may_hold_what_file_names_cannot(tmp_path: Path) -> None:
    written = export(_scene("Ada/1", "Bea: 2"), tmp_path / "walk.npz")
    assert [path.name for path in written] == ["walk.Ada_1.npz", "walk.Bea_ 2.npz"]


def test_each_wearer_gets_a_file(tmp_path: Path) -> None:
    written = export(_scene("Ada", "Bea"), tmp_path / "walk.npz")
    assert [path.name for path in written] == ["walk.Ada.npz", "walk.Bea.npz"]
    assert all(path.exists() for path in written)


def test_an_unknown_suffix_names_those_that_are_known(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"\.npz"):
        export(_scene("Ada"), tmp_path / "walk.doc")


def test_the_wearers_own_lengths_come_back_too(tmp_path: Path) -> None:
    motion = gestures(0.1, skeleton=skeleton_from_stature(1.58))
    (path,) = export(Estimate("walk", "IT", (WearerEstimate("Ada", "IT", motion, {}),)), tmp_path / "walk.npz")
    assert np.allclose(read_amass(path).state.p_world_joint, motion.state.p_world_joint, atol=1e-9)
    assert read_amass(path, stature_m=1.9).skeleton.stature == pytest.approx(1.9, abs=0.01)


def test_it_holds_what_other_readers_ask_for(tmp_path: Path) -> None:
    scene = _scene("Ada")
    motion = replace(scene.wearers[0].motion, rate=59.9999999999)
    (path,) = export(replace(scene, wearers=(replace(scene.wearers[0], motion=motion),)), tmp_path / "walk.npz")
    with np.load(path) as file:
        T = len(motion)
        shapes = {name: file[name].shape for name in ("poses", "trans", "betas", "dmpls")}
        assert shapes == {"poses": (T, 156), "trans": (T, 3), "betas": (16,), "dmpls": (T, 8)}
        assert (str(file["gender"]), int(file["mocap_framerate"]), int(file["mocap_frame_rate"])) == ("neutral", 60, 60)


@pytest.mark.parametrize("suffix", [".bvh", ".npz", ".csv"])
def test_an_estimate_without_frames_is_refused(tmp_path: Path, suffix: str) -> None:
    scene = _scene("Ada")
    wearer = scene.wearers[0]
    none = replace(wearer.motion, R_parent_child=np.zeros((0, 24, 3, 3)), p_world_pelvis=np.zeros((0, 3)))
    with pytest.raises(InputError, match="'Ada' has no frames"):
        export(replace(scene, wearers=(replace(wearer, motion=none),)), tmp_path / f"walk{suffix}")
    assert list(tmp_path.iterdir()) == []
