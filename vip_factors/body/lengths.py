"""The lengths that make a body, both sides alike, and the skeleton that they make.

Stature is their sum from the sole to the top of the head (:data:`STATURE`), so a Gaussian over them knows what a taller
trunk takes from the legs. How the spine divides and curves and where collar bones begin no length says: those fractions
are ours, placed so that a standing person looks right.
"""

import numpy as np

from vip_factors.body.skeleton import JOINT_COUNT, Landmark, Skeleton, joint_index
from vip_factors.geometry.rotations import Array

# Changes of these move joints; all in metres at rest, widths between both sides' joints.
LENGTHS = (
    "hip width",
    "hip height",  # of the hips over the pelvis joint, negative
    "hip depth",  # of the hips before it
    "trunk",  # rise from the pelvis joint to the neck
    "neck",  # rise from the neck to the head joint
    "neck height",  # over where the curve of the spine has it
    "neck depth",  # of the neck before spine3
    "shoulder width",
    "shoulder height",  # over spine3
    "shoulder depth",  # before the collar joint
    "upper arm",
    "forearm",
    "wrist height",  # over the line that is taken for a straight forearm
    "wrist depth",  # before it
    "hand",  # wrist to knuckles
    "thigh",
    "shank",
    "ankle depth",  # before the line that is taken for a straight shank
    "foot",  # ankle to ball
)
# These only move landmarks.
BODY_LENGTHS = (*LENGTHS, "ankle height", "head top")
# Stature is this row times the body's lengths.
_UP = {
    "ankle height": 1,
    "shank": 1,
    "thigh": 1,
    "hip height": -1,
    "trunk": 1,
    "neck height": 1,
    "neck": 1,
    "head top": 1,
}
STATURE = np.array([float(_UP.get(name, 0)) for name in BODY_LENGTHS])

# The pelvis joint and the spine's: (fraction of the way up from hips to neck, fraction of stature forward).
TRUNK = {"pelvis": (0.13, 0.0), "spine1": (0.33, -0.012), "spine2": (0.55, -0.010), "spine3": (0.66, 0.000)}
SPINE = ("spine1", "spine2", "spine3", "neck")
_LEVELS = np.array([level for level, _ in TRUNK.values()] + [1.0])
SPINE_SHARES = np.diff(_LEVELS) / (1 - TRUNK["pelvis"][0])  # of the trunk's rise, by joint of the spine
# Fractions of stature.
LEGS = 0.489  # thigh and shank, of the prior's mean over men and women
NECK_DEPTH, HEAD_DEPTH, SHOULDER_DEPTH = -0.010, 0.022, -0.010
COLLAR_WIDTH, COLLAR_DEPTH, COLLAR_DROP = 0.030, 0.005, 0.006  # the drop: below the shoulder
BALL_HEIGHT = 0.012
FOOT_BALL, FOOT_ANKLE = 0.73, 0.25  # along the foot from the heel: metatarsal heads and ankle
HAND_KNUCKLES = 0.45  # of the hand's length, from the wrist
HEAD_JOINT = 0.375  # of the way up from the neck to the top of the head


def skeleton_of_lengths(lengths: Array, source: str) -> Skeleton:
    """The skeleton of a body's lengths.

    Args:
        lengths: ``(21,)`` metres, the :data:`BODY_LENGTHS`.
        source: one line saying where they come from.
    """
    of = dict(zip(BODY_LENGTHS, np.asarray(lengths, float).tolist(), strict=True))
    stature = float(STATURE @ lengths)
    ball = BALL_HEIGHT * stature - of["ankle height"]
    foot = np.sqrt(max(of["foot"] ** 2 - ball**2, (0.5 * of["foot"]) ** 2))
    collar = of["shoulder height"] - COLLAR_DROP * stature
    depths = np.diff([depth * stature for _, depth in TRUNK.values()])
    at = {
        name: (0.0, share * of["trunk"], depth)
        for name, share, depth in zip(SPINE, SPINE_SHARES, [*depths, of["neck depth"]], strict=True)
    }
    at |= {"pelvis": (0.0, 0.0, 0.0), "head": (0.0, of["neck"], HEAD_DEPTH * stature)}
    at["neck"] = (0.0, at["neck"][1] + of["neck height"], at["neck"][2])
    for side, x in (("left", 1.0), ("right", -1.0)):
        at |= {
            f"{side}_hip": (x * of["hip width"] / 2, of["hip height"], of["hip depth"]),
            f"{side}_knee": (0.0, -of["thigh"], 0.0),
            f"{side}_ankle": (0.0, -of["shank"], of["ankle depth"]),
            f"{side}_foot": (0.0, ball, float(foot)),
            f"{side}_collar": (x * COLLAR_WIDTH * stature, collar, COLLAR_DEPTH * stature),
            f"{side}_shoulder": (
                x * (of["shoulder width"] / 2 - COLLAR_WIDTH * stature),
                COLLAR_DROP * stature,
                of["shoulder depth"],
            ),
            f"{side}_elbow": (x * of["upper arm"], 0.0, 0.0),
            f"{side}_wrist": (x * of["forearm"], of["wrist height"], of["wrist depth"]),
            f"{side}_hand": (x * of["hand"], 0.0, 0.0),
        }
    offsets = np.zeros((JOINT_COUNT, 3))
    for name, offset in at.items():
        offsets[joint_index(name)] = offset
    return Skeleton(offsets, _landmarks(offsets, of), source)


def _landmarks(offsets: Array, of: dict[str, float]) -> dict[str, Landmark]:
    points = {"head_top": Landmark(joint_index("head"), np.array([0.0, of["head top"], 0.0]))}
    for side, x in (("left", 1.0), ("right", -1.0)):
        ankle, ball, hand = (joint_index(f"{side}_{name}") for name in ("ankle", "foot", "hand"))
        whole = offsets[ball, 2] / (FOOT_BALL - FOOT_ANKLE)
        sole = -of["ankle height"] - offsets[ball, 1]  # below the ball joint
        tip = of["hand"] * (1 - HAND_KNUCKLES) / HAND_KNUCKLES
        points[f"{side}_heel"] = Landmark(ankle, np.array([0.0, -of["ankle height"], -FOOT_ANKLE * whole]))
        points[f"{side}_toe_tip"] = Landmark(ball, np.array([0.0, sole, (1 - FOOT_BALL) * whole]))
        points[f"{side}_fingertip"] = Landmark(hand, np.array([x * tip, 0.0, 0.0]))
    return points


def stature_of(skeleton: Skeleton) -> float:
    """Stature in metres, or from the leg's length where a skeleton has no landmarks."""
    if {"head_top", "left_heel"} <= set(skeleton.landmarks):
        return skeleton.stature
    thigh, shank = skeleton.bone_length("left_knee"), skeleton.bone_length("left_ankle")
    return (thigh + shank) / LEGS
