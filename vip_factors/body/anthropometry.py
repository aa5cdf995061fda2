"""A skeleton from stature, with published proportions; measured segment lengths win over them.

Heights and lengths are fractions of stature from Drillis & Contini (1966), as given by Winter, "Biomechanics and
Motor Control of Human Movement", fig. 4.1. With the sex known, the limb lengths are those between joint centres of
de Leva (1996), J. Biomech. 29(9), table 4. Neither divides the spine or says where a joint lies in depth; those
numbers are ours, placed so that the curve of the spine and the clavicles look right on a standing person.
"""

from collections.abc import Mapping

import numpy as np

from vip_factors.body.skeleton import JOINT_NAMES, PARENTS, Landmark, Skeleton, joint_index
from vip_factors.errors import InputError

STATURE_RANGE_M = (0.8, 2.6)  # from a small child to the tallest adults measured

# Fractions of stature. Drillis & Contini where nothing else is known ...
LIMB_LENGTHS: dict[str | None, dict[str, float]] = {
    None: {"thigh": 0.245, "shank": 0.246, "upper_arm": 0.186, "forearm": 0.146, "foot": 0.152, "hand": 0.108},
    # ... de Leva's joint-centre distances over the mean stature of his subjects (1.741 m and 1.735 m).
    "male": {
        "thigh": 0.4222 / 1.741, "shank": 0.4403 / 1.741, "upper_arm": 0.2817 / 1.741,
        "forearm": 0.2689 / 1.741, "foot": 0.2581 / 1.741, "hand": 0.108,
    },
    "female": {
        "thigh": 0.3685 / 1.735, "shank": 0.4386 / 1.735, "upper_arm": 0.2751 / 1.735,
        "forearm": 0.2643 / 1.735, "foot": 0.2283 / 1.735, "hand": 0.108,
    },
}  # fmt: skip
ANKLE_HEIGHT = 0.039
NECK_HEIGHT = 0.848  # cervicale, where the neck joint lies
SHOULDER_HEIGHT = 0.812
HIP_WIDTH = 0.100  # between hip joint centres: 72 % of the distance of the anterior spines (Seidel et al. 1995)
SHOULDER_WIDTH = 0.206  # between glenohumeral centres: biacromial breadth less the acromion's overhang

# Joints of the trunk at rest: (fraction of the way up from hips to neck, fraction of stature forward).
TRUNK = {"pelvis": (0.13, 0.0), "spine1": (0.33, -0.012), "spine2": (0.55, -0.010), "spine3": (0.66, 0.000)}
FOOT_BALL, FOOT_ANKLE = 0.73, 0.25  # along the foot from the heel: metatarsal heads and ankle
HAND_KNUCKLES = 0.45  # of the hand's length, from the wrist

# Which offsets a measured length stretches: the joint at the far end of the segment.
SEGMENT_ENDS = {
    "thigh": "knee", "shank": "ankle", "upper_arm": "elbow", "forearm": "wrist", "foot": "foot", "hand": "hand",
}  # fmt: skip


def skeleton_from_stature(
    stature_m: float,
    sex: str | None = None,
    segment_lengths_m: Mapping[str, float] | None = None,
) -> Skeleton:
    """The skeleton of a person of this stature.

    Args:
        stature_m: height in metres, without shoes.
        sex: ``"male"``, ``"female"`` or None.
        segment_lengths_m: measured lengths in metres, which win: ``thigh``, ``shank``, ``foot`` (ankle to ball),
            ``upper_arm``, ``forearm``, ``hand`` (wrist to knuckles), each with ``left_``/``right_`` before it if
            the sides differ, ``hip_width``, ``shoulder_width`` (between joint centres) and ``trunk`` (mid hip
            to neck).

    Raises:
        InputError: for an implausible stature or length, or an unknown segment or sex.
    """
    low, high = STATURE_RANGE_M
    if not low <= stature_m <= high:
        centimetres = (
            f"; {stature_m:g} looks like centimetres, give {stature_m / 100:g}" if 80 <= stature_m <= 260 else ""
        )
        raise InputError(f"stature {stature_m:g} m: expected between {low} and {high} metres{centimetres}")
    if sex not in LIMB_LENGTHS:
        raise InputError(f"sex '{sex}': expected 'male', 'female' or nothing")
    positions = _rest_positions(LIMB_LENGTHS[sex]) * stature_m
    parents = np.array(PARENTS)
    offsets = positions - positions[parents]
    offsets[0] = 0.0
    measured = dict(segment_lengths_m or {})
    offsets = _apply_measured(offsets, measured)
    lengths = {name: fraction * stature_m for name, fraction in LIMB_LENGTHS[sex].items()}
    used = f"; measured: {', '.join(sorted(measured))}" if measured else ""
    source = f"stature {stature_m:.2f} m, {'de Leva 1996, ' + sex if sex else 'Drillis & Contini 1966'}{used}"
    return Skeleton(offsets, _landmarks(offsets, lengths, stature_m), source)


