"""Lengths of a symmetric body, the skeleton made from them, and the Gaussian over their changes.

Stature is a sum of lengths from the sole to the top of the head (:data:`STATURE`). The division and curvature of the
spine and the inner ends of the collar bones are fixed fractions of ours. Changes are in metres of the rest pose's
offsets, so that every point of the body is linear in them.
"""

from dataclasses import dataclass

import numpy as np

from vip_factors.body.skeleton import JOINT_COUNT, PARENTS, Landmark, Skeleton, joint_index
from vip_factors.geometry.rotations import Array

# Lengths that move joints; metres at rest, widths between the joints of both sides.
LENGTHS = (
    "hip width",
    "hip height",  # of the hips above the pelvis joint, negative
    "hip depth",  # of the hips in front of it
    "trunk",  # height of the neck above the pelvis joint
    "neck",  # height of the head joint above the neck
    "neck height",  # above the end of the spine's curve
    "neck depth",  # of the neck in front of spine3
    "shoulder width",
    "shoulder height",  # above spine3
    "shoulder depth",  # in front of the collar joint
    "upper arm",
    "forearm",
    "wrist height",  # above the axis of a straight forearm
    "wrist depth",  # in front of it
    "hand",  # wrist to knuckles
    "thigh",
    "shank",
    "ankle depth",  # in front of the axis of a straight shank
    "foot",  # ankle to ball
)
# The last two move only landmarks.
BODY_LENGTHS = (*LENGTHS, "ankle height", "head top")
# Stature is this row times the lengths.
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
SPINE_SHARES = np.diff(_LEVELS) / (1 - TRUNK["pelvis"][0])  # of the trunk's height, by joint of the spine
# Fractions of stature.
LEGS = 0.489  # thigh and shank, of the prior's mean over men and women
NECK_DEPTH, HEAD_DEPTH, SHOULDER_DEPTH = -0.010, 0.022, -0.010
BALL_HEIGHT = 0.012
FOOT_BALL, FOOT_ANKLE = 0.73, 0.25  # along the foot from the heel: metatarsal heads and ankle
HAND_KNUCKLES = 0.45  # of the hand's length, from the wrist
HEAD_JOINT = 0.375  # of the way up from the neck to the top of the head


def skeleton_of_lengths(lengths: Array, source: str) -> Skeleton:
    """Make the skeleton of :data:`BODY_LENGTHS`, ``(21,)`` metres; ``source`` is one line about their origin."""
    collar_width, collar_depth, collar_drop = 0.030, 0.005, 0.006  # the drop: below the shoulder
    of = dict(zip(BODY_LENGTHS, np.asarray(lengths, float).tolist(), strict=True))
    stature = float(STATURE @ lengths)
    ball = BALL_HEIGHT * stature - of["ankle height"]
    foot = np.sqrt(max(of["foot"] ** 2 - ball**2, (0.5 * of["foot"]) ** 2))
    drop, collar = collar_drop * stature, collar_width * stature
    depths = np.diff([depth * stature for _, depth in TRUNK.values()])
    joint_offsets = {
        name: (0.0, share * of["trunk"], depth)
        for name, share, depth in zip(SPINE, SPINE_SHARES, [*depths, of["neck depth"]], strict=True)
    }
    joint_offsets |= {"pelvis": (0.0, 0.0, 0.0), "head": (0.0, of["neck"], HEAD_DEPTH * stature)}
    joint_offsets["neck"] = (0.0, joint_offsets["neck"][1] + of["neck height"], joint_offsets["neck"][2])
    for side, x in (("left", 1.0), ("right", -1.0)):
        joint_offsets |= {
            f"{side}_hip": (x * of["hip width"] / 2, of["hip height"], of["hip depth"]),
            f"{side}_knee": (0.0, -of["thigh"], 0.0),
            f"{side}_ankle": (0.0, -of["shank"], of["ankle depth"]),
            f"{side}_foot": (0.0, ball, float(foot)),
            f"{side}_collar": (x * collar, of["shoulder height"] - drop, collar_depth * stature),
            f"{side}_shoulder": (x * (of["shoulder width"] / 2 - collar), drop, of["shoulder depth"]),
            f"{side}_elbow": (x * of["upper arm"], 0.0, 0.0),
            f"{side}_wrist": (x * of["forearm"], of["wrist height"], of["wrist depth"]),
            f"{side}_hand": (x * of["hand"], 0.0, 0.0),
        }
    offsets = np.zeros((JOINT_COUNT, 3))
    for name, offset in joint_offsets.items():
        offsets[joint_index(name)] = offset
    return Skeleton(offsets, _landmarks(offsets, of), source)


