"""FBX, a format whose only open writer is Blender's: the glTF file, read and written there without a window."""

import importlib.util
import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from vip_factors.errors import InputError
from vip_factors.estimate import Estimate
from vip_factors.io.export.animation import write_gltf
from vip_factors.io.export.settings import ExportSettings

_IN_BLENDER = """
import json, bpy
work = json.loads(WORK)
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.context.scene.render.fps = work["rate"]
bpy.ops.import_scene.gltf(filepath=work["source"])
for one in [one for one in bpy.data.objects if one.name.startswith("Icosphere")]:  # the importer's picture of a bone
    bpy.data.objects.remove(one)
bpy.context.scene.frame_start, bpy.context.scene.frame_end = 0, work["frames"] - 1
bpy.ops.export_scene.fbx(
    filepath=work["target"], object_types={"ARMATURE", "MESH", "CAMERA", "EMPTY"}, add_leaf_bones=False,
    bake_anim_use_all_actions=False, bake_anim_use_nla_strips=False, bake_anim_simplify_factor=0.0,
)
"""


def write_fbx(estimate: Estimate, path: Path, settings: ExportSettings) -> None:
    """Skins, bones and camera of all wearers in one file, one key a frame, at a whole number of frames a second.

    Raises:
        InputError: without Blender, or if it fails.
    """
    blender = shutil.which("blender")
    if blender is None and importlib.util.find_spec("bpy") is None:
        raise InputError(
            "FBX is written by Blender, which is not there: install it so that 'blender' is found, or "
            " its Python module, pip install bpy; or export .glb, which most programs read"
        )
    motion = estimate.wearers[0].motion
    with tempfile.TemporaryDirectory() as folder:
        source, target, script = (Path(folder) / name for name in ("a.glb", "a.fbx", "script.py"))
        write_gltf(estimate, source, settings)
        work = {
            "source": str(source), "target": str(target), "rate": max(round(motion.rate), 1), "frames": len(motion),
        }  # fmt: skip
        script.write_text(f"WORK = {json.dumps(work)!r}\n{_IN_BLENDER}", encoding="utf-8")
        program = [sys.executable] if blender is None else [blender, "--background", "--factory-startup", "--python"]
        done = subprocess.run([*program, str(script)], capture_output=True, text=True, check=False)
        if not target.exists():
            raise InputError(f"Blender wrote no FBX file: {(done.stderr or done.stdout).strip()[-300:]}")
        shutil.move(target, path)
