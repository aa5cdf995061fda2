"""Skeleton with SMPL's 24 joints (topology, names, order and axes), and calibration poses.

Body axes at rest: x to the wearer's left, y up, z forward; all joint rotations are identity in the T-pose.
A *bone* is the segment that a joint moves and has that joint's name: bone ``left_knee`` is the left shank.
"""

from collections.abc import Collection, Container, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from vip_factors.display import Summarised
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array, exp

# Orientation of an upright pelvis that faces the x axis of a world with z up.
R_WORLD_FACING_X = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
POSES = ("t-pose", "n-pose")
_JOINT_NAMES = (
    "pelvis left_hip right_hip spine1 left_knee right_knee spine2 left_ankle right_ankle spine3 left_foot "
    "right_foot neck left_collar right_collar head left_shoulder right_shoulder left_elbow right_elbow left_wrist "
    "right_wrist left_hand right_hand"
)
JOINT_NAMES = tuple(_JOINT_NAMES.split())
PARENTS = (-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21)
JOINT_COUNT = len(JOINT_NAMES)
LONGEST_BONE_M = 10.0  # larger than any person; leaves room for animated giants

# Common names of bones.
BONE_ALIASES = {
    f"{side}_{alias}": f"{side}_{joint}"
    for side in ("left", "right")
    for joint, aliases in {
        "hip": ("thigh", "upper_leg"),
        "knee": ("shank", "lower_leg"),
        "foot": ("toe",),
        "shoulder": ("upper_arm",),
        "elbow": ("forearm", "lower_arm"),
    }.items()
    for alias in aliases
} | {"hips": "pelvis", "sternum": "spine3", "chest": "spine3", "lower_back": "spine1"}
SIDES = ("left", "right")
# Bones of the limbs, from the trunk outwards.
LIMBS = {"legs": ("hip", "knee", "ankle", "foot"), "arms": ("collar", "shoulder", "elbow", "wrist", "hand")}
# Bones with sensor sites along them, and the joint at the far end of each.
LIMB_ENDS = {
    f"{side}_{bone}": f"{side}_{end}"
    for side in SIDES
    for bone, end in (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist"))
}


def worn_limbs(bones: Container[str]) -> list[tuple[str, ...]]:
    """Select the :data:`LIMBS` with a sensor on either side."""
    return [limb for limb in LIMBS.values() if any(f"{side}_{bone}" in bones for side in SIDES for bone in limb)]


def joint_index(name: str) -> int:
    """Index of a joint (and of the bone it moves), by SMPL name or by a common alias such as ``left_thigh``.

    Raises:
        InputError: for an unknown name.
    """
    canonical = BONE_ALIASES.get(name, name)
    if canonical not in JOINT_NAMES:
        raise InputError(f"unknown bone '{name}': expected one of {', '.join(JOINT_NAMES)}")
    return JOINT_NAMES.index(canonical)


def joints_placed_by(bones: Collection[str] | None, joints: Iterable[int]) -> list[int]:
    """Rows of joints whose parent bone is among ``bones`` (None: all): their positions are measured."""
    return [row for row in joints if bones is None or JOINT_NAMES[max(PARENTS[row], 0)] in bones]


def ancestors(joint: int) -> tuple[int, ...]:
    """The kinematic chain from the root to ``joint``, both included."""
    chain = [joint]
    while PARENTS[chain[-1]] >= 0:
        chain.append(PARENTS[chain[-1]])
    return tuple(reversed(chain))


@dataclass(frozen=True)
class Landmark:
    """Point fixed to a bone: ``p_bone_point`` in metres, bone axes."""

    bone: int
    p_bone_point: Array


@dataclass(frozen=True, repr=False)
class Skeleton(Summarised):
    """Joint offsets and landmarks of one person.

    Attributes:
        p_parent_joint: ``(24, 3)`` metres, each joint in its parent's frame at rest; the root's row is zero.
        landmarks: points beyond the last joints: ``head_top``, ``left_heel``, ``left_toe_tip``,
            ``left_fingertip`` and their right counterparts.
        source: one line about the origin of the lengths.
    """

    p_parent_joint: Array
    landmarks: Mapping[str, Landmark] = field(default_factory=dict)
    source: str = "unknown"

    def __post_init__(self) -> None:
        offsets = np.asarray(self.p_parent_joint, dtype=float)
        if offsets.shape != (JOINT_COUNT, 3) or not np.all(np.isfinite(offsets)):
            raise InputError(f"skeleton offsets have shape {offsets.shape}: expected 24 finite rows of x, y, z")
        joint = int(np.argmax(np.abs(offsets).max(axis=1)))
        if not np.max(np.abs(offsets[joint])) < LONGEST_BONE_M:
            raise InputError(
                f"skeleton ({self.source}): {JOINT_NAMES[joint]} is at {offsets[joint]} m "
                f"from the joint above it: expected metres, less than {LONGEST_BONE_M:g}"
            )
        object.__setattr__(self, "p_parent_joint", offsets)

    @cached_property
    def p_pelvis_joint(self) -> Array:
        """Joint positions ``(24, 3)`` in the pelvis frame at rest (T-pose)."""
        positions = np.zeros((JOINT_COUNT, 3))
        for joint in range(1, JOINT_COUNT):
            positions[joint] = positions[PARENTS[joint]] + self.p_parent_joint[joint]
        return positions

    def limb(self, bone: int) -> Array | None:
        """Vector ``(3,)`` from a limb's joint to the one at its far end; None for other bones."""
        end = LIMB_ENDS.get(JOINT_NAMES[bone])
        return None if end is None else self.p_parent_joint[joint_index(end)]

    def bone_length(self, child: str) -> float:
        """Distance in metres from the parent joint to ``child``: ``bone_length('left_knee')`` is the thigh."""
        return float(np.linalg.norm(self.p_parent_joint[joint_index(child)]))

    @property
    def stature(self) -> float:
        """Height in metres from the heels to the top of the head at rest."""
        top, heel = self.landmarks["head_top"], self.landmarks["left_heel"]
        y = self.p_pelvis_joint[:, 1]
        return float(y[top.bone] + top.p_bone_point[1] - y[heel.bone] - heel.p_bone_point[1])


def contact_points(skeleton: Skeleton, sole: float = 0.0) -> tuple[tuple[int, Array], ...]:
    """Heel and ball of both feet under a sole of ``sole`` metres, as (bone, ``p_bone_point``).

    Without a heel landmark the ankle takes its place.
    """
    points = []
    for side in ("left", "right"):
        ankle, ball = joint_index(f"{side}_ankle"), joint_index(f"{side}_foot")
        heel = skeleton.landmarks.get(f"{side}_heel")
        points.append((ankle, heel.p_bone_point if heel else np.zeros(3)))
        points.append((ankle, skeleton.p_parent_joint[ball]))
    return tuple((bone, p - np.array([0.0, sole, 0.0])) for bone, p in points)


def calibration_pose(pose: str) -> Array:
    """Joint rotations ``(24, 3, 3)`` of a nominal pose, upright and facing the world's x axis.

    ``"t-pose"`` is the rest pose; in the ``"n-pose"`` the arms hang straight down, palms towards the thighs.

    Raises:
        InputError: for another name.
    """
    if pose not in POSES:
        raise InputError(f"initial pose '{pose}': expected t-pose or n-pose")
    R = np.broadcast_to(np.eye(3), (JOINT_COUNT, 3, 3)).copy()
    R[0] = R_WORLD_FACING_X
    if pose == "n-pose":
        R[joint_index("left_shoulder")] = exp([0, 0, -np.pi / 2])
        R[joint_index("right_shoulder")] = exp([0, 0, np.pi / 2])
    return R


# Poses as people hold them: mean and standard deviation in degrees about x, y, z of each joint of the left side and the
# middle; the right side is mirrored. Arms in a T-pose are 5–25° low, rotated by 20–45° about their long axis and bent
# by about 20°. Legs and trunk vary by 3–8°, heads by 16°, feet by 7–15°; upright knees are bent by 3–7°.
_TRUNK_SIGMAS = {"spine1": 5.0, "spine2": 4.0, "spine3": 4.0, "neck": 8.0, "head": 10.0}
_LEFT_SIGMAS = {
    "left_hip": (7.0, 10.0, 6.0), "left_knee": (7.0, 8.0, 4.0), "left_ankle": (8.0, 10.0, 8.0),
    "left_foot": (8.0, 8.0, 8.0), "left_collar": (8.0, 8.0, 8.0), "left_shoulder": (25.0, 15.0, 12.0),
    "left_elbow": (20.0, 12.0, 10.0), "left_wrist": (20.0, 12.0, 12.0), "left_hand": (10.0, 10.0, 10.0),
}  # fmt: skip
_LEFT_MEANS = {
    "t-pose": {"left_shoulder": (-30.0, 0.0, -10.0), "left_elbow": (0.0, -20.0, 0.0), "left_knee": (3.0, 0.0, 0.0)},
    "n-pose": {"left_shoulder": (-10.0, 0.0, 10.0), "left_elbow": (0.0, -20.0, 0.0), "left_knee": (3.0, 0.0, 0.0)},
}


@dataclass(frozen=True, repr=False)
class HeldPose(Summarised):
    """Calibration pose as people hold it: rotations ``(24, 3, 3)`` and standard deviations ``(24, 3)`` in radians.

    The root's heading is free, and its row of standard deviations is not used.
    """

    R_parent_child: Array
    sigma: Array


def nominal_pose(pose: str) -> HeldPose:
    """Return a nominal pose as in the papers, with the same standard deviation for every joint."""
    nominal_sigma_deg = 6.0  # per joint; bones deviate by 10–15° through several joints
    return HeldPose(calibration_pose(pose), np.full((JOINT_COUNT, 3), np.radians(nominal_sigma_deg)))


def held_pose(pose: str, nominal: bool = False) -> HeldPose:
    """Return a pose as people hold it, upright and facing the world's x axis, or the ``nominal`` one."""
    if nominal:
        return nominal_pose(pose)
    R, sigma = calibration_pose(pose), np.ones((JOINT_COUNT, 3))
    for name, spread in _TRUNK_SIGMAS.items():
        sigma[joint_index(name)] = np.radians(spread)
    for left_joint, spreads in _LEFT_SIGMAS.items():
        mean = np.radians(_LEFT_MEANS[pose].get(left_joint, (0.0, 0.0, 0.0)))
        for joint, mirror in (
            (left_joint, np.ones(3)),
            (left_joint.replace("left", "right"), np.array([1.0, -1.0, -1.0])),
        ):
            sigma[joint_index(joint)] = np.radians(spreads)
            R[joint_index(joint)] = R[joint_index(joint)] @ exp(mirror * mean)
    return HeldPose(R, sigma)