def _landmarks(offsets: Array, of: dict[str, float]) -> dict[str, Landmark]:
    points = {"head_top": Landmark(joint_index("head"), np.array([0.0, of["head top"], 0.0]))}
    for side, x in (("left", 1.0), ("right", -1.0)):
        ankle, ball, hand = (joint_index(f"{side}_{name}") for name in ("ankle", "foot", "hand"))
        foot_length = offsets[ball, 2] / (FOOT_BALL - FOOT_ANKLE)
        sole = -of["ankle height"] - offsets[ball, 1]  # below the ball joint
        tip = of["hand"] * (1 - HAND_KNUCKLES) / HAND_KNUCKLES
        points[f"{side}_heel"] = Landmark(ankle, np.array([0.0, -of["ankle height"], -FOOT_ANKLE * foot_length]))
        points[f"{side}_toe_tip"] = Landmark(ball, np.array([0.0, sole, (1 - FOOT_BALL) * foot_length]))
        points[f"{side}_fingertip"] = Landmark(hand, np.array([x * tip, 0.0, 0.0]))
    return points


def stature_of(skeleton: Skeleton) -> float:
    """Stature in metres, from the leg's length if a skeleton has no landmarks."""
    if {"head_top", "left_heel"} <= set(skeleton.landmarks):
        return skeleton.stature
    thigh, shank = skeleton.bone_length("left_knee"), skeleton.bone_length("left_ankle")
    return (thigh + shank) / LEGS


ESTIMATED = "; lengths estimated"  # appended to a skeleton's source
NO_LENGTH_M = 1e-9  # shorter limbs have no direction and keep their length
# Limbs by the joint at the far end, widths by the joint on either side.
_LEGS = {"thigh": "knee", "shank": "ankle"}
LIMB_ENDS = _LEGS | {"upper arm": "elbow", "forearm": "wrist", "foot": "foot", "hand": "hand"}
LIMBS = {name: (f"left_{end}", f"right_{end}") for name, end in LIMB_ENDS.items()}
STRAIGHT = {"upper arm": 0, "forearm": 0, "hand": 0, "thigh": 1, "shank": 1}  # axis of the upper bone
WIDTHS = {"hip width": "hip", "shoulder width": "shoulder"}
# Lengths that move joints along an axis of the body (1: up, 2: forward).
SHIFTS = {"neck": (("head",), 1), "neck height": (("neck",), 1), "neck depth": (("neck",), 2)} | {
    f"{end} {direction}": ((f"left_{end}", f"right_{end}"), axis)
    for end in ("hip", "shoulder", "wrist", "ankle")
    for direction, axis in (("height", 1), ("depth", 2))
    if (end, direction) != ("ankle", "height")
}

# Joints at the far ends of limbs with sensor sites.
STRETCHED = tuple(joint_index(joint) for name in ("upper arm", "forearm", "thigh", "shank") for joint in LIMBS[name])


