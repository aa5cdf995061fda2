"""Mannequin for drawings: tapered segments on the bones, coloured by side."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from vip_factors.body.lengths import stature_of
from vip_factors.body.skeleton import JOINT_NAMES, Skeleton, joint_index
from vip_factors.geometry.rotations import Array


class Side(StrEnum):
    """Side of the wearer that a segment belongs to."""

    LEFT = "left"
    RIGHT = "right"
    MIDDLE = "middle"


Colour = tuple[int, int, int]
"""Red, green, blue, 0-255."""

# Orange and blue differ for every common kind of colour blindness.
ESTIMATE_COLOURS: dict[Side, Colour] = {
    Side.LEFT: (232, 128, 72),
    Side.RIGHT: (64, 128, 196),
    Side.MIDDLE: (104, 116, 134),
}
TRUTH_COLOUR: Colour = (176, 180, 186)
SENSOR_COLOUR: Colour = (246, 222, 120)  # pale yellow: visible on limbs and background


def side_of(bone: int) -> Side:
    """Return the side of a limb's bone; collars belong to the trunk."""
    side, _, joint = JOINT_NAMES[bone].partition("_")
    return Side(side) if side in ("left", "right") and joint != "collar" else Side.MIDDLE


@dataclass(frozen=True)
class Segment:
    """Tapered capsule fixed to one bone: centres ``(3,)`` of its ends in the bone's frame and their radii, metres."""

    bone: int
    p_bone_start: Array
    p_bone_end: Array
    radius_start: float
    radius_end: float


Point = tuple[float, float, float, float]
"""Share of the way to a row's far end, then an offset (to the wearer's left, up, forward) in thousandths of stature."""


@dataclass(frozen=True)
class _Row:
    """Proportions of one segment; radii in thousandths of stature.

    ``end`` is the joint or landmark that the shares of ``start`` and ``stop`` refer to. If ``capped``, the far end is
    shortened by its radius, so that the skin lies on the landmark.
    """

    bone: str
    end: str
    radii: tuple[float, float]
    start: Point = (0, 0, 0, 0)
    stop: Point = (1, 0, 0, 0)
    capped: bool = False


