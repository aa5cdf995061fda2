"""How bodies differ of which the same is known: lengths of segments and places of joint centres, both sides alike.

What a stature leaves open is a Gaussian over the :data:`~vip_factors.body.lengths.LENGTHS`. They are changes in metres
of the rest pose's offsets, so that every point of the body is linear in them.
"""

from dataclasses import dataclass

import numpy as np

from vip_factors.body.lengths import LENGTHS, SPINE, SPINE_SHARES
from vip_factors.body.skeleton import JOINT_COUNT, PARENTS, Skeleton, joint_index
from vip_factors.geometry.rotations import Array

FOUND = "; lengths estimated"  # behind a skeleton's source
NO_LENGTH_M = 1e-9  # a limb that short has no direction: its length stays as it is
LIMBS = {
    "upper arm": ("left_elbow", "right_elbow"),
    "forearm": ("left_wrist", "right_wrist"),
    "hand": ("left_hand", "right_hand"),
    "thigh": ("left_knee", "right_knee"),
    "shank": ("left_ankle", "right_ankle"),
    "foot": ("left_foot", "right_foot"),
}
STRAIGHT = {"upper arm": 0, "forearm": 0, "hand": 0, "thigh": 1, "shank": 1}  # along which axis of the bone above
WIDTHS = {"hip width": "hip", "shoulder width": "shoulder"}
# Lengths that move joints along an axis of the body: up is 1, forward 2.
SHIFTS = {
    "hip height": (("left_hip", "right_hip"), 1),
    "hip depth": (("left_hip", "right_hip"), 2),
    "neck": (("head",), 1),
    "neck height": (("neck",), 1),
    "neck depth": (("neck",), 2),
    "shoulder height": (("left_shoulder", "right_shoulder"), 1),
    "shoulder depth": (("left_shoulder", "right_shoulder"), 2),
    "wrist height": (("left_wrist", "right_wrist"), 1),
    "wrist depth": (("left_wrist", "right_wrist"), 2),
    "ankle depth": (("left_ankle", "right_ankle"), 2),
}

# Joints at the far ends of limbs that sensors sit along.
STRETCHED = tuple(joint_index(joint) for name in ("upper arm", "forearm", "thigh", "shank") for joint in LIMBS[name])


@dataclass(frozen=True)
class BodyVariation:
    """Linear changes of a skeleton.

    Attributes:
        directions: ``(24, 3, B)`` how each joint's place on its parent changes with each of the lengths.
        mean: ``(B,)`` metres, of the prior.
        whitening: ``(B, B)`` per metre, of the prior.
    """

    directions: Array
    mean: Array
    whitening: Array

    @classmethod
    def about_mean(cls, skeleton: Skeleton, covariance: Array) -> "BodyVariation":
        """Of bodies whose likeliest skeleton is this, and whose lengths have the covariance ``(B, B)`` in metres²."""
        whitening = np.linalg.inv(np.linalg.cholesky(covariance))
        return cls(directions_of(skeleton), np.zeros(len(LENGTHS)), whitening)

    @property
    def covariance(self) -> Array:
        """Of the prior, ``(B, B)`` in metres²."""
        inverse = np.linalg.inv(self.whitening)
        return inverse @ inverse.T

    def of_points(self, skeleton: Skeleton, bones: tuple[int, ...], p_bone_point: Array) -> Array:
        """How points ``(n, 3)`` shift on their bones, ``(n, 3, B)``: along a limb they keep their share of it."""
        shift = np.zeros((len(bones), 3, len(LENGTHS)))
        for number, bone in enumerate(bones):
            children = [joint for joint in STRETCHED if PARENTS[joint] == bone]
            for child in children:
                along = skeleton.p_parent_joint[child]
                share = float(
                    np.clip(p_bone_point[number] @ along / max(float(along @ along), NO_LENGTH_M**2), 0.0, 1.0)
                )
                shift[number] += share * self.directions[child]
        return shift

    def varied(self, skeleton: Skeleton, lengths: Array) -> Skeleton:
        """The skeleton changed by ``(B,)`` metres."""
        offsets = skeleton.p_parent_joint + self.directions @ lengths
        source = skeleton.source if skeleton.source.endswith(FOUND) else skeleton.source + FOUND
        return Skeleton(offsets, skeleton.landmarks, source)

    def about(self, lengths: Array) -> "BodyVariation":
        """The same Gaussian, of changes of a skeleton that has been changed by ``(B,)`` metres."""
        return BodyVariation(self.directions, self.mean - lengths, self.whitening)


def directions_of(skeleton: Skeleton) -> Array:
    """How each joint's place on its parent changes with each of the lengths, ``(24, 3, B)``."""
    directions = np.zeros((JOINT_COUNT, 3, len(LENGTHS)))
    for name, joints in LIMBS.items():
        for joint in joints:
            along = skeleton.p_parent_joint[joint_index(joint)]
            if name in STRAIGHT:  # what bends it at rest is a length of its own
                along = np.where(np.arange(3) == STRAIGHT[name], along, 0.0)
            directions[joint_index(joint), :, LENGTHS.index(name)] = along / max(
                float(np.linalg.norm(along)), NO_LENGTH_M
            )
    for name, end in WIDTHS.items():
        for side, sign in (("left", 0.5), ("right", -0.5)):
            directions[joint_index(f"{side}_{end}"), 0, LENGTHS.index(name)] = sign
    for name, (moved, axis) in SHIFTS.items():
        directions[[joint_index(joint) for joint in moved], axis, LENGTHS.index(name)] = 1.0
    spine = [joint_index(joint) for joint in SPINE]
    directions[spine, 1, LENGTHS.index("trunk")] = SPINE_SHARES
    return directions


def lengths_of(skeleton: Skeleton) -> Array:
    """``(B,)`` metres: limbs from joint to joint, widths between joints, and where joints lie on the bone above.

    Of both sides it is the mean. What is no distance (the height of the hips over the pelvis, say) has a sign.
    """
    directions = directions_of(skeleton).reshape(-1, len(LENGTHS))
    found = np.asarray(np.linalg.lstsq(directions, skeleton.p_parent_joint.ravel(), rcond=None)[0], dtype=float)
    for name, joint in WIDTHS.items():
        found[LENGTHS.index(name)] = width(skeleton, joint)
    return found


def width(skeleton: Skeleton, joint: str) -> float:
    """Metres between a joint of the left and its twin on the right, at rest."""
    left, right = (skeleton.p_pelvis_joint[joint_index(f"{side}_{joint}")] for side in ("left", "right"))
    return float(np.linalg.norm(left - right))
