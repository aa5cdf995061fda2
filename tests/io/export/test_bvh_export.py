"""BVH files that we write, as another program's reader (bvhio) and our own read them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from animated import TENTH_MM, any_pose, filmed, zup

from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.estimate import Estimate
from vip_factors.geometry.rotations import Array, angle_between, rotation_x
from vip_factors.io.export.files import BoneNames, BvhSettings, ExportSettings, LengthUnit, UpAxis, bone_names, export
from vip_factors.io.motions.bvh import read_bvh, read_bvh_clip

bvhio = pytest.importorskip("bvhio", reason="its PyGLM has no wheel for every Python")

CENTIMETRES_Z_UP = BvhSettings(UpAxis.Z, LengthUnit.CENTIMETRES)


def joints_in(path: Path, names: tuple[str, ...] = JOINT_NAMES) -> Array:
    """Positions ``(T, 24, 3)`` in the file's own axes and unit, by bvhio."""
    root = bvhio.readAsHierarchy(str(path))
    nodes = [root.filter(name, isEqual=True)[0] for name in names]
    frames = []
    for frame in range(root.getKeyframeRange()[1] + 1):
        root.loadPose(frame)
        frames.append([list(node.PositionWorld) for node in nodes])
    return np.array(frames)


@pytest.mark.parametrize("names", list(BoneNames))
@pytest.mark.parametrize("estimate", [any_pose(), filmed()[1]], ids=["any pose", "walk"])
def test_another_reader_finds_every_joint(estimate: Estimate, names: BoneNames, tmp_path: Path) -> None:
    written = export(estimate, tmp_path / "a.bvh", ExportSettings(bone_names=names))
    for path, one in zip(written, estimate.wearers, strict=True):
        found = zup(joints_in(path, bone_names(names)))
        assert np.abs(found - one.motion.state.p_world_joint).max() < TENTH_MM / 10


def test_z_up_and_centimetres(tmp_path: Path) -> None:
    estimate = any_pose()
    (path,) = export(estimate, tmp_path / "a.bvh", ExportSettings(bvh=CENTIMETRES_Z_UP))
    assert np.abs(joints_in(path) / 100 - estimate.wearers[0].motion.state.p_world_joint).max() < TENTH_MM / 10


def test_the_rest_pose_stands_upright_and_faces_as_the_axes_say(tmp_path: Path) -> None:
    for up, settings in ((1, BvhSettings()), (2, BvhSettings(UpAxis.Z))):
        (path,) = export(any_pose(), tmp_path / f"{up}.bvh", ExportSettings(bvh=settings))
        clip = read_bvh_clip(path)
        at = {name: clip.p_rest[clip.node(name)] for name in clip.names}
        assert np.argmax(at["head/end"] - at["left_foot"]) == up
        toes = at["left_foot/end"] - at["left_ankle"]
        assert (toes[2] if up == 1 else -toes[1]) > 0.1
        assert at["left_hip"][0] > at["right_hip"][0]


@pytest.mark.parametrize("settings", [BvhSettings(), CENTIMETRES_Z_UP], ids=["default", "z up, cm"])
def test_our_own_reader_gives_the_motion_back(settings: BvhSettings, tmp_path: Path) -> None:
    estimate = any_pose()
    (path,) = export(estimate, tmp_path / "a.bvh", ExportSettings(bvh=settings))
    motion, found = estimate.wearers[0].motion, read_bvh(path, keep_rest_frames=True)
    assert np.rad2deg(angle_between(found.R_parent_child, motion.R_parent_child)).max() < 1e-4
    assert found.rate == pytest.approx(motion.rate, rel=1e-13)
    assert np.allclose(found.skeleton.p_parent_joint, motion.skeleton.p_parent_joint, atol=1e-6)
    for name in ("head_top", "left_toe_tip", "right_fingertip"):
        known = motion.skeleton.landmarks[name].p_bone_point
        assert np.allclose(found.skeleton.landmarks[name].p_bone_point, known, atol=1e-6)


def test_a_skeleton_without_landmarks_gets_ends_all_the_same(tmp_path: Path) -> None:
    estimate = any_pose()
    one = estimate.wearers[0]
    bare = replace(one.motion, skeleton=replace(one.motion.skeleton, landmarks={}))
    (path,) = export(replace(estimate, wearers=(replace(one, motion=bare),)), tmp_path / "a.bvh")
    clip = read_bvh_clip(path)
    assert 0.1 < clip.p_rest[clip.node("head/end")][1] - clip.p_rest[clip.node("head")][1] < 0.3


def test_angles_do_not_jump_where_a_thigh_passes_the_horizontal(tmp_path: Path) -> None:
    estimate = any_pose(frames=81)
    one = estimate.wearers[0]
    R = np.broadcast_to(np.eye(3), (81, 24, 3, 3)).copy()
    R[:, 1] = rotation_x(-np.linspace(1.2, 2.0, 81))
    R[:, 0] = rotation_x(np.pi / 2)
    motion = replace(one.motion, R_parent_child=R, p_world_pelvis=np.zeros((81, 3)))
    (path,) = export(replace(estimate, wearers=(replace(one, motion=motion),)), tmp_path / "a.bvh")
    lines = path.read_text().splitlines()
    frames = np.loadtxt(lines[lines.index("MOTION") + 3 :])
    assert np.abs(np.diff(frames, axis=0)).max() < 1.0


def test_feet_slide_no_more_than_in_the_estimate(tmp_path: Path) -> None:
    scene = filmed()[1]
    feet = [JOINT_NAMES.index(name) for name in ("left_foot", "right_foot")]

    def speed(p: Array, rate: float) -> Array:
        return np.linalg.norm(np.diff(p, axis=0), axis=-1) * rate

    before = speed(scene.wearers[0].motion.state.p_world_joint[:, feet], 60)
    for rate, more in ((60, 1e-4), (100, 0.005)):  # m/s; the walker's feet go at 0.7 m/s
        path, _ = export(scene, tmp_path / f"{rate}.bvh", ExportSettings(frame_rate=rate))
        after = speed(zup(joints_in(path))[:, feet], rate)
        for foot in range(2):
            assert np.percentile(after[:, foot], 20) < np.percentile(before[:, foot], 20) + more
