"""What may be chosen of an exported file, whatever its format; names of bones, and the turn to a world with Y up."""

from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

from vip_factors.body.joint_angles import R_WORLD_ISB
from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.ranges import MaybeRate


class BoneNames(StrEnum):
    """What the bones of an animation are called."""

    SMPL = "smpl"
    HUMANIK = "humanik"


class UpAxis(StrEnum):
    """Which axis of a file points up."""

    Y = "y"
    Z = "z"


class LengthUnit(StrEnum):
    """What one unit of length in a file is."""

    METRES = "m"
    CENTIMETRES = "cm"

    @property
    def per_metre(self) -> float:
        """Units in a metre."""
        return {LengthUnit.METRES: 1.0, LengthUnit.CENTIMETRES: 100.0}[self]


@dataclass(frozen=True)
class BvhSettings:
    """Axes and unit of a BVH file, which cannot say them itself."""

    up: UpAxis = UpAxis.Y
    """Axis that points up: y is what Blender's importer and most programs take a BVH file for; with z the numbers are
    those of the estimate's world (in Blender, choose Forward Y and Up Z then)."""
    unit: LengthUnit = LengthUnit.METRES
    """Unit of length: metres come out in true size in Blender; Maya and MotionBuilder expect centimetres."""


@dataclass(frozen=True)
class ExportSettings:
    """How an estimate is written into a format of another program."""

    wearer: str | None = None
    """Export this wearer only, by name; of a format that holds one person, each wearer gets a file of its own."""
    frame_rate: MaybeRate = None
    """Frames a second of the file; those of the estimate if absent, for then no frame is interpolated."""
    recording: Path | None = None
    """Recording (.mcap) that the estimate was made from: a .pkl takes its 2D poses and the times of the video frames
    from it; no other format needs it."""
    bone_names: BoneNames = BoneNames.SMPL
    """Names of the bones in .bvh and .glb: smpl (pelvis, left_hip, …), those of all other files of this package, or
    humanik (Hips, LeftUpLeg, …) which MotionBuilder, Mixamo, Unity and retargeting add-ons map by themselves."""
    bvh: BvhSettings = field(default_factory=BvhSettings)


R_YUP_WORLD = R_WORLD_ISB.T
"""x stays, z becomes y, y becomes -z: what Blender and glTF do. At rest a body then faces z, its left along x."""


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
