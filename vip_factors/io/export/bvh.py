"""BVH: the wearer's own skeleton with its T-pose as rest pose, and the angles of every frame."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.lengths import stature_of
from vip_factors.body.skeleton import JOINT_NAMES, PARENTS, Skeleton
from vip_factors.estimate import Estimate
from vip_factors.geometry.rotations import Array, continuous, sequence_of_rotation
from vip_factors.io.export.settings import R_YUP_WORLD, ExportSettings, UpAxis, bone_names

TURNS = "Zrotation Xrotation Yrotation"
NUMBER = "%.6f"  # of metres or degrees: together they move no joint by more than a hundredth of a millimetre

# The landmark at the free end of each last bone. The heels have none: they lie on bones that go on.
END_SITES = {
    "head": "head_top",
    **{
        f"{side}_{bone}": f"{side}_{end}"
        for side in ("left", "right")
        for bone, end in (("hand", "fingertip"), ("foot", "toe_tip"))
    },
}


def write_bvh(estimate: Estimate, path: Path, settings: ExportSettings) -> None:
    """Write one wearer's motion, with axes, unit and names as the settings have them.

    At rest the body stands in a T-pose with its pelvis at the origin, facing z (y up) or −y (z up).
    """
    motion = estimate.wearers[0].motion
    R_parent_child = motion.R_parent_child.copy()
    if settings.bvh.up is UpAxis.Y:
        p_file_pelvis = motion.p_world_pelvis @ R_YUP_WORLD.T
        R_parent_child[:, 0] = R_YUP_WORLD @ R_parent_child[:, 0]
        R_rest = np.eye(3)
    else:  # the rest pose is turned upright, and with it the axes that bones turn about
        p_file_pelvis = motion.p_world_pelvis
        R_rest = R_YUP_WORLD.T
        R_parent_child[:, 1:] = R_rest @ R_parent_child[:, 1:] @ R_rest.T
        R_parent_child[:, 0] = R_parent_child[:, 0] @ R_rest.T
    angles = np.rad2deg(continuous(sequence_of_rotation(R_parent_child[:, _depth_first()], "zxy")))
    unit = settings.bvh.unit.per_metre
    frames = np.column_stack([unit * p_file_pelvis, angles.reshape(len(motion), -1)])
    with path.open("w", encoding="ascii", newline="\n") as file:
        lines = _hierarchy(motion.skeleton, unit * R_rest, bone_names(settings.bone_names))
        file.writelines(f"{line}\n" for line in ("HIERARCHY", *lines))
        file.write(f"MOTION\nFrames: {len(motion)}\nFrame Time: {1 / motion.rate:.15g}\n")
        np.savetxt(file, frames, NUMBER)


def _depth_first(joint: int = 0) -> list[int]:
    """The joint and all below it in the order in which the hierarchy, and with it every frame, tells them."""
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
        offset = _numbers(file_from_rest @ _end(skeleton, END_SITES[JOINT_NAMES[joint]]))
        yield from (f"{indent}\tEnd Site", f"{indent}\t{{", f"{indent}\t\tOFFSET {offset}", f"{indent}\t}}")
    yield f"{indent}}}"


def _end(skeleton: Skeleton, landmark: str) -> Array:
    """Where a last bone ends; of a skeleton that does not know it, as with people of that stature."""
    known = skeleton.landmarks.get(landmark) or skeleton_from_stature(stature_of(skeleton)).landmarks[landmark]
    return known.p_bone_point


def _numbers(vector: Array) -> str:
    return " ".join(NUMBER % value for value in vector + 0.0)  # no negative zero
