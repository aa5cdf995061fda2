"""Clips of foreign skeletons, a table of their nodes by our joints for each family, and our bones' names elsewhere."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array
from vip_factors.io.settings import BoneNames

_TRUNK, _LIMBS = "pelvis spine1 spine2 spine3 neck head", "hip knee ankle foot collar shoulder elbow wrist hand"
_SMPL = f"{_TRUNK} {_LIMBS}".split()
_HUMANIK = "Hips Spine Spine1 Spine2 Neck Head UpLeg Leg Foot ToeBase Shoulder Arm ForeArm Hand HandMiddle1"
_UNITY = (
    "Hips Spine Chest UpperChest Neck Head UpperLeg LowerLeg Foot Toes Shoulder UpperArm LowerArm Hand MiddleProximal"
)
_UNREAL = (
    "pelvis spine_01 spine_02 spine_03 neck_01 head thigh calf foot ball clavicle upperarm lowerarm hand middle_01"
)
_BONE_NAMES = {
    BoneNames.HUMANIK: (_HUMANIK, "{bone}", "{side}{bone}"),
    BoneNames.MIXAMO: (_HUMANIK, "mixamorig:{bone}", "mixamorig:{side}{bone}"),
    BoneNames.UNITY: (_UNITY, "{bone}", "{side}{bone}"),
    BoneNames.UNREAL: (_UNREAL, "{bone}", "{bone}_{letter}"),
}
_LIMBS_NEEDED = [joint for joint in _LIMBS.split() if joint not in ("foot", "collar", "hand")]
REQUIRED = ("pelvis", "neck", *(f"{side}_{joint}" for side in ("left", "right") for joint in _LIMBS_NEEDED))
"""Joints that every source has; human proportions stand in for any other."""


@dataclass(frozen=True)
class SkeletonMap:
    """Family of skeletons.

    Attributes:
        name: of the family.
        joints: our joint → its node, whose position and rotation are taken.
        landmarks: our landmark → its node.
        exact: the rest pose is ours, and no bone direction is corrected.
        straight: the rest pose stands for straight legs (along the shanks) and arms (along the upper arms), although
            the figure's are a little bent.
        settle_s: seconds after a rest pose put before the take during which the converter blends from it.
        arms_turned_deg: turn of the arms' bones about their long axis against ours, whose elbows bend about y.
        bones: our joint → the node whose rotation is taken, where that is another: in a chain that begins at the head,
            the node at a joint has the rotation of the bone below.
        directions: node → direction of its bone when somebody stands, in the file's axes, in files whose bones all
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


def both_sides(table: Mapping[str, str], left_prefix: str = "Left", right_prefix: str = "Right") -> dict[str, str]:
    """Entries of both sides: ``{}`` in a node's name stands for the side."""
    sides = (("left", left_prefix), ("right", right_prefix))
    return {f"{side}_{joint}": node.format(prefix) for joint, node in table.items() for side, prefix in sides}


def _table(joints: str, nodes: str) -> dict[str, str]:
    return dict(zip(joints.split(), nodes.split(), strict=True))


def bone_names(names: BoneNames) -> tuple[str, ...]:
    """Names of the 24 bones, in the order of the joints."""
    if names is BoneNames.SMPL:
        return JOINT_NAMES
    bones, middle, limb = _BONE_NAMES[names]
    bone_of = dict(zip(_SMPL, bones.split(), strict=True))
    return tuple(
        (limb if side else middle).format(bone=bone_of[kind], side=side.capitalize(), letter=side[:1])
        for side, _, kind in (joint.rpartition("_") for joint in JOINT_NAMES)
    )


