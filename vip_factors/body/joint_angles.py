"""Anatomical frames of the segments, and joint angles in the terms of the International Society of Biomechanics (ISB).

Frames: x forward, y up, z to the right in the anatomical posture that ISB counts joint angles from (Wu et al. 2002,
J. Biomech. 35; 2005, 38) and in which OpenSim's models stand: upright, feet level and pointing forward, arms hanging,
palms forward. Ours at rest is the T-pose; from there the arms go down by 90° about the forward axis, by which the palms
face the thighs, and the forearms turn outward (supinate) by 90°. Where ISB finds axes by palpated landmarks, these are
the bone's own, parallel in that posture; but as there, the long axis of thigh, shank, upper arm and forearm goes
through the centres of the joints at both ends, wherever a body has them.

Angles, in degrees. Hips, knees, ankles: Grood & Suntay (1983), J. Biomech. Eng. 105, and Wu et al. (2002): flexion
about the upper segment's mediolateral axis, rotation about the lower one's long axis, adduction about the floating axis
between. Trunk, neck, elbows and wrists likewise, and shoulders, the upper arm against the thorax, by plane of
elevation, elevation and axial rotation (Wu et al. 2005). Pelvis: rotation, obliquity, tilt in that order (Baker 2001,
J. Biomech. 34), so that tilt means the same whichever way somebody walks. Both sides have the same signs. All angles
are zero in the anatomical posture, of a body whose limbs are straight in it.
"""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import JOINT_COUNT, JOINT_NAMES, PARENTS, Skeleton, calibration_pose, joint_index
from vip_factors.display import Summarised
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import (
    Array,
    exp,
    rotation_between,
    rotation_y,
    sequence_of_rotation,
    transpose,
    wrap_angle,
)


@dataclass(frozen=True)
class AngleDefinition:
    """One joint angle, such as ``left_knee_flexion``; the same joint, ``left_knee``, has those that together make a
    rotation. ``positive`` is what a positive angle means.
    """

    name: str
    joint: str
    positive: str


