"""Rest poses and bone axes that animation programs expect of a skeleton, by the names of its bones."""

from dataclasses import dataclass

import numpy as np

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.kinematics import forward_kinematics, local_rotations
from vip_factors.body.lengths import stature_of
from vip_factors.body.skeleton import JOINT_COUNT, JOINT_NAMES, PARENTS, Skeleton
from vip_factors.geometry.rotations import Array, exp, rotation_between
from vip_factors.io.settings import BoneNames

# The landmark at the free end of each last bone. The heels have none: they lie on bones that go on.
END_SITES = {
    "head": "head_top",
    **{
        f"{side}_{bone}": f"{side}_{end}"
        for side in ("left", "right")
        for bone, end in (("hand", "fingertip"), ("foot", "toe_tip"))
    },
}
_NEXT = {"pelvis": "spine1", "spine3": "neck"}  # of bones with several below, the one that they lead to
_DIRECTIONS = {"L": (1, 0, 0), "R": (-1, 0, 0), "U": (0, 1, 0), "D": (0, -1, 0), "F": (0, 0, 1), "B": (0, 0, -1)}
_MIRROR = np.diag([-1.0, 1.0, 1.0])

# Where x, y and z of left bones and the trunk's point in the T-pose: left, up, forward, or right, down, back.
_ARM = ("collar", "shoulder", "elbow", "wrist", "hand")
_MIXAMO = {"hip": "RDF", "knee": "RDF", "ankle": "RFU", "foot": "RFU"} | dict.fromkeys(_ARM, "BLD")  # of its X Bot
_UNREAL = dict.fromkeys(_ARM, "LBU") | {"wrist": "LDB", "hand": "LDB", "foot": "FUR"}  # of version 4's mannequin
# Rotation vectors in degrees from there to the mannequin's reference pose, an A-pose.
_UNREAL_TURNS = {
    "spine1": (7.4, 0, 0), "spine2": (-6.7, 0, 0), "spine3": (-9.5, 0, 0), "neck": (14.0, 0, 0),
    "collar": (-2.3, 26.5, -9.6), "shoulder": (0.3, 4.6, -49.6), "elbow": (-18.2, -21.1, -38.9),
    "wrist": (-5.0, -26.6, -38.2), "hand": (-5.0, -26.6, -38.2), "hip": (1.2, 8.4, 7.1), "knee": (8.9, 3.3, 4.4),
    "ankle": (0.7, 2.6, 0.9), "foot": (2.6, 2.6, 0.8),
}  # fmt: skip
_LIMBS = ("shoulder", "elbow", "wrist", "hand", "hip", "knee")


@dataclass(frozen=True)
class RestPose:
    """A skeleton at rest, in body axes: x to the left, y up, z forward.

    Attributes:
        R_body_bone: our bones ``(24, 3, 3)``: identity in the T-pose.
        p_body_joint: ``(24, 3)`` metres, the pelvis at the origin.
        R_bone_axes: the program's axes of each bone in ours ``(24, 3, 3)``.
    """

    R_body_bone: Array
    p_body_joint: Array
    R_bone_axes: Array


def rest_pose(skeleton: Skeleton, names: BoneNames) -> RestPose:
    """The rest pose of the program whose bones have these names.

    Unreal's mannequin rests in an A-pose, and x points along its bones. All others rest in a T-pose, and y points along
    each bone, turned about it as Mixamo's; Mixamo's trunk is upright. What differs between the mannequin's trunk,
    collars and feet and a wearer's is shape, which its axes take up; differences between limbs are the pose.
    """
    is_unreal, is_trunk_upright = names is BoneNames.UNREAL, names in (BoneNames.HUMANIK, BoneNames.MIXAMO)
    R, axes = np.tile(np.eye(3), (2, JOINT_COUNT, 1, 1))
    for joint, name in enumerate(JOINT_NAMES):
        side, _, kind = name.rpartition("_")
        letters = _UNREAL.get(kind, "UBR") if is_unreal else _MIXAMO.get(kind, "LUF")
        directions = np.transpose([_DIRECTIONS[letter] for letter in letters])
        turn = exp(np.deg2rad(_UNREAL_TURNS.get(kind, (0.0, 0.0, 0.0)))) if is_unreal else np.eye(3)
        if side == "right":
            directions = -_MIRROR @ directions if is_unreal else _MIRROR @ directions @ _MIRROR
            turn = _MIRROR @ turn @ _MIRROR
        if kind in _LIMBS:
            R[joint], axes[joint] = turn, directions
        else:
            axes[joint] = turn @ directions
        if not is_unreal and (side or not is_trunk_upright):
            axes[joint] = rotation_between(directions[:, 1], _end(skeleton, joint)) @ directions
    state = forward_kinematics(skeleton, local_rotations(R[None]), np.zeros((1, 3)))
    return RestPose(R, state.p_world_joint[0], axes)


def _end(skeleton: Skeleton, joint: int) -> Array:
    """The far end of a bone ``(3,)``, from its joint."""
    name = JOINT_NAMES[joint]
    if name in END_SITES:
        return end_site(skeleton, name)
    return skeleton.p_parent_joint[JOINT_NAMES.index(_NEXT[name]) if name in _NEXT else PARENTS.index(joint)]


def end_site(skeleton: Skeleton, name: str) -> Array:
    """The free end of a last bone ``(3,)``; of a skeleton without that landmark, as with people of that stature."""
    landmark = END_SITES[name]
    point = skeleton.landmarks.get(landmark) or skeleton_from_stature(stature_of(skeleton)).landmarks[landmark]
    return point.p_bone_point
