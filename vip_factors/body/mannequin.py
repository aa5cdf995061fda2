"""The body as something to look at: tapered segments along the bones, coloured by side."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from vip_factors.body.lengths import stature_of
from vip_factors.body.skeleton import JOINT_NAMES, Skeleton, joint_index
from vip_factors.geometry.rotations import Array


class Side(StrEnum):
    """Which side of the wearer a segment belongs to."""

    LEFT = "left"
    RIGHT = "right"
    MIDDLE = "middle"


Colour = tuple[int, int, int]
"""Red, green, blue, 0-255."""

# Orange and blue stay apart for every common kind of colour blindness; grey is nobody's side.
ESTIMATE_COLOURS: dict[Side, Colour] = {
    Side.LEFT: (232, 128, 72),
    Side.RIGHT: (64, 128, 196),
    Side.MIDDLE: (104, 116, 134),
}
TRUTH_COLOUR: Colour = (176, 180, 186)
SENSOR_COLOUR: Colour = (246, 222, 120)  # pale yellow: seen against both limbs and background


def side_of(bone: int) -> Side:
    """The side of a limb's bone; the collars belong to the trunk."""
    first, _, joint = JOINT_NAMES[bone].partition("_")
    return Side(first) if first in ("left", "right") and joint != "collar" else Side.MIDDLE


def part_of(bone: int) -> str:
    """The larger piece of the body that a bone belongs to: ``head``, ``trunk``, ``left_arm``, ``right_leg`` …"""
    first, _, joint = JOINT_NAMES[bone].partition("_")
    if side_of(bone) is Side.MIDDLE:
        return "head" if first in ("neck", "head") else "trunk"
    return f"{first}_{'arm' if joint in ('shoulder', 'elbow', 'wrist', 'hand') else 'leg'}"


@dataclass(frozen=True)
class Segment:
    """A rounded, tapered piece of the body, fixed to one bone.

    Attributes:
        bone: index of the bone it moves with.
        p_bone_start, p_bone_end: ``(3,)`` metres, centres of its two round ends in the bone's frame.
        radius_start, radius_end: metres.
    """

    bone: int
    p_bone_start: Array
    p_bone_end: Array
    radius_start: float
    radius_end: float

    @property
    def side(self) -> Side:
        """Of the wearer."""
        return side_of(self.bone)

    @property
    def part(self) -> str:
        """The larger piece of the body that it belongs to."""
        return part_of(self.bone)


# Bone, far end (a joint or a landmark), radii at both ends as fractions of stature. They are there to be looked at:
# close to the girths of a slim adult, and with gaps at the joints small enough to read as one body.
_MIDDLE_SHAPE = (
    ("pelvis", "left_hip", 0.052, 0.046), ("pelvis", "right_hip", 0.052, 0.046), ("pelvis", "spine1", 0.056, 0.052),
    ("spine1", "spine2", 0.052, 0.054), ("spine2", "spine3", 0.054, 0.056), ("spine3", "left_collar", 0.050, 0.036),
    ("spine3", "right_collar", 0.050, 0.036), ("spine3", "neck", 0.048, 0.028), ("neck", "head", 0.026, 0.026),
    ("head", "head_top", 0.036, 0.042),
)  # fmt: skip
_LIMB_SHAPE = (
    ("collar", "shoulder", 0.032, 0.029), ("shoulder", "elbow", 0.028, 0.021), ("elbow", "wrist", 0.021, 0.014),
    ("wrist", "hand", 0.013, 0.015), ("hand", "fingertip", 0.014, 0.008), ("hip", "knee", 0.045, 0.029),
    ("knee", "ankle", 0.028, 0.018), ("ankle", "foot", 0.020, 0.015), ("ankle", "heel", 0.020, 0.016),
    ("foot", "toe_tip", 0.015, 0.011),
)  # fmt: skip


def mannequin(skeleton: Skeleton) -> tuple[Segment, ...]:
    """The segments of a body; ends that this skeleton does not know (no landmarks) are left out."""
    stature = stature_of(skeleton)
    shape = [*_MIDDLE_SHAPE]
    for side in ("left", "right"):
        shape += [(f"{side}_{bone}", f"{side}_{end}", start, stop) for bone, end, start, stop in _LIMB_SHAPE]
    segments = []
    for bone, end, start_radius, end_radius in shape:
        p_bone_end = _far_end(skeleton, end)
        if p_bone_end is None:
            continue
        start_radius, end_radius = start_radius * stature, end_radius * stature
        p_bone_start = np.zeros(3)
        if end == "head_top":  # the crown touches the landmark; the cranium begins at the chin, not at the joint
            p_bone_start = 0.25 * p_bone_end
        if end in ("head_top", "heel", "toe_tip", "fingertip"):
            p_bone_end = _shortened(p_bone_end, end_radius)
        segments.append(Segment(joint_index(bone), p_bone_start, p_bone_end, start_radius, end_radius))
    return tuple(segments)


def _far_end(skeleton: Skeleton, end: str) -> Array | None:
    if end in JOINT_NAMES:
        return skeleton.p_parent_joint[joint_index(end)]
    landmark = skeleton.landmarks.get(end)
    return None if landmark is None else landmark.p_bone_point


def _shortened(p: Array, by: float) -> Array:
    """Pull an end back by the radius of its cap, so that the skin and not the cap's centre lies on the landmark."""
    length = float(np.linalg.norm(p))
    return p * max(length - by, 0.0) / length if length > 0 else p
