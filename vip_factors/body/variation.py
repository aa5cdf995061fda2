"""How bodies of one stature differ: lengths of segments and places of joint centres, both sides alike, and how likely.

What a stature leaves open is a Gaussian over a dozen lengths. They are changes in metres of the rest pose's offsets, so
that every point of the body is linear in them.
"""

from dataclasses import dataclass

import numpy as np

from vip_factors.body.skeleton import JOINT_COUNT, PARENTS, Skeleton, joint_index
from vip_factors.geometry.rotations import Array

# Standard deviations in metres of what stature and sex leave open. Residuals of ANSUR II's 6,068 people for trunk,
# neck and head, forearm, thigh and shank; they are 11 mm for the upper arm, 7 for the hand and 9 for the
# foot, wider here because no tape reaches the centres these start from. Hips and shoulders are no landmarks of a tape:
# 15–25 mm, as far as optical skeletons lie from where tables put them.
SIGMAS: dict[str, float] = {
    "hip width": 0.020,
    "hip height": 0.015,
    "trunk": 0.026,
    "neck": 0.015,
    "shoulder width": 0.025,
    "shoulder height": 0.020,
    "upper arm": 0.015,
    "forearm": 0.011,
    "hand": 0.010,
    "thigh": 0.020,
    "shank": 0.015,
    "foot": 0.010,
}
# Of their residuals: tall trunks go with short legs, for the stature is given.
CORRELATIONS: dict[tuple[str, str], float] = {
    ("thigh", "trunk"): -0.72,
    ("shank", "trunk"): -0.43,
    ("shank", "forearm"): 0.44,
    ("forearm", "hand"): 0.40,
    ("neck", "trunk"): -0.36,
}
LENGTHS = tuple(SIGMAS)
FOUND = "; lengths estimated"  # behind a skeleton's source
SPINE = ("spine1", "spine2", "spine3", "neck")
LIMBS = {
    "neck": ("head",),
    "upper arm": ("left_elbow", "right_elbow"),
    "forearm": ("left_wrist", "right_wrist"),
    "hand": ("left_hand", "right_hand"),
    "thigh": ("left_knee", "right_knee"),
    "shank": ("left_ankle", "right_ankle"),
    "foot": ("left_foot", "right_foot"),
}

# Joints at the far ends of limbs that sensors sit along.
STRETCHED = tuple(joint_index(joint) for name in ("upper arm", "forearm", "thigh", "shank") for joint in LIMBS[name])


@dataclass(frozen=True)
class BodyVariation:
    """Linear changes of a skeleton.

    Attributes:
        directions: ``(24, 3, B)`` how each joint's place on its parent changes with each of the :data:`LENGTHS`.
        mean: ``(B,)`` metres, of the prior.
        whitening: ``(B, B)`` per metre, of the prior.
    """

    directions: Array
    mean: Array
    whitening: Array

    @classmethod
    def of(cls, skeleton: Skeleton) -> "BodyVariation":
        """Of people with a skeleton's stature."""
        directions = np.zeros((JOINT_COUNT, 3, len(LENGTHS)))
        for number, name in enumerate(LENGTHS):
            for joint in LIMBS.get(name, ()):
                along = skeleton.p_parent_joint[joint_index(joint)]
                directions[joint_index(joint), :, number] = along / np.linalg.norm(along)
        for side, sign in (("left", 0.5), ("right", -0.5)):
            directions[joint_index(f"{side}_hip"), 0, LENGTHS.index("hip width")] = sign
            directions[joint_index(f"{side}_hip"), 1, LENGTHS.index("hip height")] = 1.0
            directions[joint_index(f"{side}_shoulder"), 0, LENGTHS.index("shoulder width")] = sign
            directions[joint_index(f"{side}_shoulder"), 1, LENGTHS.index("shoulder height")] = 1.0
        spine = [joint_index(joint) for joint in SPINE]
        up = skeleton.p_parent_joint[spine]
        directions[spine, :, LENGTHS.index("trunk")] = up / up[:, 1].sum()
        return cls(directions, np.zeros(len(LENGTHS)), _whitening())

    def of_points(self, skeleton: Skeleton, bones: tuple[int, ...], p_bone_point: Array) -> Array:
        """How points ``(n, 3)`` shift on their bones, ``(n, 3, B)``: along a limb they keep their share of it."""
        shift = np.zeros((len(bones), 3, len(LENGTHS)))
        for number, bone in enumerate(bones):
            children = [joint for joint in STRETCHED if PARENTS[joint] == bone]
            for child in children:
                along = skeleton.p_parent_joint[child]
                share = float(np.clip(p_bone_point[number] @ along / (along @ along), 0.0, 1.0))
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


def _whitening() -> Array:
    sigmas = np.array(list(SIGMAS.values()))
    correlation = np.eye(len(sigmas))
    for (one, other), value in CORRELATIONS.items():
        i, j = LENGTHS.index(one), LENGTHS.index(other)
        correlation[i, j] = correlation[j, i] = value
    # Measured pair by pair: the nearest matrix that is one of correlations at all.
    values, vectors = np.linalg.eigh(correlation)
    covariance = sigmas[:, None] * ((vectors * np.maximum(values, 0.05)) @ vectors.T) * sigmas
    return np.linalg.inv(np.linalg.cholesky(covariance))
