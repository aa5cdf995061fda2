"""A motion as its file tells it, and which node of a foreign skeleton is which joint of ours: a table a family.

And the other way, the names of our 24 bones in other programs: what retargeting tools map by themselves.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array
from vip_factors.io.settings import BoneNames

_SMPL = (
    "pelvis", "spine1", "spine2", "spine3", "neck", "head",
    "hip", "knee", "ankle", "foot", "collar", "shoulder", "elbow", "wrist", "hand",
)  # fmt: skip
_HUMANIK = (
    "Hips", "Spine", "Spine1", "Spine2", "Neck", "Head",
    "UpLeg", "Leg", "Foot", "ToeBase", "Shoulder", "Arm", "ForeArm", "Hand", "HandMiddle1",
)  # fmt: skip
_UNITY = (
    "Hips", "Spine", "Chest", "UpperChest", "Neck", "Head",
    "UpperLeg", "LowerLeg", "Foot", "Toes", "Shoulder", "UpperArm", "LowerArm", "Hand", "MiddleProximal",
)  # fmt: skip
_UNREAL = (
    "pelvis", "spine_01", "spine_02", "spine_03", "neck_01", "head",
    "thigh", "calf", "foot", "ball", "clavicle", "upperarm", "lowerarm", "hand", "middle_01",
)  # fmt: skip
_BY_NAMES = {
    BoneNames.HUMANIK: (_HUMANIK, "{bone}", "{side}{bone}"),
    BoneNames.MIXAMO: (_HUMANIK, "mixamorig:{bone}", "mixamorig:{side}{bone}"),
    BoneNames.UNITY: (_UNITY, "{bone}", "{side}{bone}"),
    BoneNames.UNREAL: (_UNREAL, "{bone}", "{bone}_{letter}"),
}
# Without these there is no body to speak of; any other joint can be filled in from human proportions.
REQUIRED = (
    "pelvis", "neck", "left_hip", "left_knee", "left_ankle", "left_shoulder", "left_elbow", "left_wrist",
    "right_hip", "right_knee", "right_ankle", "right_shoulder", "right_elbow", "right_wrist",
)  # fmt: skip


@dataclass(frozen=True)
class SkeletonMap:
    """One family of skeletons.

    Attributes:
        name: what people call the family.
        joints: our joint → its node, whose position and rotation are taken.
        landmarks: our landmark → its node.
        exact: the rest pose is ours already, so that no bone direction is to be corrected.
        straight: the rest pose stands for straight legs (along the shanks) and arms (along the upper arms), although
            the figure's are a little bent.
        settle_s: seconds after a rest pose put before the take during which the converter blends from it.
        arms_turned_deg: how far the bones of the arms are turned about their long axis against ours, whose elbows bend
            about y: the hinges of a source are lined up with these.
        bones: our joint → the node whose rotation is taken, where that is another: in a chain that begins at the head,
            the node at a joint has the rotation of the bone below.
        directions: node → where its bone points, in the file's axes, when somebody stands, in files that let all bones
            hang down at rest.
    """

    name: str
    joints: Mapping[str, str]
    landmarks: Mapping[str, str] = field(default_factory=dict)
    exact: bool = False
    straight: bool = False
    settle_s: float = 0.0
    arms_turned_deg: float = 0.0
    bones: Mapping[str, str] = field(default_factory=dict)
    directions: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)


# Elbows of the CMU database, originals and conversions alike, turn about (0.0 … 0.1, 0.87, −0.50) of the upper arm:
# over 99.9 % of their turning in every clip looked at.
CMU_ARMS_TURNED_DEG = -30.0


def both_sides(table: Mapping[str, str], left: str, right: str) -> dict[str, str]:
    """Entries of both sides: ``{}`` in a node's name stands for the side."""
    sides = (("left", left), ("right", right))
    return {f"{side}_{joint}": node.format(prefix) for joint, node in table.items() for side, prefix in sides}


