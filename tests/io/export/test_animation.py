"""BVH and glTF that we write, read as their specifications say: text; JSON, one block of bytes, and the node tree."""

import itertools
import json
import struct
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from animated import TENTH_MM, any_pose, filmed, zup
from scipy.spatial.transform import Rotation

from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.errors import InputError
from vip_factors.estimate import Estimate
from vip_factors.geometry.rotations import Array, angle_between, rotation_x
from vip_factors.io.export.animation import GltfBuffer
from vip_factors.io.export.files import export
from vip_factors.io.motions.files import read_bvh, read_bvh_clip
from vip_factors.io.motions.skeleton_maps import bone_names
from vip_factors.io.settings import BoneNames, BvhSettings, ExportSettings, LengthUnit, UpAxis
from vip_factors.sensors.camera import CameraModel, CameraPath

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
    written = export(estimate, tmp_path / "a.bvh", ExportSettings(bone_names=names, plant_feet=False))
    for path, one in zip(written, estimate.wearers, strict=True):
        found = zup(joints_in(path, bone_names(names)))
        assert np.abs(found - one.motion.state.p_world_joint).max() < TENTH_MM / 10


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
    motion, found = estimate.wearers[0].motion, read_bvh(path)
    assert np.rad2deg(angle_between(found.R_parent_child, motion.R_parent_child)).max() < 1e-4
    assert found.rate == pytest.approx(motion.rate, rel=1e-13)
    assert np.allclose(found.skeleton.p_parent_joint, motion.skeleton.p_parent_joint, atol=1e-6)
    for name in ("head_top", "left_toe_tip", "right_fingertip"):
        known = motion.skeleton.landmarks[name].p_bone_point
        assert np.allclose(found.skeleton.landmarks[name].p_bone_point, known, atol=1e-6)


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


DTYPES = {5126: np.float32, 5121: np.uint8, 5123: np.uint16, 5125: np.uint32}
WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}


