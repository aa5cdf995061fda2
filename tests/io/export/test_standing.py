"""Whoever stands on z = 0 in an estimate stands on the floor of the program that reads the file, whatever its axes.

The programs themselves, Blender (``bpy``) and OpenSim (``opensim``), read the files where they are installed.
"""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from test_animation import Glb, joints_in
from test_tables import read_c3d, read_mot, read_trc

from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import joint_index
from vip_factors.estimate import Estimate, WearerEstimate
from vip_factors.io.export.files import export
from vip_factors.simulate.gestures import gestures

pytestmark = pytest.mark.filterwarnings("ignore:No analog data found")
FRAMES = range(0, 46, 3)
OFF_M = 0.025  # of the lowest point from the floor: balls lie over it, toes hang below them, skin is round


@cache
def walker() -> Motion:
    """Somebody who walks on z = 0."""
    return gestures(3.0, rate=15.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("standing")
    for suffix in ("bvh", "glb", "trc", "mot", "c3d"):
        export(_estimate(), folder / f"a.{suffix}")
    return folder


def _estimate() -> Estimate:
    return Estimate("walk", "VIP", (WearerEstimate("Ada", "VIP", walker(), {}),))


def test_files_have_their_lowest_point_at_their_zero(folder: Path) -> None:
    glb = Glb(folder / "a.glb")
    skin = np.array([glb.skinned(0, frame)[:, 1].min() for frame in FRAMES])
    _, _, markers = read_trc(folder / "a.trc")
    points = {name: p for name, p in read_c3d(folder / "a.c3d")[1].items() if not name.endswith("Angles")}
    lowest = {
        "bvh": joints_in(folder / "a.bvh")[FRAMES, :, 1].min(axis=1),
        "glb": skin,
        "trc": np.min([p[FRAMES, 1] for p in markers.values()], axis=0),
        "c3d": np.min([p[FRAMES, 2] for p in points.values()], axis=0) / 1000,
    }
    for name, height in lowest.items():
        assert np.abs(height).max() < OFF_M, name


def test_opensims_pelvis_is_a_legs_length_above_its_ground(folder: Path) -> None:
    motion, table = walker(), read_mot(folder / "a.mot")
    hips = motion.state.p_world_joint[:, [joint_index("left_hip"), joint_index("right_hip")], 2].mean(axis=1)
    over = table["pelvis_ty"] - hips  # the model's origin is at the iliac crests' foremost points
    assert np.all((over > 0.05) & (over < 0.12))


@pytest.mark.programs
def test_blender_shows_the_body_on_its_floor(folder: Path) -> None:
    bpy = pytest.importorskip("bpy")
    export(_estimate(), folder / "a.fbx")
    readers = {
        "bvh": bpy.ops.import_anim.bvh, "glb": bpy.ops.import_scene.gltf, "fbx": bpy.ops.import_scene.fbx,
    }  # fmt: skip
    for name, read in readers.items():
        bpy.ops.wm.read_factory_settings(use_empty=True)
        scene = bpy.context.scene
        scene.render.fps = 15
        read(filepath=str(folder / f"a.{name}"))
        first = 0 if name == "glb" else 1
        lowest = []
        for frame in FRAMES:
            scene.frame_set(frame + first)
            lowest.append(min(_heights(bpy, name)))
        assert np.abs(lowest).max() < OFF_M, name


def _heights(bpy, name: str) -> list[float]:  # type: ignore[no-untyped-def]
    """World z of the bones' heads, or of the mesh's corners, as Blender draws them now."""
    if name == "bvh":
        (armature,) = (object for object in bpy.data.objects if object.type == "ARMATURE")
        return [(armature.matrix_world @ bone.head).z for bone in armature.pose.bones]
    body = next(object for object in bpy.data.objects if object.type == "MESH" and object.name.startswith("Ada"))
    drawn = body.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return [(drawn.matrix_world @ corner.co).z for corner in drawn.data.vertices]


@pytest.mark.programs
def test_opensim_reads_the_soles_at_its_ground(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)  # where it writes its log
    opensim = pytest.importorskip("opensim")
    markers = opensim.MarkerData(str(folder / "a.trc"))
    assert markers.getUnits().getLabel() == "meters"
    lowest = [
        min(markers.getFrame(frame).getMarker(one)[1] for one in range(markers.getNumMarkers())) for frame in FRAMES
    ]
    assert np.abs(lowest).max() < OFF_M
    coordinates = opensim.Storage(str(folder / "a.mot"))
    assert coordinates.isInDegrees()
    assert coordinates.getSize() == len(walker())