CGSPEED = SkeletonMap(
    "cgspeed (Daz figures)",
    {"pelvis": "hip", "spine1": "abdomen", "spine2": "chest", "neck": "neck", "head": "head"}
    | both_sides(
        {
            "hip": "{}Thigh", "knee": "{}Shin", "ankle": "{}Foot", "foot": "{}Foot/end", "collar": "{}Collar",
            "shoulder": "{}Shldr", "elbow": "{}ForeArm", "wrist": "{}Hand", "hand": "{}Mid1",
        }, "l", "r",
    ),
    both_sides({"fingertip": "{}Mid2/end"}, "l", "r"),
    # This figure rests with forearms bent by 17° and knees by 7.6°, and against the CMU originals of subjects 02 and 03
    # (twelve clips) the elbows and knees of all frames are bent by as much more: its rest pose was taken for a T-pose.
    # With limbs taken for straight, knees and the bend of elbows agree within 2° in the mean. Whether the straight leg
    # lies along the shank or upright is less certain. Along the shank, hips and ankles are flexed right within 5°
    # (mostly 2°) for subject 02 but 8° to 12° off, in opposite senses, for subject 03; upright, 4° to 11° and 1° to 6°.
    straight=True,
    arms_turned_deg=CMU_ARMS_TURNED_DEG,
    settle_s=0.1,  # against the CMU originals, the blend (with its overshoot) is over after 0.1 s
)  # fmt: skip

MVN = SkeletonMap(
    "Xsens MVN",
    {
        "pelvis": "Hips", "spine1": "Chest", "spine2": "Chest3", "spine3": "Chest4", "neck": "Neck", "head": "Head",
    } | both_sides(
        {
            "hip": "{}Hip", "knee": "{}Knee", "ankle": "{}Ankle", "foot": "{}Toe", "collar": "{}Collar",
            "shoulder": "{}Shoulder", "elbow": "{}Elbow", "wrist": "{}Wrist",
        }, "Left", "Right",
    ),
    {"head_top": "Head/end"} | both_sides({"toe_tip": "{}Toe/end", "fingertip": "{}Wrist/end"}, "Left", "Right"),
)  # fmt: skip

_ARMS_AND_LEGS = both_sides(
    {
        "hip": "{}UpLeg", "knee": "{}Leg", "ankle": "{}Foot", "foot": "{}ToeBase", "collar": "{}Shoulder",
        "shoulder": "{}Arm", "elbow": "{}ForeArm", "wrist": "{}Hand", "hand": "{}HandMiddle1",
    }, "Left", "Right",
)  # fmt: skip
MOTIONBUILDER = SkeletonMap(
    "MotionBuilder, Mixamo, Vicon",
    {"pelvis": "Hips", "spine1": "Spine", "spine2": "Spine1", "spine3": "Spine2", "neck": "Neck", "head": "Head"}
    | _ARMS_AND_LEGS,
    {"head_top": "Head/end"} | both_sides({"toe_tip": "{}ToeBase/end"}, "Left", "Right"),
)

SMPL = SkeletonMap(
    "SMPL",
    {name: name for name in JOINT_NAMES},
    {"head_top": "head/end"}
    | both_sides({"toe_tip": "{}_foot/end", "fingertip": "{}_hand/end"}, "left", "right"),
    exact=True,
)  # fmt: skip

# SlimeVR's server, versions 0 and 1: its skeleton begins between the eyes, and whoever stands looks along −z.
SLIMEVR = SkeletonMap(
    "SlimeVR",
    {
        "pelvis": "LEFT_HIP", "spine1": "HIP", "spine2": "WAIST", "spine3": "CHEST", "neck": "UPPER_CHEST",
        "head": "NECK",
    } | both_sides(
        {
            "hip": "{}_UPPER_LEG", "knee": "{}_LOWER_LEG", "ankle": "{}_FOOT", "foot": "{}_FOOT/end",
            "shoulder": "{}_UPPER_ARM", "elbow": "{}_LOWER_ARM", "wrist": "{}_HAND",
        }, "LEFT", "RIGHT",
    ),
    bones={
        "pelvis": "HIP", "spine1": "WAIST", "spine2": "CHEST", "spine3": "UPPER_CHEST", "neck": "NECK", "head": "HEAD",
        "left_foot": "LEFT_FOOT", "right_foot": "RIGHT_FOOT",
    },
    directions={
        "HEAD": (0, 0, 1), "LEFT_HIP": (-1, 0, 0), "RIGHT_HIP": (1, 0, 0), "LEFT_FOOT": (0, 0, -1),
        "RIGHT_FOOT": (0, 0, -1), "LEFT_SHOULDER": (-0.9, -0.4, 0), "RIGHT_SHOULDER": (0.9, -0.4, 0),
    },
)  # fmt: skip

MAPS = (SMPL, CGSPEED, MVN, MOTIONBUILDER, SLIMEVR)


