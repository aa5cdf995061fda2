"""Poses for users of SMPL, AMASS-style and 3DPW-style, read back by NumPy, pickle and a few lines of kinematics."""

import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from animated import TENTH_MM, filmed, smpl_joints, zup
from scene_sample import with_labels

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.errors import InputError
from vip_factors.estimate import Estimate, WearerEstimate
from vip_factors.geometry.rotations import Array
from vip_factors.io.export.files import export
from vip_factors.io.mcap_recording import write_recording
from vip_factors.io.motions.files import BODY_JOINTS, read_amass
from vip_factors.io.settings import ExportSettings
from vip_factors.sensors.camera import CameraPath
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


def test_the_wearers_own_lengths_come_back_too(tmp_path: Path) -> None:
    motion = gestures(0.1, skeleton=skeleton_from_stature(1.58))
    (path,) = export(Estimate("walk", "IT", (WearerEstimate("Ada", "IT", motion, {}),)), tmp_path / "walk.npz")
    assert np.allclose(read_amass(path).state.p_world_joint, motion.state.p_world_joint, atol=1e-9)


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


# Keypoints of OpenPose's 18 that lie on joints of SMPL: elbows, wrists, knees, ankles.
KEYPOINTS, JOINTS = [3, 6, 4, 7, 10, 13], [19, 18, 21, 20, 8, 7]


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "scene.mcap"
    write_recording(filmed()[0], path)
    return path


def content_of(path: Path) -> dict[str, Any]:
    with path.open("rb") as file:
        return pickle.load(file, encoding="latin1")


def pixels_of(content: dict[str, Any], person: int) -> Array:
    T, p = content["cam_poses"], content["jointPositions"][person].reshape(-1, 24, 3)
    p = np.einsum("tij,tkj->tki", T[:, :3, :3], p) + T[:, None, :3, 3]
    flat = p @ content["cam_intrinsics"].T
    return flat[..., :2] / flat[..., 2:]


def test_joints_lie_where_the_estimate_has_them(tmp_path: Path) -> None:
    estimate = filmed()[1]
    (path,) = export(estimate, tmp_path / "a.pkl")
    content = content_of(path)
    assert len(content["poses"]) == 2
    for person, one in enumerate(estimate.wearers):
        known = one.motion.state.p_world_joint
        told = content["jointPositions"][person].reshape(-1, 24, 3)
        assert np.abs(zup(told) - known[::2]).max() < TENTH_MM / 1000
        for key, frames in (("", slice(None, None, 2)), ("_60Hz", slice(None))):
            trans = content[f"trans{key}"][person]
            pelvis = trans + (told[0, 0] - content["trans"][person][0])
            found = smpl_joints(content[f"poses{key}"][person], pelvis, one.motion.skeleton.p_parent_joint)
            assert np.abs(zup(found) - known[frames]).max() < TENTH_MM / 1000
    assert content["img_frame_ids"].tolist() == list(range(0, 31, 2))
    assert content["genders"] == ["n", "n"]
    assert [one.shape for one in content["betas"]] == [(10,), (10,)]


def test_with_the_recording_its_2d_poses_are_there(recording: Path, tmp_path: Path) -> None:
    scene, estimate = filmed()
    (path,) = export(estimate, tmp_path / "a.pkl", ExportSettings(recording=recording))
    content = content_of(path)
    frames = len(scene.camera.detections.time)
    for person in range(2):
        poses2d = content["poses2d"][person]
        assert poses2d.shape == (frames, 3, 18)
        found = poses2d[:, :2, KEYPOINTS].transpose(0, 2, 1)
        assert np.abs(found - pixels_of(content, person)[:, JOINTS]).max() < 1e-3
        assert np.allclose(poses2d[:, :2, 1], (poses2d[:, :2, 2] + poses2d[:, :2, 5]) / 2)
        assert content["campose_valid"][person].all()


def test_pictures_outside_the_estimate_are_not_valid(recording: Path, tmp_path: Path) -> None:
    estimate = filmed()[1]
    path = estimate.camera.path
    part = CameraPath(path.time[4:20], path.R_world_camera[4:20], path.p_world_camera[4:20])
    short = replace(
        estimate,
        wearers=tuple(replace(wearer, motion=wearer.motion.frames(slice(4, 20))) for wearer in estimate.wearers),
        cameras=(replace(estimate.camera, path=part),),
    )
    (path,) = export(short, tmp_path / "a.pkl", ExportSettings(recording=recording))
    content = content_of(path)
    assert np.flatnonzero(content["campose_valid"][0]).tolist() == list(range(2, 10))
    assert len(content["poses"][0]) == len(content["campose_valid"][0]) == 16
    assert 0 <= content["img_frame_ids"].min() <= content["img_frame_ids"].max() < len(content["poses_60Hz"][0])


def test_old_readers_know_all_that_is_in_it(tmp_path: Path) -> None:
    (path,) = export(filmed()[1], tmp_path / "a.pkl")
    pickled = path.read_bytes()
    assert pickled[:2] == b"\x80\x02"
    assert b"numpy._core" not in pickled  # NumPy before 1.26 has no such module


def test_another_recording_is_refused(recording: Path, tmp_path: Path) -> None:
    strange = with_labels(filmed()[1], np.zeros(5, int))
    with pytest.raises(InputError, match="5"):
        export(strange, tmp_path / "a.pkl", ExportSettings(recording=recording))
