"""Files for animation programs: BVH; binary glTF 2.0 with skinned bodies and cameras; and FBX, which has no other open
writer than Blender, run without a window on the glTF file.
"""

import importlib.util
import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from vip_factors import __version__
from vip_factors.body.body_mesh import body_mesh
from vip_factors.body.mannequin import ESTIMATE_COLOURS, Side, side_of
from vip_factors.body.skeleton import JOINT_COUNT, JOINT_NAMES, PARENTS, Skeleton
from vip_factors.errors import InputError
from vip_factors.estimate import CameraEstimate, Estimate, WearerEstimate
from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.quaternions import continuous as continuous_quaternions
from vip_factors.geometry.rotations import Array, continuous, sequence_of_rotation
from vip_factors.io.export.animation_poses import end_site, planted, rest_pose
from vip_factors.io.export.files import R_YUP_WORLD
from vip_factors.io.motions.skeleton_maps import bone_names
from vip_factors.io.settings import BoneNames, ExportSettings, LengthUnit, UpAxis

_IN_BLENDER = """
import json, bpy
work = json.loads(WORK)
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.context.scene.render.fps = work["rate"]
bpy.ops.import_scene.gltf(filepath=work["source"])
for bone in [bone for bone in bpy.data.objects if bone.name.startswith("Icosphere")]:  # the importer's picture of one
    bpy.data.objects.remove(bone)
for mesh in [mesh for mesh in bpy.data.objects if mesh.type == "MESH"]:
    mesh.parent = None  # Unreal takes an armature that has other children for a bone
bpy.context.scene.unit_settings.scale_length = 0.01  # the numbers are centimetres: no bone is scaled
bpy.context.scene.frame_start, bpy.context.scene.frame_end = 0, work["frames"] - 1
bpy.ops.export_scene.fbx(
    filepath=work["target"], object_types={"ARMATURE", "MESH", "CAMERA", "EMPTY"}, add_leaf_bones=False,
    bake_anim_use_all_actions=False, bake_anim_use_nla_strips=False, bake_anim_simplify_factor=0.0,
)
"""
TURNS = "Zrotation Xrotation Yrotation"
NUMBER = "%.6f"  # of metres or degrees: together they move no joint by more than a hundredth of a millimetre


def write_bvh(estimate: Estimate, path: Path, settings: ExportSettings) -> None:
    """Write one wearer's motion, with axes, unit and names as the settings have them.

    At rest the body stands in a T-pose with its pelvis at the origin, facing z (y up) or −y (z up).
    """
    motion = estimate.wearers[0].motion
    if settings.plant_feet:
        motion = planted(motion)
    R_file_world = R_YUP_WORLD if settings.bvh.up is UpAxis.Y else np.eye(3)
    R_rest = R_YUP_WORLD.T @ R_file_world  # turns the T-pose upright, and with it the axes that bones turn about
    R_parent_child = R_rest @ motion.R_parent_child @ R_rest.T
    R_parent_child[:, 0] = R_file_world @ motion.R_parent_child[:, 0] @ R_rest.T
    angles = np.rad2deg(continuous(sequence_of_rotation(R_parent_child[:, _depth_first()], "zxy")))
    unit = settings.bvh.unit.per_metre
    frames = np.column_stack([unit * motion.p_world_pelvis @ R_file_world.T, angles.reshape(len(motion), -1)])
    with path.open("w", encoding="ascii", newline="\n") as file:
        lines = _hierarchy(motion.skeleton, unit * R_rest, bone_names(settings.bone_names))
        file.writelines(f"{line}\n" for line in ("HIERARCHY", *lines))
        file.write(f"MOTION\nFrames: {len(motion)}\nFrame Time: {1 / motion.rate:.15g}\n")
        np.savetxt(file, frames, NUMBER)


def _depth_first(joint: int = 0) -> list[int]:
    """The joint and all below it, in the order of the hierarchy and of the numbers of a frame."""
    return [joint, *(below for child in _children(joint) for below in _depth_first(child))]


def _children(joint: int) -> list[int]:
    return [child for child, parent in enumerate(PARENTS) if parent == joint]