def find_map(names: tuple[str, ...], path: str) -> SkeletonMap:
    """The family that a skeleton belongs to, its entries narrowed to the nodes that are there, spelled as there.

    Case and a name space before a colon (``mixamorig:Hips``) do not matter.

    Raises:
        InputError: if no family fits, naming what is missing of the nearest one.
    """
    spelling = {name.rpartition(":")[2].lower(): name for name in reversed(names)}
    missing: dict[str, list[str]] = {}
    for candidate in MAPS:
        joints, landmarks = (
            {key: spelling[node.lower()] for key, node in nodes.items() if node.lower() in spelling}
            for nodes in (candidate.joints, candidate.landmarks)
        )
        missing[candidate.name] = [candidate.joints[joint] for joint in REQUIRED if joint not in joints]
        if not missing[candidate.name]:
            return replace(candidate, joints=joints, landmarks=landmarks)
    nearest = min(missing, key=lambda name: len(missing[name]))
    raise InputError(
        f"{path}: the skeleton ({', '.join(names[:8])}, …) is none of the known families "
        f"({', '.join(missing)}); nearest is {nearest}, which lacks {', '.join(missing[nearest][:5])}: "
        "rename the joints"
    )


@dataclass(frozen=True)
class SourceClip:
    """A foreign skeleton and its poses, in the file's own axes and unit.

    A *node* is a joint, or the free end of a last bone, which is called ``<joint>/end``.

    Attributes:
        names: ``N`` node names.
        parents: index of each node's parent, which precedes it; −1 for the root.
        p_rest: ``(N, 3)`` node positions with all joint rotations at identity.
        R_world_node: ``(T, N, 3, 3)``: how each node's bone has turned from that rest pose.
        p_world_node: ``(T, N, 3)`` node positions.
        rate: frames per second.
        name: what the clip is called.
        path: the file, for messages.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    p_rest: Array
    R_world_node: Array
    p_world_node: Array
    rate: float
    name: str
    path: str

    def __len__(self) -> int:
        return len(self.p_world_node)

    def node(self, name: str) -> int:
        """Index of a node by its exact name."""
        return self.names.index(name)

    def rest(self, name: str) -> Array:
        """Rest position ``(3,)`` of a node."""
        return self.p_rest[self.node(name)]

    def frames(self, selection: slice) -> "SourceClip":
        """The clip at some of its frames (the step must be one)."""
        return replace(self, R_world_node=self.R_world_node[selection], p_world_node=self.p_world_node[selection])


def rest_positions(parents: Sequence[int], offsets: Array) -> Array:
    """Node positions ``(N, 3)`` at rest; a node's parent precedes it, the root's parent is −1."""
    positions = np.zeros_like(offsets)
    for node, parent in enumerate(parents):
        positions[node] = offsets[node] + (positions[parent] if parent >= 0 else 0.0)
    return positions


def source_kinematics(parents: Sequence[int], p_parent_node: Array, R_parent_node: Array) -> tuple[Array, Array]:
    """World rotations ``(T, N, 3, 3)`` and positions ``(T, N, 3)`` of a chain of nodes.

    Args:
        parents: index of each node's parent, which precedes it; −1 for the root.
        p_parent_node: ``(T, N, 3)`` node positions in the parent's frame; the root's in the world.
        R_parent_node: ``(T, N, 3, 3)``.
    """
    R_world = np.empty_like(R_parent_node)
    p_world = np.empty_like(p_parent_node)
    for node, parent in enumerate(parents):
        if parent < 0:
            R_world[:, node], p_world[:, node] = R_parent_node[:, node], p_parent_node[:, node]
            continue
        np.matmul(R_world[:, parent], R_parent_node[:, node], out=R_world[:, node])
        arm = np.einsum("tij,tj->ti", R_world[:, parent], p_parent_node[:, node])
        p_world[:, node] = p_world[:, parent] + arm
    return R_world, p_world


def bone_names(names: BoneNames) -> tuple[str, ...]:
    """Names of the 24 bones, in the order of the joints."""
    if names is BoneNames.SMPL:
        return JOINT_NAMES
    bones, middle, limb = _BY_NAMES[names]
    bone_of = dict(zip(_SMPL, bones, strict=True))
    return tuple(
        (limb if side else middle).format(bone=bone_of[kind], side=side.capitalize(), letter=side[:1])
        for side, _, kind in (joint.rpartition("_") for joint in JOINT_NAMES)
    )


UNITY_BONES: Mapping[str, str] = {
    joint: bone
    for joint, bone in zip(JOINT_NAMES, bone_names(BoneNames.UNITY), strict=True)
    if not joint.endswith("_hand")  # stiff with the wrists; Unity's hands are what hangs at our wrists
}
"""Our joints by the names of Unity's ``HumanBodyBones``, but for the hand bones."""