@dataclass(frozen=True, repr=False)
class JointAngles(Summarised):
    """Joint angles of a motion: ``time`` ``(T,)`` seconds from the recording's start, ``degrees`` ``(T, N)``."""

    time: Array
    definitions: tuple[AngleDefinition, ...]
    degrees: Array

    def summary(self) -> list[str]:
        """How many there are, and how they are called."""
        degrees = f"degrees: {len(self.time)} frames, {len(self.names)} angles"
        return ["joint angles", degrees, f"names: {', '.join(self.names[:3])} …"]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the ``N`` angles."""
        return tuple(one.name for one in self.definitions)

    def of(self, name: str) -> Array:
        """One angle ``(T,)`` in degrees.

        Raises:
            InputError: for an unknown name.
        """
        if name not in self.names:
            raise InputError(f"unknown joint angle '{name}': expected one of {', '.join(self.names)}")
        return self.degrees[:, self.names.index(name)]


@dataclass(frozen=True)
class _Joint:
    """Three angles between two segments.

    ``axes`` are of the segments' anatomical axes (x forward, y up, z right), each turned by the turns before it;
    ``angles`` are their names, the sign that makes them positive as they are meant, and what that is.
    """

    name: str
    above: str  # empty: the room
    below: str
    axes: str
    angles: tuple[tuple[str, int, str], ...]


_SPINE = (
    ("flexion", -1, "forward"), ("lateral_bending", 1, "to the right"), ("axial_rotation", 1, "to the left"),
)  # fmt: skip
_MIDDLE = (
    _Joint("pelvis", "", "pelvis", "yxz", (
        ("rotation", 1, "facing further to the left; 0 is along the world's x axis"),
        ("obliquity", 1, "right side lower"), ("tilt", -1, "forward (anterior)"))),
    _Joint("trunk", "pelvis", "spine3", "zxy", _SPINE),
    _Joint("neck", "spine3", "head", "zxy", _SPINE),
)  # fmt: skip
# Of the right side; the left one is looked at in a mirror.
_SIDE = (
    _Joint("hip", "pelvis", "hip", "zxy", (
        ("flexion", 1, "thigh forward"), ("adduction", 1, "thigh inward"), ("internal_rotation", 1, "thigh inward"))),
    _Joint("knee", "hip", "knee", "zxy", (
        ("flexion", -1, "bent"), ("adduction", 1, "shank inward (varus)"), ("internal_rotation", 1, "shank inward"))),
    _Joint("ankle", "knee", "ankle", "zxy", (
        ("dorsiflexion", 1, "toes up"), ("inversion", 1, "sole inward"), ("internal_rotation", 1, "toes inward"))),
    _Joint("shoulder", "spine3", "shoulder", "yxy", (
        ("plane_of_elevation", 1, "0 is sideways, 90 forward, -90 backward"),
        ("elevation", -1, "arm away from hanging, in that plane; never negative"), ("axial_rotation", 1, "internal"))),
    _Joint("shoulder", "spine3", "shoulder", "zxy", (
        ("flexion", 1, "arm forward"), ("adduction", 1, "arm inward; negative is abduction"),
        ("internal_rotation", 1, "upper arm inward"))),
    _Joint("elbow", "shoulder", "elbow", "zxy", (
        ("flexion", 1, "bent"), ("carrying_angle", -1, "forearm outward (valgus)"),
        ("pronation", 1, "palm inward, then back; 90 with the palm at the thigh"))),
    _Joint("wrist", "elbow", "wrist", "zxy", (
        ("flexion", 1, "towards the palm"), ("ulnar_deviation", 1, "towards the little finger"),
        ("pronation", 1, "hand inward about the forearm, beyond its own pronation"))),
)  # fmt: skip


def _joints() -> Iterator[_Joint]:
    yield from _MIDDLE
    for side in ("left", "right"):
        for one in _SIDE:
            above = one.above if one.above in ("pelvis", "spine3") else f"{side}_{one.above}"
            yield _Joint(f"{side}_{one.name}", above, f"{side}_{one.below}", one.axes, one.angles)


_JOINTS = tuple(_joints())
_BELOW = np.array([joint_index(one.below) for one in _JOINTS])
_ABOVE = np.array([joint_index(one.above) if one.above else -1 for one in _JOINTS])
# Numbers of the joints that are looked at in one way, at once.
_ALIKE = [[n for n, one in enumerate(_JOINTS) if one.axes == axes] for axes in ("yxz", "zxy", "yxy")]
# How the entries of a joint's rotation change sign as it is looked at: a left one's in a mirror, where z points the
# other way; elevation from behind, where x and z do, and is a positive turn.
_MIRRORED, _FROM_BEHIND = np.array([1.0, 1.0, -1.0]), np.array([-1.0, 1.0, -1.0])
_VIEWS = [
    (_MIRRORED if one.name.startswith("left_") else 1.0) * (_FROM_BEHIND if one.axes == "yxy" else np.ones(3))
    for one in _JOINTS
]
_SEEN = np.stack([np.outer(one, one) for one in _VIEWS])
_SIGNS = np.array([[1 if one.axes == "yxy" else sign for _, sign, _ in one.angles] for one in _JOINTS])
ANGLE_DEFINITIONS: tuple[AngleDefinition, ...] = tuple(
    AngleDefinition(f"{joint.name}_{angle}", joint.name, positive)
    for joint in _JOINTS
    for angle, _, positive in joint.angles
)
"""All angles, in the order of their columns."""


def joint_angles(motion: Motion) -> JointAngles:
    """The angles of a motion, in degrees.

    They lie within ±180°, but for the pelvis' rotation, which goes on counting when somebody turns round. Where the
    upper arm hangs or points straight up, plane of elevation and axial rotation are determined together only, not each
    by itself: read the shoulder's ``flexion`` and ``adduction`` there. These and ``internal_rotation`` are not ISB's
    but those of gait models, and undetermined in turn with the arm stretched out sideways.
    """
    degrees = angles_of_segments(segment_orientations(motion))
    degrees[:, 0] = np.unwrap(degrees[:, 0], period=360.0)
    return JointAngles(motion.time, ANGLE_DEFINITIONS, degrees)


def angles_of_segments(R_room_segment: Array) -> Array:
    """The angles ``(T, N)`` in degrees, all within ±180, of :func:`segment_orientations` ``(T, 24, 3, 3)``."""
    degrees = np.empty((len(R_room_segment), len(_JOINTS), 3))
    for joints in _ALIKE:
        degrees[:, joints] = np.rad2deg(_angles(joints, _between(joints, R_room_segment)))
    return degrees.reshape(len(degrees), -1)


def joint_angle_sigmas(motion: Motion, covariance: Array) -> Array:
    """Standard deviations ``(T, N)`` of the angles in degrees, to first order.

    ``covariance`` is ``(T, 24, 3, 3)`` rad², of right perturbations of the joint rotations. NaN for trunk, neck and
    shoulders, which several joints turn: how their errors go together is not known.
    """
    R, axes = segment_orientations(motion), segment_axes(motion.skeleton)
    sigmas = np.full((len(motion), len(ANGLE_DEFINITIONS)), np.nan)
    for number, bone in enumerate(_BELOW):
        if PARENTS[bone] != _ABOVE[number]:
            continue
        R_bone_segment, R_above_below = axes[bone], _between([number], R)
        turned = [
            _angles([number], R_above_below @ R_bone_segment.T @ exp(step) @ R_bone_segment)[:, 0]
            for step in (*_STEP * np.eye(3), *-_STEP * np.eye(3))
        ]
        jacobian = np.stack([wrap_angle(turned[k] - turned[k + 3]) / (2 * _STEP) for k in range(3)], axis=-1)
        variance = np.einsum("tai,tij,taj->ta", jacobian, covariance[:, bone], jacobian)
        sigmas[:, 3 * number : 3 * number + 3] = np.rad2deg(np.sqrt(variance))
    return sigmas


_STEP = 1e-5  # rad: the difference of two angles keeps ten digits


def _between(joints: Sequence[int], R_room_segment: Array) -> Array:
    """Rotations ``(T, J, 3, 3)`` of joints that are alike, of orientations ``(T, 24, 3, 3)``."""
    R = R_room_segment[:, _BELOW[joints]]
    return transpose(R_room_segment[:, _ABOVE[joints]]) @ R if _JOINTS[joints[0]].above else R


def _angles(joints: Sequence[int], R_above_below: Array) -> Array:
    """The three angles ``(T, J, 3)`` in radians, as they are meant, of joints that are alike."""
    return sequence_of_rotation(R_above_below * _SEEN[joints], _JOINTS[joints[0]].axes) * _SIGNS[joints]


# x forward, y up, z right, as columns in the body's axes: x left, y up, z forward.
R_BODY_ISB = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
# The same of the room, which has z up: x of the world, up, and what is to the right of who looks along x. OpenSim's
# ground is like this.
R_WORLD_ISB = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def segment_axes(skeleton: Skeleton) -> Array:
    """Each segment's anatomical axes, as columns in its bone's: ``(24, 3, 3)``."""
    R_bone_segment = _of_straight_limbs()
    for bone in range(JOINT_COUNT):
        limb = skeleton.limb(bone)
        if limb is not None:
            R_bone_segment[bone] = rotation_between(R_bone_segment[bone][:, 1], -limb) @ R_bone_segment[bone]
    return R_bone_segment


def _of_straight_limbs() -> Array:
    hanging, found = calibration_pose("n-pose"), np.empty((JOINT_COUNT, 3, 3))
    for bone, name in enumerate(JOINT_NAMES):
        side, _, joint = name.partition("_")
        found[bone] = R_BODY_ISB
        if joint in ("shoulder", "elbow", "wrist", "hand"):
            found[bone] = hanging[joint_index(f"{side}_shoulder")].T @ R_BODY_ISB
        if joint in ("elbow", "wrist", "hand"):  # with the palm at the thigh the forearm is pronated by 90°
            found[bone] = found[bone] @ rotation_y(-np.pi / 2 if side == "left" else np.pi / 2)
    return found


def segment_orientations(motion: Motion) -> Array:
    """Orientations ``(T, 24, 3, 3)`` of the segments' anatomical axes in the room's (y up, :data:`R_WORLD_ISB`)."""
    return R_WORLD_ISB.T @ motion.state.R_world_bone @ segment_axes(motion.skeleton)


def mirrored(R: Array) -> Array:
    """Rotations ``(..., 3, 3)`` of the other side's segments, in the same axes."""
    return R * np.outer(_MIRRORED, _MIRRORED)