def _hierarchy(
    skeleton: Skeleton, file_from_rest: Array, names: tuple[str, ...], joint: int = 0, depth: int = 0
) -> Iterator[str]:
    indent = depth * "\t"
    yield f"{indent}{'JOINT' if joint else 'ROOT'} {names[joint]}"
    yield f"{indent}{{"
    yield f"{indent}\tOFFSET {_numbers(file_from_rest @ skeleton.p_parent_joint[joint])}"
    yield f"{indent}\tCHANNELS " + (f"3 {TURNS}" if joint else f"6 Xposition Yposition Zposition {TURNS}")
    for child in _children(joint):
        yield from _hierarchy(skeleton, file_from_rest, names, child, depth + 1)
    if not _children(joint):
        offset = _numbers(file_from_rest @ end_site(skeleton, JOINT_NAMES[joint]))
        yield from (f"{indent}\tEnd Site", f"{indent}\t{{", f"{indent}\t\tOFFSET {offset}", f"{indent}\t}}")
    yield f"{indent}}}"


def _numbers(vector: Array) -> str:
    return " ".join(NUMBER % value for value in vector + 0.0)  # no negative zero


STILL = 1e-7  # a turn or shift by less (rad or m, nearly) needs no keys: the precision of a float32
R_CAMERA_GLTF = np.diag([1.0, -1.0, -1.0])  # glTF's cameras have y up and look along −z


def write_gltf(estimate: Estimate, path: Path, settings: ExportSettings, unit: LengthUnit = LengthUnit.METRES) -> None:
    """Write all wearers and cameras into one file, with one animation.

    Rest pose and axes of the bones are those of the program that their names come from (:func:`rest_pose`). A camera
    has its vertical field of view and aspect; a principal point off the image's middle and distortion have no place in
    the format. glTF counts in metres; another unit is for a program that reads the numbers as they are.
    """
    file = _Scene(estimate.wearers[0].motion.start, unit.per_metre)
    for wearer in estimate.wearers:
        moving = replace(wearer, motion=planted(wearer.motion)) if settings.plant_feet else wearer
        file.add_wearer(moving, settings.bone_names)
    for camera in estimate.cameras:
        file.add_camera(camera)
    path.write_bytes(file.to_bytes())


