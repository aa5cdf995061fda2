"""Lengths of a person that somebody measured: of which of the body's lengths they tell, and the sides' differences."""

from collections.abc import Mapping

import numpy as np

from vip_factors.body.lengths import BODY_LENGTHS
from vip_factors.body.skeleton import Skeleton, joint_index
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array

# By what people call a segment: the joint at its far end.
SEGMENT_ENDS = {
    "thigh": "knee", "shank": "ankle", "upper_arm": "elbow", "forearm": "wrist", "foot": "foot", "hand": "hand",
}  # fmt: skip
# What is measured without sides, as a sum of the body's lengths.
WHOLE = {
    "hip_width": {"hip width": 1.0},
    "shoulder_width": {"shoulder width": 1.0},
    "trunk": {"trunk": 1.0, "hip height": -1.0},
}
LENGTH_RANGE_M = (0.02, 1.2)


def measured_lengths(measured: Mapping[str, float]) -> tuple[list[tuple[Array, float]], dict[str, float]]:
    """What measured lengths tell of a body whose sides are alike, and how the sides differ from it.

    Returns:
        Rows ``(17,)`` of the body's lengths with the metres they amount to; and by the joint at a limb's end the metres
        that it is longer than the mean of both sides.

    Raises:
        InputError: for an implausible length or an unknown segment.
    """
    sides: dict[str, dict[str, float]] = {}
    rows = []
    low, high = LENGTH_RANGE_M
    for name, metres in sorted(measured.items(), key=lambda one: one[0].startswith(("left_", "right_"))):
        if not low <= metres <= high:
            raise InputError(f"segment length {name} = {metres:g} m: expected metres, between {low:g} and {high:g}")
        if name in WHOLE:
            rows.append((_row(WHOLE[name]), metres))
            continue
        side, _, limb = name.partition("_") if name.startswith(("left_", "right_")) else ("", "", name)
        if limb not in SEGMENT_ENDS:
            known = ", ".join([*SEGMENT_ENDS, *WHOLE])
            raise InputError(f"unknown segment '{name}': expected one of {known}, with left_ or right_ before a limb's")
        # A side's own length comes after both sides', and wins.
        sides.setdefault(limb, {}).update({one: metres for one in ([side] if side else ["left", "right"])})
    halves: dict[str, float] = {}
    for limb, lengths in sides.items():
        mean = float(np.mean(list(lengths.values())))
        rows.append((_row({limb.replace("_", " "): 1.0}), mean))
        halves |= {f"{side}_{SEGMENT_ENDS[limb]}": metres - mean for side, metres in lengths.items()}
    return rows, halves


def apply_sides(skeleton: Skeleton, halves: Mapping[str, float]) -> Skeleton:
    """The skeleton with limbs longer than both sides' mean by metres, by the joint at their end."""
    offsets = skeleton.p_parent_joint.copy()
    for joint, metres in halves.items():
        along = offsets[joint_index(joint)]
        offsets[joint_index(joint)] = along * (1 + metres / np.linalg.norm(along))
    return Skeleton(offsets, skeleton.landmarks, skeleton.source)


def _row(lengths: Mapping[str, float]) -> Array:
    return np.array([lengths.get(name, 0.0) for name in BODY_LENGTHS])
