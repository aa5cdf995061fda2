"""What the 24 bones are called in files for animators."""

from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.io.export.settings import BoneNames

_HUMANIK_MIDDLE = {
    "pelvis": "Hips", "spine1": "Spine", "spine2": "Spine1", "spine3": "Spine2", "neck": "Neck", "head": "Head",
}  # fmt: skip
_HUMANIK_LIMBS = {
    "hip": "UpLeg", "knee": "Leg", "ankle": "Foot", "foot": "ToeBase", "collar": "Shoulder", "shoulder": "Arm",
    "elbow": "ForeArm", "wrist": "Hand", "hand": "HandMiddle1",
}  # fmt: skip


def bone_names(names: BoneNames) -> tuple[str, ...]:
    """Of the 24 bones, in the order of the joints."""
    return JOINT_NAMES if names is BoneNames.SMPL else tuple(map(_humanik, JOINT_NAMES))


def _humanik(joint: str) -> str:
    side, _, bone = joint.partition("_")
    return f"{side.capitalize()}{_HUMANIK_LIMBS[bone]}" if bone else _HUMANIK_MIDDLE[joint]
