"""The body's skin cut into rigid pieces, one a bone: Rerun moves them with the bones, so each is logged but once."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr

from vip_factors.body.body_mesh import BodyMesh, body_mesh
from vip_factors.body.kinematics import forward_kinematics
from vip_factors.body.mannequin import Colour, Side, side_of
from vip_factors.body.skeleton import JOINT_NAMES, Skeleton, joint_index
from vip_factors.geometry.rotations import Array, rotation_z

GHOST_ALPHA, GLASS_ALPHA = 110, 70  # of 255
ARMS_DOWN = 0.95  # radians from the T-pose, where the skin is cut: between arms that hang and arms held out
LAPPED = 0.3  # of a triangle's movement: pieces reach over joints, so that none gapes when it bends
MESHES = 8  # that are kept: making one takes some tenths of a second
_CUT: dict[bytes, "CutSkin"] = {}


@dataclass(frozen=True)
class CutSkin:
    """A mesh, and by bone the triangles that move with it.

    Attributes:
        p_cut, normal: ``(V, 3)`` vertices (metres) and normals in the pose in which it is cut.
        R_cut_bone, p_cut_bone: ``(24, 3, 3)`` and ``(24, 3)`` poses of the bones there.
        once, lapped: by bone ``(F, 3)`` vertices of its triangles: each triangle once, or reaching over joints.
    """

    mesh: BodyMesh
    p_cut: Array
    normal: Array
    R_cut_bone: Array
    p_cut_bone: Array
    once: Sequence[np.ndarray]
    lapped: Sequence[np.ndarray]


def cut_skin(skeleton: Skeleton) -> CutSkin:
    """The skin of a skeleton; those of the last few bodies are kept."""
    points = [one.p_bone_point for one in skeleton.landmarks.values()]
    key = b"".join(np.asarray(one, dtype=float).tobytes() for one in (skeleton.p_parent_joint, *points))
    if key not in _CUT:
        while len(_CUT) >= MESHES:
            del _CUT[next(iter(_CUT))]
        mesh = body_mesh(skeleton)
        shares = mesh.weights[mesh.faces].mean(axis=1)
        most = np.argmax(shares, axis=1)
        bones = range(len(JOINT_NAMES))
        once = [mesh.faces[most == bone] for bone in bones]
        lapped = [mesh.faces[(most == bone) | (shares[:, bone] > LAPPED)] for bone in bones]
        R, p = _pose(skeleton)
        _CUT[key] = CutSkin(mesh, *mesh.posed(R, p), R, p, once, lapped)
    return _CUT[key]


def _pose(skeleton: Skeleton) -> tuple[Array, Array]:
    """Poses of the bones ``(24, 3, 3)``, ``(24, 3)`` where the skin is cut, half way between common poses."""
    R = np.tile(np.eye(3), (1, len(JOINT_NAMES), 1, 1))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        R[0, joint_index(f"{side}_shoulder")] = rotation_z(-sign * ARMS_DOWN)
    state = forward_kinematics(skeleton, R, np.zeros((1, 3)))
    return state.R_world_bone[0], state.p_world_joint[0]


def log_shape(
    stream: rr.RecordingStream, entity: str, skeleton: Skeleton, colours: Mapping[Side, Colour], *, ghost: bool = False
) -> None:
    """Log the skin that moves with the bones below ``entity``, for ever.

    Args:
        stream: where to.
        entity: of the body; its bones are below it.
        skeleton: the body.
        colours: by side.
        ghost: see-through, for what something else is compared with.
    """
    skin = cut_skin(skeleton)
    tones = np.array([colours[side_of(bone)] for bone in range(len(JOINT_NAMES))], np.uint8)[skin.mesh.bone]
    # Where pieces overlap a see-through body would be darker.
    for bone, triangles in enumerate(skin.once if ghost else skin.lapped):
        if not len(triangles):
            continue
        used, faces = np.unique(triangles, return_inverse=True)
        R = skin.R_cut_bone[bone]
        shape = rr.Mesh3D(
            vertex_positions=((skin.p_cut[used] - skin.p_cut_bone[bone]) @ R).astype(np.float32),
            vertex_normals=(skin.normal[used] @ R).astype(np.float32),
            vertex_colors=tones[used],
            triangle_indices=faces.reshape(-1, 3).astype(np.uint32),
            albedo_factor=(255, 255, 255, GHOST_ALPHA if ghost else 255),
        )
        stream.log(f"{entity}/{JOINT_NAMES[bone]}", shape, static=True)


def see_through(entity: str) -> dict[str, rr.Mesh3D]:
    """Overrides for a view in which the body below ``entity`` must not hide what is behind it."""
    glass = rr.Mesh3D.from_fields(albedo_factor=(255, 255, 255, GLASS_ALPHA))
    return {f"{entity}/{name}": glass for name in JOINT_NAMES}