class Glb:
    """A file's content."""

    def __init__(self, path: Path) -> None:
        data = path.read_bytes()
        size = struct.unpack_from("<I", data, 12)[0]
        self.json: dict[str, Any] = json.loads(data[20 : 20 + size])
        self._blob = data[28 + size :]
        self.names = [node["name"] for node in self.json["nodes"]]
        self.parents = {child: node for node, one in enumerate(self.json["nodes"]) for child in one.get("children", [])}

    def array(self, accessor: int) -> Array:
        one = self.json["accessors"][accessor]
        view = self.json["bufferViews"][one["bufferView"]]
        dtype, width = DTYPES[one["componentType"]], WIDTHS[one["type"]]
        flat = np.frombuffer(self._blob, dtype, one["count"] * width, view["byteOffset"]).reshape(-1, width)
        return flat / np.iinfo(dtype).max if one.get("normalized") else flat

    def local(self, node: int, frame: int) -> Array:
        """``(4, 4)``; the animation's keys are taken as they come."""
        one = dict(self.json["nodes"][node])
        for motion in self.json.get("animations", []):
            for channel in motion["channels"]:
                if channel["target"]["node"] == node:
                    sampler = motion["samplers"][channel["sampler"]]
                    one[channel["target"]["path"]] = self.array(sampler["output"])[frame]
        T = np.eye(4)
        T[:3, :3] = Rotation.from_quat(one.get("rotation", [0, 0, 0, 1])).as_matrix()
        T[:3, 3] = one.get("translation", [0, 0, 0])
        return T

    def world(self, node: int, frame: int) -> Array:
        T = self.local(node, frame)
        return T if node not in self.parents else self.world(self.parents[node], frame) @ T

    def skinned(self, wearer: int, frame: int) -> Array:
        """Corners ``(V, 3)`` of a body."""
        skin = self.json["skins"][wearer]
        inverse = self.array(skin["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1)
        moved = np.array([self.world(node, frame) for node in skin["joints"]]) @ inverse
        attributes = self.json["meshes"][wearer]["primitives"][0]["attributes"]
        corners = np.c_[self.array(attributes["POSITION"]), np.ones(len(self.array(attributes["POSITION"])))]
        weights, joints = self.array(attributes["WEIGHTS_0"]), self.array(attributes["JOINTS_0"])
        return np.einsum("vk,vkij,vj->vi", weights, moved[joints], corners)[:, :3]


@pytest.fixture(scope="module")
def glb(tmp_path_factory: pytest.TempPathFactory) -> Glb:
    (path,) = export(filmed()[1], tmp_path_factory.mktemp("glb") / "a.glb", ExportSettings(plant_feet=False))
    return Glb(path)


def test_joints_lie_where_the_estimate_has_them(glb: Glb) -> None:
    for wearer, one in enumerate(filmed()[1].wearers):
        joints = glb.json["skins"][wearer]["joints"]
        assert [glb.names[node] for node in joints] == list(JOINT_NAMES)
        for frame in (0, 7, 30):
            T = np.array([glb.world(node, frame) for node in joints])
            assert np.abs(zup(T[:, :3, 3]) - one.motion.state.p_world_joint[frame]).max() < TENTH_MM / 10
            R_world_bone = zup(np.swapaxes(T[:, :3, :3], 1, 2)).swapaxes(1, 2)
            inverse = glb.array(glb.json["skins"][wearer]["inverseBindMatrices"]).reshape(-1, 4, 4)
            R_bone_rest = inverse[:, :3, :3].swapaxes(1, 2)
            assert np.abs(R_world_bone @ R_bone_rest - one.motion.state.R_world_bone[frame]).max() < 1e-5


LIMBS = {"hip": "knee", "knee": "ankle", "ankle": "foot", "collar": "shoulder", "shoulder": "elbow", "elbow": "wrist"}
TRUNK = ("pelvis", "spine1", "spine2", "spine3", "neck", "head")


def test_bones_point_along_limbs(glb: Glb) -> None:
    pairs = [
        *itertools.pairwise(TRUNK),
        *((f"{s}_{a}", f"{s}_{b}") for s in ("left", "right") for a, b in LIMBS.items()),
    ]
    joints = dict(zip(JOINT_NAMES, glb.json["skins"][0]["joints"], strict=True))
    for bone, end in pairs:
        assert glb.parents[joints[end]] == joints[bone]
        offset = np.array(glb.json["nodes"][joints[end]]["translation"])
        assert offset / np.linalg.norm(offset) == pytest.approx([0, 1, 0], abs=1e-6), bone
    skin = glb.json["skins"][0]
    rest = np.linalg.inv(glb.array(skin["inverseBindMatrices"]).reshape(-1, 4, 4).swapaxes(1, 2))
    assert np.linalg.det(rest[:, :3, :3]) == pytest.approx(1.0)
    p_rest = rest[:, :3, 3] - rest[0, :3, 3]  # a T-pose that faces z, its left along x
    assert np.abs(p_rest - filmed()[1].wearers[0].motion.skeleton.p_pelvis_joint).max() < 1e-5


def test_keys_are_at_the_times_of_the_frames(glb: Glb) -> None:
    time = glb.array(glb.json["animations"][0]["samplers"][0]["input"])[:, 0]
    assert np.allclose(time, np.arange(31) / 60, atol=1e-6)
    one = glb.json["accessors"][glb.json["animations"][0]["samplers"][0]["input"]]
    assert (one["min"], one["max"]) == ([0.0], [0.5])


def test_the_camera_sees_what_it_saw(glb: Glb) -> None:
    scene, estimate = filmed()
    node = glb.names.index("phone")
    lens = glb.json["cameras"][glb.json["nodes"][node]["camera"]]["perspective"]
    for frame in (0, 20):
        p_world = estimate.wearers[1].motion.state.p_world_joint[frame]
        p_yup = np.c_[p_world[:, 0], p_world[:, 2], -p_world[:, 1], np.ones(24)]
        x, y, z = (np.linalg.inv(glb.world(node, frame)) @ p_yup.T)[:3]
        scale = 1 / np.tan(lens["yfov"] / 2)
        pixels = np.c_[640 + 640 * scale / lens["aspectRatio"] * x / -z, 360 - 360 * scale * y / -z]
        path = estimate.camera.path
        known = scene.camera.model.project((p_world - path.p_world_camera[frame]) @ path.R_world_camera[frame])
        assert (z < 0).all()
        assert np.abs(pixels - known).max() < 1e-2


def test_the_skin_stands_on_the_floor_and_moves_with_the_bones(glb: Glb) -> None:
    estimate = filmed()[1]
    for wearer, one in enumerate(estimate.wearers):
        skeleton = one.motion.skeleton
        corners = glb.array(glb.json["meshes"][wearer]["primitives"][0]["attributes"]["POSITION"])
        assert corners[:, 1].max() == pytest.approx(skeleton.stature, abs=0.02)
        moved = zup(glb.skinned(wearer, 12))
        top = skeleton.landmarks["head_top"]
        state = one.motion.state
        p_top = state.p_world_joint[12, top.bone] + state.R_world_bone[12, top.bone] @ top.p_bone_point
        assert np.linalg.norm(moved - p_top, axis=1).min() < 0.03  # the skull is rounder than a point
        # On either side of a knee that bends the skin hangs together: no corner flies off its bones.
        nearest = np.linalg.norm(moved[:, None] - state.p_world_joint[12], axis=-1).min(axis=1)
        assert nearest.max() < 0.3


def test_triangles_face_outwards(glb: Glb) -> None:
    for primitive in glb.json["meshes"][0]["primitives"]:
        corners = glb.array(primitive["attributes"]["POSITION"])
        normals = glb.array(primitive["attributes"]["NORMAL"])
        a, b, c = (glb.array(primitive["indices"]).reshape(-1, 3)).T
        face = np.cross(corners[b] - corners[a], corners[c] - corners[a])
        outwards = np.einsum("ij,ij->i", face, normals[a] + normals[b] + normals[c]) > 0
        assert outwards.mean() > 0.998  # the rest is folded in the crease between the thighs


def test_another_reader_loads_the_bodies(tmp_path: Path) -> None:
    (path,) = export(filmed()[1], tmp_path / "a.glb")
    scene = trimesh.load_scene(path)
    assert sorted({name.rsplit("_", 1)[0] for name in scene.geometry}) == ["ann body", "bob body"]
    assert path.stat().st_size < 1_200_000


def test_names_and_one_wearer_without_a_camera(tmp_path: Path) -> None:
    (path,) = export(any_pose(), tmp_path / "a.glb", ExportSettings(bone_names=BoneNames.HUMANIK))
    glb = Glb(path)
    assert [glb.names[node] for node in glb.json["skins"][0]["joints"]] == list(bone_names(BoneNames.HUMANIK))
    assert "cameras" not in glb.json or not glb.json["cameras"]


def test_without_blender_there_is_no_fbx(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    monkeypatch.setitem(sys.modules, "bpy", None)
    with pytest.raises(InputError, match="install it so that 'blender' is found"):
        export(any_pose(), tmp_path / "a.fbx")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("number", [np.inf, np.nan])
def test_numbers_that_gltf_cannot_hold_are_refused(number: float) -> None:
    buffer = GltfBuffer()
    buffer.add(np.zeros((2, 3), np.float32), bounds=True)
    with pytest.raises(InputError, match="holds numbers that glTF cannot"):
        buffer.add(np.array([0.0, number], np.float32), bounds=True)


def test_a_lens_of_two_focal_lengths_and_a_camera_that_turns_round(tmp_path: Path) -> None:
    time = np.arange(90) / 30
    path = CameraPath(time, rotation_x(3.0 * time), np.zeros((90, 3)))
    lens = CameraModel(1280, 720, (1000.0, 800.0), (640.0, 360.0))
    estimate = replace(filmed()[1], cameras=(replace(filmed()[1].camera, model=lens, path=path),))
    glb = Glb(export(estimate, tmp_path / "turning.glb")[0])
    perspective = glb.json["cameras"][0]["perspective"]
    assert np.tan(perspective["yfov"] / 2) == pytest.approx(360 / 800)
    assert perspective["aspectRatio"] == pytest.approx((640 / 1000) / (360 / 800))
    node = glb.names.index("phone")
    animation = glb.json["animations"][0]
    (turning,) = (c for c in animation["channels"] if c["target"] == {"node": node, "path": "rotation"})
    q = glb.array(animation["samplers"][turning["sampler"]]["output"])
    assert np.all(np.sum(q[1:] * q[:-1], axis=1) > 0.99)
