"""Skeletons of other programs, by their documented rest poses, take up motions of files with their bones' names.

X Bot's axes are those of its bind matrices (left side and trunk). The mannequin's offsets in centimetres and turns
about fixed x, y and z in degrees are those of its reference pose, in a world with y up.
"""

from pathlib import Path

import numpy as np
import pytest
from animated import any_pose, zup
from scipy.spatial.transform import Rotation
from test_animation import Glb

from vip_factors.body.skeleton import joint_index
from vip_factors.geometry.rotations import Array, angle_between
from vip_factors.io.export.animation import write_gltf
from vip_factors.io.export.files import export
from vip_factors.io.settings import BoneNames, ExportSettings, LengthUnit

MANNEQUIN = {
    "root": ("", (0, 0, 0), (-90, 0, 0)),
    "pelvis": ("root", (0, 1.056, 96.751), (90, -89.79, -90)),
    "spine_01": ("pelvis", (10.809, -0.851, 0), (0, 0, -7.154)),
    "spine_02": ("spine_01", (18.875, 3.801, 0), (0, 0, 14.064)),
    "spine_03": ("spine_02", (13.407, 0.42, 0), (0, 0, 2.779)),
    "neck_01": ("spine_03", (16.559, -0.355, 0), (0, 0, -23.508)),
    "head": ("neck_01", (9.284, 0.364, 0), (0, 0, 15.349)),
    "clavicle_l": ("spine_03", (11.884, -2.732, -3.782), (108.719, 61.854, 101.541)),
    "upperarm_l": ("clavicle_l", (15.785, 0, 0), (7.674, 40.3, -17.021)),
    "lowerarm_l": ("upperarm_l", (30.34, 0, 0), (-3.613, -10.397, -30.361)),
    "hand_l": ("lowerarm_l", (26.975, 0, 0), (-76.356, 2.5, -0.413)),
    "thigh_l": ("pelvis", (-1.449, -0.531, -9.006), (8.564, -7.032, -1.516)),
    "calf_l": ("thigh_l", (-42.572, 0, 0), (-5.736, 1.787, -7.614)),
    "foot_l": ("calf_l", (-40.197, 0, 0), (-0.415, 3.705, 8.06)),
    "ball_l": ("foot_l", (-10.454, -16.578, 0.08), (0, 0, -91.884)),
}
X_BOT = {  # x and y of each bone
    "Hips": ((1, 0, 0), (0, 1, 0)),
    "Spine1": ((1, 0, 0), (0, 0.99, -0.15)),
    "Neck": ((1, 0, 0), (0, 0.99, -0.12)),
    "LeftShoulder": ((-0.21, 0.01, -0.98), (0.98, -0.05, -0.21)),
    "LeftForeArm": ((0, 0, -1), (1, 0, 0)),
    "RightArm": ((0, 0, 1), (-1, 0, 0)),
    "RightHand": ((0, 0, 1), (-1, 0, 0)),
    "LeftUpLeg": ((-1, 0, 0), (0, -1, 0)),
    "RightLeg": ((-1, 0, 0), (0, -1, -0.07)),
    "LeftFoot": ((-1, 0, 0), (0, -0.63, 0.78)),
    "RightToeBase": ((-1, 0, 0), (0, 0, 1)),
}


def reference_pose() -> tuple[dict[str, Array], dict[str, Array]]:
    """Rotations and positions (m) of the mannequin's bones in its world; those on the right mirror the left."""
    R, p = {"": np.eye(3)}, {"": np.zeros(3)}
    for name, (parent, offset, turn) in MANNEQUIN.items():
        R[name] = R[parent] @ Rotation.from_euler("xyz", turn, degrees=True).as_matrix()
        p[name] = p[parent] + R[parent] @ np.array(offset) / 100
    mirror = np.diag([-1.0, 1.0, 1.0])
    for name in [name for name in R if name.endswith("_l")]:
        R[f"{name[:-1]}r"], p[f"{name[:-1]}r"] = -mirror @ R[name], mirror @ p[name]
    return R, p


