"""What is set of exported files. Apart from what uses it: the command line shows it without NumPy."""

from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

from vip_factors.ranges import MaybeRate


class BoneNames(StrEnum):
    """What the bones of an animation are called."""

    SMPL = "smpl"
    HUMANIK = "humanik"
    MIXAMO = "mixamo"
    UNITY = "unity"
    UNREAL = "unreal"


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
        """How many of the unit make a metre."""
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
    """Names of the bones in .bvh, .glb and .fbx: smpl (pelvis, left_hip, …), those of all other files of this package;
    humanik (Hips, LeftUpLeg, …), which MotionBuilder and retargeting add-ons map by themselves; mixamo (the same
    after mixamorig:), unity (its Humanoid's), unreal (its mannequins': thigh_l, …)."""
    bvh: BvhSettings = field(default_factory=BvhSettings)
