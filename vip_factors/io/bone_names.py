"""Names of the 24 bones in other programs: what retargeting tools map by themselves."""

from collections.abc import Mapping

from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.io.export.settings import BoneNames

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


def bone_names(names: BoneNames) -> tuple[str, ...]:
    """Of the 24 bones, in the order of the joints."""
    if names is BoneNames.SMPL:
        return JOINT_NAMES
    bones, middle, limb = _BY_NAMES[names]
    theirs = dict(zip(_SMPL, bones, strict=True))
    found = []
    for joint in JOINT_NAMES:
        side, _, ours = joint.rpartition("_")
        pattern = limb if side else middle
        found.append(pattern.format(bone=theirs[ours], side=side.capitalize(), letter=side[:1]))
    return tuple(found)


UNITY_BONES: Mapping[str, str] = {
    joint: bone
    for joint, bone in zip(JOINT_NAMES, bone_names(BoneNames.UNITY), strict=True)
    if not joint.endswith("_hand")  # stiff with the wrists; Unity's hands are what hangs at our wrists
}
"""Our joints by the names of Unity's ``HumanBodyBones``, but for the hand bones."""