def exported(names: BoneNames, folder: Path) -> tuple[Glb, dict[str, int], dict[str, Array]]:
    """A file, the node of each bone, and how the bones are bound."""
    glb = Glb(export(any_pose(), folder / "a.glb", ExportSettings(bone_names=names, plant_feet=False))[0])
    skin = glb.json["skins"][0]
    inverse = glb.array(skin["inverseBindMatrices"]).reshape(-1, 4, 4)[:, :3, :3]
    nodes = {glb.names[node]: node for node in skin["joints"]}
    return glb, nodes, dict(zip(nodes, inverse, strict=True))


def test_bones_rest_as_the_mannequins_do(tmp_path: Path) -> None:
    glb, nodes, R_bind = exported(BoneNames.UNREAL, tmp_path)
    R, _ = reference_pose()
    for name in R.keys() - {""}:
        assert np.rad2deg(angle_between(R_bind[name], R[name])) < 2.0, name
    parents = {name: glb.names[glb.parents[node]] for name, node in nodes.items()}
    assert parents["root"] == "Armature"  # which Unreal leaves out of its skeleton
    for name, (parent, _, _) in MANNEQUIN.items():
        assert parents[name] == (parent or "Armature")


@pytest.mark.parametrize("names", [BoneNames.MIXAMO, BoneNames.HUMANIK])
def test_bones_are_turned_as_mixamos(names: BoneNames, tmp_path: Path) -> None:
    _, _, R_bind = exported(names, tmp_path)
    prefix = "mixamorig:" if names is BoneNames.MIXAMO else ""
    for name, (x, y) in X_BOT.items():
        R = np.transpose([x, y, np.cross(x, y)])
        slope = 25.0 if name.endswith(("Foot", "ToeBase")) else 12.0  # of a body's own limbs
        assert np.rad2deg(angle_between(R_bind[prefix + name], R)) < slope, name


LIMBS = (("thigh", "hip", "calf", "knee"), ("calf", "knee", "foot", "ankle"),
         ("upperarm", "shoulder", "lowerarm", "elbow"), ("lowerarm", "elbow", "hand", "wrist"))  # fmt: skip


@pytest.mark.parametrize("is_relative", [False, True], ids=["bones' own axes", "relative to the rest pose"])
@pytest.mark.parametrize("side", ["left", "right"])
def test_the_mannequins_limbs_point_where_the_wearers_do(side: str, is_relative: bool, tmp_path: Path) -> None:
    glb, nodes, R_bind = exported(BoneNames.UNREAL, tmp_path)
    p_true = any_pose().wearers[0].motion.state.p_world_joint
    R_rest, p_rest = reference_pose()
    for bone, start, child, end in LIMBS:
        bone, child = f"{bone}_{side[0]}", f"{child}_{side[0]}"
        p_bone_child = R_rest[bone].T @ (p_rest[child] - p_rest[bone])
        for frame in range(len(p_true)):
            R = glb.world(nodes[bone], frame)[:3, :3]
            if is_relative:
                R = R @ R_bind[bone].T @ R_rest[bone]
            limb = zup(R @ p_bone_child)
            true = p_true[frame, joint_index(f"{side}_{end}")] - p_true[frame, joint_index(f"{side}_{start}")]
            cosine = limb @ true / np.linalg.norm(limb) / np.linalg.norm(true)
            assert np.rad2deg(np.arccos(min(cosine, 1.0))) < (0.5 if is_relative else 0.01), bone


def test_centimetres_scale_every_length(tmp_path: Path) -> None:
    for unit in LengthUnit:
        write_gltf(any_pose(), tmp_path / f"{unit}.glb", ExportSettings(), unit)
    metres, centimetres = Glb(tmp_path / "m.glb"), Glb(tmp_path / "cm.glb")
    assert np.allclose(centimetres.skinned(0, 2), 100 * metres.skinned(0, 2), atol=1e-3)
    for node in metres.json["skins"][0]["joints"]:
        assert np.allclose(centimetres.world(node, 3)[:3, 3], 100 * metres.world(node, 3)[:3, 3], atol=1e-3)