class _Scene:
    """Builder of a glTF scene; ``start`` is the animation's first instant, ``unit`` the number of units in a metre."""

    def __init__(self, start: float, unit: float) -> None:
        import pygltflib

        self._lib: Any = pygltflib
        self._start, self._unit, self._buffer = start, unit, GltfBuffer()
        self._gltf: Any = pygltflib.GLTF2(
            asset=pygltflib.Asset(version="2.0", generator=f"vip-factors {__version__}"),
            scene=0,
            scenes=[pygltflib.Scene(nodes=[])],
            materials=[_material(pygltflib, side) for side in Side],
        )
        self._motion = pygltflib.Animation(name="motion", channels=[], samplers=[])

    def add_wearer(self, estimate: WearerEstimate, names: BoneNames) -> None:
        """Add a node that holds the bones, with the wearer's name, and one with the body's mesh.

        Unreal's skeletons begin on the floor, with a bone whose z points up; its importer takes the node above for
        Blender's, and leaves it out, if it has the name of Blender's armatures.
        """
        gltf, motion, is_rooted = self._gltf, estimate.motion, names is BoneNames.UNREAL
        pose = rest_pose(motion.skeleton, names)
        p, normal = body_mesh(motion.skeleton).posed(pose.R_body_bone, pose.p_body_joint)
        lift = np.array([0.0, -p[:, 1].min(), 0.0])
        R_bind, p_bind = pose.R_body_bone @ pose.R_bone_axes, pose.p_body_joint + lift
        holder = self._node(name="Armature" if is_rooted else estimate.name, children=[len(gltf.nodes) + 1])
        joints = [len(gltf.nodes) + joint for joint in range(JOINT_COUNT)]
        R_file_world = R_YUP_WORLD
        if is_rooted:
            joints = [joint + 1 for joint in joints]
            root = self._node(name="root", children=joints[:1], rotation=_quaternions(R_YUP_WORLD[None])[0].tolist())
            R_bind, p_bind = np.concatenate([R_bind, R_YUP_WORLD[None]]), np.concatenate([p_bind, np.zeros((1, 3))])
            R_file_world = np.eye(3)
        R_parent_axes = np.concatenate([np.eye(3)[None], pose.R_bone_axes[list(PARENTS[1:])]])
        offsets = self._unit * np.einsum("nji,nj->ni", R_parent_axes, motion.skeleton.p_parent_joint)
        for joint, name in enumerate(bone_names(names)):
            children = [joints[child] for child in _children(joint)]
            self._node(name=name, children=children, translation=offsets[joint].tolist())
        mesh = self._mesh(motion.skeleton, p + lift, normal, estimate.name)
        skin = self._skin(R_bind, p_bind, [*joints, root] if is_rooted else joints, holder)
        body = self._node(name=f"{estimate.name} body", mesh=mesh, skin=skin)
        gltf.scenes[0].nodes += [holder, body]

        times = self._times(motion.time)
        R = motion.R_parent_child.copy()
        R[:, 0] = R_file_world @ R[:, 0]
        R = np.swapaxes(R_parent_axes, 1, 2) @ R @ pose.R_bone_axes
        self._animate(joints[0], "translation", times, self._unit * motion.p_world_pelvis @ R_file_world.T)
        for joint, node in enumerate(joints):
            self._animate(node, "rotation", times, _quaternions(R[:, joint]))

    def add_camera(self, camera: CameraEstimate) -> None:
        """Add a node with the camera's name, which moves if the camera does."""
        lib, model = self._lib, camera.model
        yfov = 2 * np.arctan2(model.height / 2, model.focal[1])
        aspect = (model.width / model.focal[0]) / (model.height / model.focal[1])
        lens = lib.Perspective(yfov=float(yfov), aspectRatio=float(aspect), znear=0.05)
        self._gltf.cameras.append(lib.Camera(name=camera.name, type="perspective", perspective=lens))
        node = self._node(name=camera.name, camera=len(self._gltf.cameras) - 1)
        self._gltf.scenes[0].nodes.append(node)
        path = camera.path
        times = self._times(path.time) if len(path) > 1 else None
        self._animate(node, "translation", times, self._unit * path.p_world_camera @ R_YUP_WORLD.T)
        self._animate(node, "rotation", times, _quaternions(R_YUP_WORLD @ path.R_world_camera @ R_CAMERA_GLTF))

    def to_bytes(self) -> bytes:
        """The bytes of the file."""
        gltf, buffer = self._gltf, self._buffer
        if self._motion.channels:
            gltf.animations = [self._motion]
        gltf.accessors, gltf.bufferViews = buffer.accessors, buffer.views
        gltf.buffers = [self._lib.Buffer(byteLength=len(buffer.data))]
        gltf.set_binary_blob(bytes(buffer.data))
        return b"".join(gltf.save_to_bytes())

    def _node(self, **properties: Any) -> int:
        self._gltf.nodes.append(self._lib.Node(**properties))
        return len(self._gltf.nodes) - 1

    def _times(self, time: Array) -> int:
        return self._buffer.add((time - self._start).astype(np.float32), bounds=True)

    def _animate(self, node: int, path: str, times: int | None, values: Array) -> None:
        """Set a node's first value, and add a channel to the animation if it changes."""
        setattr(self._gltf.nodes[node], path, values[0].tolist())
        if times is None or np.abs(values - values[0]).max() < STILL:
            return
        lib, motion = self._lib, self._motion
        output = self._buffer.add(values.astype(np.float32))
        motion.samplers.append(lib.AnimationSampler(input=times, output=output, interpolation="LINEAR"))
        target = lib.AnimationChannelTarget(node=node, path=path)
        motion.channels.append(lib.AnimationChannel(sampler=len(motion.samplers) - 1, target=target))

    def _mesh(self, skeleton: Skeleton, p: Array, normal: Array, name: str) -> int:
        lib, add, body = self._lib, self._buffer.add, body_mesh(skeleton)
        bones, shares = body.four_bones()
        attributes = lib.Attributes(
            POSITION=add((self._unit * p).astype(np.float32), CORNERS, bounds=True),
            NORMAL=add(normal.astype(np.float32), CORNERS),
            JOINTS_0=add(bones, CORNERS),
            WEIGHTS_0=add(shares, CORNERS, unit=True),
        )
        side_of_bone = np.array([[*Side].index(side_of(bone)) for bone in range(JOINT_COUNT)])
        of_sides = body.weights @ np.eye(len(Side))[side_of_bone]
        side_of_triangle = np.argmax(of_sides[body.faces].sum(axis=1), axis=1)
        faces = body.faces.astype(np.uint16 if len(p) < 65535 else np.uint32)
        primitives = [
            lib.Primitive(
                attributes=attributes, indices=add(faces[side_of_triangle == side].ravel(), INDICES), material=side
            )
            for side in range(len(Side))
        ]
        self._gltf.meshes.append(lib.Mesh(name=f"{name} body", primitives=primitives))
        return len(self._gltf.meshes) - 1

    def _skin(self, R: Array, p: Array, joints: list[int], holder: int) -> int:
        """Bones bound at ``(n, 3, 3)`` and ``(n, 3)`` metres; those beyond the body's have no share of the mesh."""
        inverse = np.broadcast_to(np.eye(4), (len(joints), 4, 4)).copy()  # columns in rows
        inverse[:, :3, :3] = R
        inverse[:, 3, :3] = -self._unit * np.einsum("nji,nj->ni", R, p)
        matrices = self._buffer.add(inverse.astype(np.float32))
        self._gltf.skins.append(self._lib.Skin(joints=joints, inverseBindMatrices=matrices, skeleton=holder))
        return len(self._gltf.skins) - 1