CGSPEED = SkeletonMap(
    "cgspeed (Daz figures)",
    _table("pelvis spine1 spine2 neck head", "hip abdomen chest neck head")
    | both_sides(_table(_LIMBS, "{}Thigh {}Shin {}Foot {}Foot/end {}Collar {}Shldr {}ForeArm {}Hand {}Mid1"), "l", "r"),
    both_sides({"fingertip": "{}Mid2/end"}, "l", "r"),
    # This figure rests with forearms bent by 17° and knees by 7.6°, and against the CMU originals of subjects 02 and 03
    # (twelve clips) the elbows and knees of all frames are bent by as much more: its rest pose was taken for a T-pose.
    # With straight limbs, knees and the bend of elbows agree within 2° in the mean. With the straight leg along the
    # shank, hips and ankles agree within 5° for subject 02, 8° to 12° for subject 03; upright, 4° to 11° and 1° to 6°.
    straight=True,
    # Elbows of the CMU database, originals and conversions alike, turn about (0.0 … 0.1, 0.87, −0.50) of the upper arm.
    arms_turned_deg=-30.0,
    settle_s=0.1,  # against the CMU originals, the blend (with its overshoot) is over after 0.1 s
)
MVN = SkeletonMap(
    "Xsens MVN",
    _table(_TRUNK, "Hips Chest Chest3 Chest4 Neck Head")
    | both_sides(
        _table(_LIMBS.removesuffix(" hand"), "{}Hip {}Knee {}Ankle {}Toe {}Collar {}Shoulder {}Elbow {}Wrist")
    ),
    {"head_top": "Head/end"} | both_sides({"toe_tip": "{}Toe/end", "fingertip": "{}Wrist/end"}),
)
MOTIONBUILDER = SkeletonMap(
    "MotionBuilder, Mixamo, Vicon",
    dict(zip(JOINT_NAMES, bone_names(BoneNames.HUMANIK), strict=True)),
    {"head_top": "Head/end"} | both_sides({"toe_tip": "{}ToeBase/end"}),
)
SMPL = SkeletonMap(
    "SMPL",
    {name: name for name in JOINT_NAMES},
    {"head_top": "head/end"} | both_sides({"toe_tip": "{}_foot/end", "fingertip": "{}_hand/end"}, "left", "right"),
    exact=True,
)
# SlimeVR's server, versions 0 and 1: its skeleton begins between the eyes, and whoever stands looks along −z.
SLIMEVR = SkeletonMap(
    "SlimeVR",
    _table(_TRUNK, "LEFT_HIP HIP WAIST CHEST UPPER_CHEST NECK")
    | both_sides(
        _table(
            "hip knee ankle foot shoulder elbow wrist",
            "{}_UPPER_LEG {}_LOWER_LEG {}_FOOT {}_FOOT/end {}_UPPER_ARM {}_LOWER_ARM {}_HAND",
        ),
        "LEFT",
        "RIGHT",
    ),
    bones=_table(f"{_TRUNK} left_foot right_foot", "HIP WAIST CHEST UPPER_CHEST NECK HEAD LEFT_FOOT RIGHT_FOOT"),
    directions={
        "HEAD": (0, 0, 1),
        "LEFT_HIP": (-1, 0, 0),
        "RIGHT_HIP": (1, 0, 0),
        "LEFT_FOOT": (0, 0, -1),
        "RIGHT_FOOT": (0, 0, -1),
        "LEFT_SHOULDER": (-0.9, -0.4, 0),
        "RIGHT_SHOULDER": (0.9, -0.4, 0),
    },
)

MAPS = (SMPL, CGSPEED, MVN, MOTIONBUILDER, SLIMEVR)


def find_map(names: tuple[str, ...], path: str) -> SkeletonMap:
    """The family that a skeleton belongs to, its entries narrowed to the nodes that are there, spelled as there.

    Case and a name space before a colon (``mixamorig:Hips``) do not matter.

    Raises:
        InputError: if no family fits; the message names the missing joints of the nearest one.
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
        name: of the clip.
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


UNITY_BONES: Mapping[str, str] = {
    joint: bone
    for joint, bone in zip(JOINT_NAMES, bone_names(BoneNames.UNITY), strict=True)
    if not joint.endswith("_hand")  # rigid with the wrists, whose bones are Unity's hands
}
"""Our joints by the names of Unity's ``HumanBodyBones``, but for the hand bones."""