# A joint's angles are between two segments; of the trunk any bone does.
_CHEST = ("spine1", "spine2", "spine3", "left_collar", "right_collar", "neck")
_BETWEEN = {
    "hip": (("pelvis",), ("{}_hip",)),
    "knee": (("{}_hip",), ("{}_knee",)),
    "ankle": (("{}_knee",), ("{}_ankle", "{}_foot")),
    "shoulder": (_CHEST, ("{}_shoulder",)),
    "elbow": (("{}_shoulder",), ("{}_elbow",)),
    "wrist": (("{}_elbow",), ("{}_wrist", "{}_hand")),
    "neck": (_CHEST, ("head",)),
    "trunk": (("pelvis",), _CHEST),
    "pelvis": (("pelvis",), ("pelvis",)),
}


def is_measured(bones: Collection[str] | None, angle: str) -> bool:
    """Whether both segments of an angle have sensors on the named bones; yes if nobody knows these.

    ``angle`` is one side's, ``left_hip_flexion``, or both sides', ``hip_flexion``.
    """
    return bones is None or not bare_segments(bones, angle)


def bare_segments(bones: Collection[str], angle: str) -> tuple[tuple[str, ...], ...]:
    """Segments of an angle without a sensor, each as the bones of which any would do, ``(left_ankle, left_foot)``."""
    side, _, rest = angle.partition("_")
    sides, name = ((side,), rest) if side in ("left", "right") else (("left", "right"), angle)
    ends = (tuple(one.format(side) for one in end) for end in _BETWEEN[name.partition("_")[0]] for side in sides)
    return tuple(dict.fromkeys(end for end in ends if not any(one in bones for one in end)))