def _rest_positions(limbs: Mapping[str, float]) -> np.ndarray:
    """T-pose joint positions as fractions of stature: x left, y up from the floor, z forward."""
    hip_height = ANKLE_HEIGHT + limbs["shank"] + limbs["thigh"]
    arm_end = SHOULDER_WIDTH / 2 + limbs["upper_arm"] + limbs["forearm"]
    at: dict[str, tuple[float, float, float]] = {
        name: (0.0, hip_height + up * (NECK_HEIGHT - hip_height), forward) for name, (up, forward) in TRUNK.items()
    }
    at |= {"neck": (0.0, NECK_HEIGHT, -0.010), "head": (0.0, 0.905, 0.012)}
    for side, x in (("left", 1.0), ("right", -1.0)):
        hip = x * HIP_WIDTH / 2
        at |= {
            f"{side}_hip": (hip, hip_height, 0.0),
            f"{side}_knee": (hip, ANKLE_HEIGHT + limbs["shank"], 0.0),
            f"{side}_ankle": (hip, ANKLE_HEIGHT, 0.0),
            f"{side}_foot": (hip, 0.012, (FOOT_BALL - FOOT_ANKLE) * limbs["foot"]),
            f"{side}_collar": (x * 0.030, SHOULDER_HEIGHT - 0.006, 0.005),
            f"{side}_shoulder": (x * SHOULDER_WIDTH / 2, SHOULDER_HEIGHT, -0.005),
            f"{side}_elbow": (x * (SHOULDER_WIDTH / 2 + limbs["upper_arm"]), SHOULDER_HEIGHT, -0.005),
            f"{side}_wrist": (x * arm_end, SHOULDER_HEIGHT, -0.005),
            f"{side}_hand": (x * (arm_end + HAND_KNUCKLES * limbs["hand"]), SHOULDER_HEIGHT, -0.005),
        }
    return np.array([at[name] for name in JOINT_NAMES])


def _apply_measured(offsets: np.ndarray, measured: Mapping[str, float]) -> np.ndarray:
    offsets = offsets.copy()
    for name, length in measured.items():
        if not 0.02 <= length <= 1.2:
            raise InputError(f"segment length {name} = {length:g} m: expected metres, between 0.02 and 1.2")
        if name in ("hip_width", "shoulder_width"):
            _set_width(offsets, name, length)
        elif name == "trunk":
            spine = [joint_index(joint) for joint in ("spine1", "spine2", "spine3", "neck")]
            hips = [joint_index("left_hip"), joint_index("right_hip")]
            factor = length / (offsets[spine, 1].sum() - offsets[hips, 1].mean())
            offsets[spine] *= factor
            offsets[hips, 1] *= factor
        else:
            for joint in _segment_joints(name):
                offsets[joint] *= length / np.linalg.norm(offsets[joint])
    return offsets


def _set_width(offsets: np.ndarray, name: str, width: float) -> None:
    end = name.removesuffix("_width")
    for side, sign in (("left", 1.0), ("right", -1.0)):
        joint = joint_index(f"{side}_{end}")
        parent_x = offsets[joint_index(f"{side}_collar"), 0] if end == "shoulder" else 0.0
        offsets[joint, 0] = sign * width / 2 - parent_x


def _segment_joints(name: str) -> list[int]:
    side, _, segment = name.partition("_")
    sides = [side] if side in ("left", "right") else ["left", "right"]
    segment = segment if side in ("left", "right") else name
    if segment not in SEGMENT_ENDS:
        known = ", ".join([*SEGMENT_ENDS, "hip_width", "shoulder_width", "trunk"])
        raise InputError(f"unknown segment '{name}': expected one of {known}, with left_ or right_ before a limb's")
    return [joint_index(f"{one}_{SEGMENT_ENDS[segment]}") for one in sides]


def _landmarks(offsets: np.ndarray, lengths: Mapping[str, float], stature: float) -> dict[str, Landmark]:
    points = {"head_top": Landmark(joint_index("head"), np.array([0.0, 0.095 * stature, 0.0]))}
    for side, x in (("left", 1.0), ("right", -1.0)):
        ankle, ball, hand = (joint_index(f"{side}_{name}") for name in ("ankle", "foot", "hand"))
        heel = np.array([0.0, -ANKLE_HEIGHT * stature, -FOOT_ANKLE * lengths["foot"]])
        sole = heel[1] - offsets[ball, 1]  # the sole below the ball joint
        points[f"{side}_heel"] = Landmark(ankle, heel)
        points[f"{side}_toe_tip"] = Landmark(ball, np.array([0.0, sole, (1 - FOOT_BALL) * lengths["foot"]]))
        points[f"{side}_fingertip"] = Landmark(hand, np.array([x * (1 - HAND_KNUCKLES) * lengths["hand"], 0, 0]))
    return points