# Close to the girths of a slim adult. Every joint is the far end of a segment.
_MIDDLE = (
    _Row("head", "head_top", (42, 43), (0.55, 0, 0, 15), (1, 0, 0, -13), capped=True),  # cranium
    _Row("head", "head_top", (37, 27), (0.45, 0, 0, 20), (-0.06, 0, 0, 26)),  # face and chin
    _Row("head", "head_top", (38, 32), (0.50, 0, 0, -12), (0.10, 0, 0, -4)),  # back of the head
    _Row("head", "head_top", (5, 7), (0.42, 0, 0, 54), (0.24, 0, 0, 57)),  # nose
    _Row("neck", "head", (30, 29), (0, 0, 0, -2)),
    _Row("neck", "head", (28, 26), (0, 0, -12, 0), (0.75, 0, 0, -6)),
    _Row("spine3", "neck", (48, 31), (0.2, 0, 0, 6)),
    _Row("spine2", "spine3", (50, 50), (0, 0, 0, 8)),
    _Row("spine1", "spine2", (50, 50), (0, 0, 0, 10)),
    _Row("pelvis", "spine1", (52, 50), (0, 0, 0, 0)),
)  # fmt: skip
_FINGERS = tuple(
    row
    # Reach and beginning in shares of the hand, lateral offset, and radius.
    for reach, begin, offset, radius in (
        (0.90, 0.0, 15, 5.6), (1.0, 0.0, 2, 5.8), (0.93, -0.03, -11, 5.5), (0.74, -0.12, -21, 4.9),
    )
    for row in (
        _Row("hand", "fingertip", (radius + 1.6, radius + 0.4), (begin, 0, 0, offset), (0.5 * reach, 0, 3, offset)),
        _Row("hand", "fingertip", (radius + 0.4, radius - 0.8), (0.5 * reach, 0, 3, offset), (reach, 0, -3, offset),
             capped=True),
    )
)  # fmt: skip
# Left side; the right one is mirrored.
_SIDES = (
    _Row("spine3", "neck", (44, 43), (-0.62, 31, 0, 12), (0.28, 40, 0, 4)),  # ribs
    _Row("spine3", "neck", (30, 33), (0.12, 20, 0, 38), (0.22, 44, 0, 30)),  # breast
    _Row("spine3", "neck", (30, 29), (0.42, 44, 0, -22), (-0.35, 32, 0, -18)),  # shoulder blade
    _Row("spine3", "neck", (22, 22), (0.95, 8, 0, -4), (0.50, 68, 0, -4)),  # trapezius
    _Row("spine3", "collar", (34, 34)),
    _Row("spine2", "spine3", (44, 45), (0, 27, 0, 10), (1, 32, 0, 8)),
    _Row("spine1", "spine2", (45, 44), (-0.3, 29, 0, 10), (1, 27, 0, 8)),  # waist
    _Row("pelvis", "hip", (48, 47), (0, 30, 18, 2), (0.35, 30, 0, 4)),  # crest
    _Row("pelvis", "hip", (50, 49), (0.45, 0, 0, 2)),
    _Row("pelvis", "hip", (44, 42), (0.75, -8, 8, -22), (1.05, -8, 0, -28)),  # buttock
    _Row("hip", "knee", (49, 28)),
    _Row("hip", "knee", (43, 30), (0.12, 0, 0, 5), (0.70, 0, 0, 4)),  # front of the thigh
    _Row("knee", "ankle", (28, 19)),
    _Row("knee", "ankle", (24, 28), (0.05, 0, 0, -4), (0.28, 0, 0, -12)),  # calf
    _Row("knee", "ankle", (28, 17), (0.30, 0, 0, -12), (0.90, 0, 0, -3)),
    _Row("ankle", "foot", (20, 12)),
    _Row("ankle", "heel", (19, 17), (0, 0, 4, 0), (1, 0, 17, 22)),
    _Row("ankle", "foot", (17, 12), (0.30, 6, -14, 0), (1, 17, 0, -4)),  # outer edge
    _Row("ankle", "foot", (19, 13), (0.30, -4, -6, 0), (1, -12, 1, 2)),  # inner edge
    _Row("foot", "toe_tip", (12, 9), (0, 0, 0, 0), (1, 2, 9, -10)),
    _Row("foot", "toe_tip", (13, 10), (0, -12, 1, 2), (1, -9, 10, -9)),  # big toe
    _Row("foot", "toe_tip", (12, 9), (0, 17, 0, -4), (0.72, 14, 8, -8)),
    _Row("collar", "shoulder", (33, 32)),
    _Row("collar", "shoulder", (34, 30), (0.15, 0, -18, 14), (0.95, 0, -12, 6)),  # front of the armpit
    _Row("collar", "shoulder", (32, 30), (0.15, 0, -20, -10), (0.95, 0, -12, -8)),  # back of it
    _Row("shoulder", "elbow", (32, 22)),
    _Row("shoulder", "elbow", (26, 22), (0.18, 0, -3, 0), (0.62, 0, 0, 4)),
    _Row("elbow", "wrist", (22, 15)),
    _Row("elbow", "wrist", (20, 18), (0.12, 0, 0, 3), (0.50, 0, 0, 2)),
    _Row("wrist", "hand", (13, 9.0)),  # palm, whose thickness is up and down in the T-pose
    _Row("wrist", "hand", (10, 8.6), (0.15, 0, 0, 8), (0.98, 0, 0, 15)),
    _Row("wrist", "hand", (9.5, 8.6), (0.20, 0, 0, -7), (0.94, 0, 0, -12)),
    _Row("wrist", "hand", (8.5, 7.8), (0.22, 0, -1, -9), (0.86, 0, -1, -20)),
    _Row("wrist", "hand", (11, 8), (0.18, 0, -4, 10), (0.62, 0, -10, 22)),  # thumb
    _Row("wrist", "hand", (7.6, 5.6), (0.62, 0, -10, 22), (1.10, 0, -14, 27)),
    *_FINGERS,
)  # fmt: skip


def mannequin(skeleton: Skeleton) -> tuple[Segment, ...]:
    """Make the segments of a body; segments whose landmarks the skeleton lacks are left out."""
    stature = stature_of(skeleton)
    segments = [_segment(row, skeleton, stature, "", 1.0) for row in _MIDDLE]
    for side, sign in (("left_", 1.0), ("right_", -1.0)):
        segments += [_segment(row, skeleton, stature, side, sign) for row in _SIDES]
    return tuple(segment for segment in segments if segment is not None)


def _segment(row: _Row, skeleton: Skeleton, stature: float, side: str, sign: float) -> Segment | None:
    bone = row.bone if row.bone in JOINT_NAMES else side + row.bone
    end_name = row.end if row.end in (*JOINT_NAMES, "head_top") else side + row.end
    if end_name in JOINT_NAMES:
        end = skeleton.p_parent_joint[joint_index(end_name)]
    elif end_name in skeleton.landmarks:
        end = skeleton.landmarks[end_name].p_bone_point
    else:
        return None
    start, stop = (
        share * end + 1e-3 * stature * np.array([sign * leftward, up, forward])
        for share, leftward, up, forward in (row.start, row.stop)
    )
    radius_start, radius_stop = (1e-3 * stature * radius for radius in row.radii)
    if row.capped:
        length = float(np.linalg.norm(end))
        stop = stop - end * min(radius_stop / length, 1.0) if length > 0 else stop
    return Segment(joint_index(bone), start, stop, radius_start, radius_stop)
