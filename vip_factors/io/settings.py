"""What is set of live sources and sinks, and of exported files. Apart from what uses it: the command line shows it
without NumPy.
"""

from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

from vip_factors.ranges import MaybeRate, check_ranges


class SentPose(StrEnum):
    """Which pose is sent: that of the newest frame, or the one a lag earlier that changes no more."""

    NEWEST = "newest"
    SMOOTHED = "smoothed"


@dataclass(frozen=True)
class LiveSourceSettings:
    """Limits of a live source.

    Attributes:
        queue_limit: samples that wait for the tracker before some are dropped.
        growth_wait: seconds that a file may take to appear, and without growth after which it counts as finished.
        next_client_wait: seconds that a server waits for another client after one whose samples were used has gone;
            infinite: until Ctrl-C.
    """

    # Two wearers of 13 sensors at 100 Hz send 2,600 a second: a start-up of a second and a half loses nothing.
    queue_limit: int = 4096
    # Recorders flush several times a second; a minute of slack for the operating system would only delay the end.
    growth_wait: float = 10.0
    next_client_wait: float = float("inf")

    def __post_init__(self) -> None:
        check_ranges(self, "limits.")


DEFAULT = LiveSourceSettings()


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