@dataclass(frozen=True)
class BodyVariation:
    """Linear changes of a skeleton with a Gaussian prior.

    Attributes:
        directions: ``(24, 3, B)`` derivatives of the joints' offsets by the lengths.
        mean, whitening: ``(B,)`` metres and ``(B, B)`` per metre, of the prior.
    """

    directions: Array
    mean: Array
    whitening: Array

    @classmethod
    def about_mean(cls, skeleton: Skeleton, covariance: Array) -> "BodyVariation":
        """Make the prior about a likeliest skeleton, with covariance ``(B, B)`` m² of its lengths."""
        whitening = np.linalg.inv(np.linalg.cholesky(covariance))
        return cls(directions_of(skeleton), np.zeros(len(LENGTHS)), whitening)

    @property
    def covariance(self) -> Array:
        """Covariance ``(B, B)`` of the prior, m²."""
        inverse = np.linalg.inv(self.whitening)
        return inverse @ inverse.T

    def of_points(self, skeleton: Skeleton, bones: tuple[int, ...], p_bone_point: Array) -> Array:
        """Derivatives ``(n, 3, B)`` of points ``(n, 3)`` on bones by the lengths; their share of a limb is constant."""
        shift = np.zeros((len(bones), 3, len(LENGTHS)))
        for number, bone in enumerate(bones):
            children = [joint for joint in STRETCHED if PARENTS[joint] == bone]
            for child in children:
                along = skeleton.p_parent_joint[child]
                share = p_bone_point[number] @ along / max(float(along @ along), NO_LENGTH_M**2)
                shift[number] += float(np.clip(share, 0.0, 1.0)) * self.directions[child]
        return shift

    def varied(self, skeleton: Skeleton, lengths: Array) -> Skeleton:
        """Change a skeleton's lengths by ``(B,)`` metres."""
        offsets = skeleton.p_parent_joint + self.directions @ lengths
        source = skeleton.source if skeleton.source.endswith(ESTIMATED) else skeleton.source + ESTIMATED
        return Skeleton(offsets, skeleton.landmarks, source)

    def about(self, lengths: Array) -> "BodyVariation":
        """Express the prior relative to a skeleton that is changed by ``(B,)`` metres."""
        return BodyVariation(self.directions, self.mean - lengths, self.whitening)


def directions_of(skeleton: Skeleton) -> Array:
    """Derivatives ``(24, 3, B)`` of the joints' offsets by the lengths."""
    directions = np.zeros((JOINT_COUNT, 3, len(LENGTHS)))
    for name, joints in LIMBS.items():
        for joint in joints:
            along = skeleton.p_parent_joint[joint_index(joint)]
            if name in STRAIGHT:  # the bend at rest is another length
                along = np.where(np.arange(3) == STRAIGHT[name], along, 0.0)
            column = LENGTHS.index(name)
            directions[joint_index(joint), :, column] = along / max(float(np.linalg.norm(along)), NO_LENGTH_M)
    for name, end in WIDTHS.items():
        for side, sign in (("left", 0.5), ("right", -0.5)):
            directions[joint_index(f"{side}_{end}"), 0, LENGTHS.index(name)] = sign
    for name, (moved, axis) in SHIFTS.items():
        directions[[joint_index(joint) for joint in moved], axis, LENGTHS.index(name)] = 1.0
    spine = [joint_index(joint) for joint in SPINE]
    directions[spine, 1, LENGTHS.index("trunk")] = SPINE_SHARES
    return directions


def lengths_of(skeleton: Skeleton) -> Array:
    """Lengths ``(B,)`` of a skeleton in metres, mean of both sides; heights and depths are signed."""
    directions = directions_of(skeleton).reshape(-1, len(LENGTHS))
    lengths = np.asarray(np.linalg.lstsq(directions, skeleton.p_parent_joint.ravel(), rcond=None)[0], dtype=float)
    for name, joint in WIDTHS.items():
        lengths[LENGTHS.index(name)] = width(skeleton, joint)
    return lengths


def width(skeleton: Skeleton, joint: str) -> float:
    """Distance in metres between the left and the right joint at rest."""
    p_left, right = (skeleton.p_pelvis_joint[joint_index(f"{side}_{joint}")] for side in ("left", "right"))
    return float(np.linalg.norm(p_left - right))