def _quaternions(R: Array) -> Array:
    """Quaternions ``(T, 4)``, w last, without changes of sign: viewers blend the numbers."""
    return continuous_quaternions(quaternion_from_matrix(R, Order.XYZW))


def _material(lib: Any, side: Side) -> Any:
    """The side's colour, in the linear shares that glTF counts in."""
    share = np.array(ESTIMATE_COLOURS[side]) / 255
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    surface = lib.PbrMetallicRoughness(
        baseColorFactor=[*np.round(linear, 4).tolist(), 1.0], metallicFactor=0.0, roughnessFactor=0.8
    )
    return lib.Material(name=side.value, pbrMetallicRoughness=surface, alphaCutoff=None)


_COMPONENTS = {"float32": 5126, "uint8": 5121, "uint16": 5123, "uint32": 5125}
_KINDS = {(): "SCALAR", (3,): "VEC3", (4,): "VEC4", (4, 4): "MAT4"}
CORNERS, INDICES = 34962, 34963  # targets of arrays in a graphics card


class GltfBuffer:
    """Buffer of arrays with their accessors and views, as pygltflib has them."""

    def __init__(self) -> None:
        self.accessors: list[Any] = []
        self.views: list[Any] = []
        self.data = bytearray()

    def add(self, values: np.ndarray, target: int | None = None, bounds: bool = False, unit: bool = False) -> int:
        """Add an array ``(n, …)`` of float32, uint8, uint16 or uint32 and return the number of its accessor.

        Matrices have their columns in rows. ``target`` is :data:`CORNERS` or :data:`INDICES`. ``bounds`` states least
        and greatest values, as positions and times need. With ``unit``, integers are fractions of their greatest value.
        """
        from pygltflib import Accessor, BufferView

        values = np.ascontiguousarray(values)
        if values.dtype.kind == "f" and not np.all(np.isfinite(values)):
            raise InputError("the estimate holds numbers that glTF cannot (not finite, or above 3e38): is it damaged?")
        self.views.append(BufferView(buffer=0, byteOffset=len(self.data), byteLength=values.nbytes, target=target))
        self.data += values.tobytes()
        self.data += bytes(-len(self.data) % 4)
        flat = values.reshape(len(values), -1)
        self.accessors.append(
            Accessor(
                bufferView=len(self.views) - 1,
                componentType=_COMPONENTS[values.dtype.name],
                count=len(values),
                type=_KINDS[values.shape[1:]],
                normalized=unit,
                min=flat.min(axis=0).tolist() if bounds else None,
                max=flat.max(axis=0).tolist() if bounds else None,
            )
        )
        return len(self.accessors) - 1


def write_fbx(estimate: Estimate, path: Path, settings: ExportSettings) -> None:
    """Write skins, bones and camera of all wearers, one key a frame, at a whole number of frames a second."""
    blender = shutil.which("blender")
    if blender is None and importlib.util.find_spec("bpy") is None:
        raise InputError(
            "FBX is written by Blender, which is not there: install it so that 'blender' is found, or export .glb, "
            "which most programs read"
        )
    motion = estimate.wearers[0].motion
    with tempfile.TemporaryDirectory() as folder:
        source, target, script = (Path(folder) / name for name in ("a.glb", "a.fbx", "script.py"))
        write_gltf(estimate, source, settings, LengthUnit.CENTIMETRES)
        rate = max(round(motion.rate), 1)
        work = {"source": str(source), "target": str(target), "rate": rate, "frames": len(motion)}
        script.write_text(f"WORK = {json.dumps(work)!r}\n{_IN_BLENDER}", encoding="utf-8")
        program = [sys.executable] if blender is None else [blender, "--background", "--factory-startup", "--python"]
        done = subprocess.run([*program, str(script)], capture_output=True, text=True, check=False)
        if not target.exists():
            raise InputError(f"Blender wrote no FBX file: {(done.stderr or done.stdout).strip()[-300:]}")
        shutil.move(target, path)
