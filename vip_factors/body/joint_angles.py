"""Anatomical frames of the segments and joint angles as defined by the International Society of Biomechanics (ISB).

Frames: x forward, y up, z to the right in ISB's anatomical posture (Wu et al. 2002, J. Biomech. 35; 2005, 38), which is
also that of OpenSim's models: upright, feet level and pointing forward, arms hanging, palms forward. From the T-pose,
our rest pose, the arms go down by 90° about the forward axis, and the forearms supinate by 90°. ISB defines axes by
palpated landmarks; here they are parallel in the posture, except that the long axis of thigh, shank, upper arm and
forearm goes through the centres of the joints at both ends.

Angles, in degrees. Hips, knees, ankles: Grood & Suntay (1983), J. Biomech. Eng. 105, and Wu et al. (2002): flexion
about the upper segment's mediolateral axis, rotation about the lower one's long axis, adduction about the floating axis
between. Trunk, neck, elbows and wrists likewise. Shoulders (upper arm relative to the thorax): plane of elevation,
elevation and axial rotation (Wu et al. 2005). Pelvis: rotation, obliquity, tilt in that order (Baker 2001, J. Biomech.
34), so that tilt does not depend on the walking direction. Both sides have the same signs. All angles are zero in the
anatomical posture with straight limbs.
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
    """One joint angle, such as ``left_knee_flexion`` of the joint ``left_knee``.

    ``positive`` describes a positive angle. The three angles of a joint make a rotation.
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
        """Describe number and names of the angles."""
        degrees = f"degrees: {len(self.time)} frames, {len(self.names)} angles"
        return ["joint angles", degrees, f"names: {', '.join(self.names[:3])} …"]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the ``N`` angles."""
        return tuple(definition.name for definition in self.definitions)

    def of(self, name: str) -> Array:
        """Return one angle ``(T,)`` in degrees.

        Raises:
            InputError: for an unknown name.
        """
        if name not in self.names:
            raise InputError(f"unknown joint angle '{name}': expected one of {', '.join(self.names)}")
        return self.degrees[:, self.names.index(name)]


@dataclass(frozen=True)
class _Joint:
    """Three angles between two segments.

    ``axes`` is an intrinsic sequence of the anatomical axes (x forward, y up, z right); ``angles`` are name, sign and
    meaning of a positive angle.
    """

    name: str
    above: str  # empty: the world
    below: str
    axes: str
    angles: tuple[tuple[str, int, str], ...]


_SPINE = (
    ("flexion", -1, "forward"),
    ("lateral_bending", 1, "to the right"),
    ("axial_rotation", 1, "to the left"),
)
_MIDDLE = (
    _Joint("pelvis", "", "pelvis", "yxz", (
        ("rotation", 1, "facing further to the left; 0 is along the world's x axis"),
        ("obliquity", 1, "right side lower"), ("tilt", -1, "forward (anterior)"))),
    _Joint("trunk", "pelvis", "spine3", "zxy", _SPINE),
    _Joint("neck", "spine3", "head", "zxy", _SPINE),
)  # fmt: skip
# Right side; left joints are mirrored.
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
        for joint in _SIDE:
            above = joint.above if joint.above in ("pelvis", "spine3") else f"{side}_{joint.above}"
            yield _Joint(f"{side}_{joint.name}", above, f"{side}_{joint.below}", joint.axes, joint.angles)


_JOINTS = tuple(_joints())
_BELOW = np.array([joint_index(joint.below) for joint in _JOINTS])
_ABOVE = np.array([joint_index(joint.above) if joint.above else -1 for joint in _JOINTS])
# Joints with the same sequence of axes.
_ALIKE = [[n for n, joint in enumerate(_JOINTS) if joint.axes == axes] for axes in ("yxz", "zxy", "yxy")]
# Signs of the axes: z is mirrored for left joints; x and z are reversed for elevation, which is a positive turn then.
_MIRRORED, _FROM_BEHIND = np.array([1.0, 1.0, -1.0]), np.array([-1.0, 1.0, -1.0])
_VIEWS = [
    (_MIRRORED if joint.name.startswith("left_") else 1.0) * (_FROM_BEHIND if joint.axes == "yxy" else np.ones(3))
    for joint in _JOINTS
]
_VIEW_SIGNS = np.stack([np.outer(signs, signs) for signs in _VIEWS])
_SIGNS = np.array([[1 if joint.axes == "yxy" else sign for _, sign, _ in joint.angles] for joint in _JOINTS])
ANGLE_DEFINITIONS: tuple[AngleDefinition, ...] = tuple(
    AngleDefinition(f"{joint.name}_{angle}", joint.name, positive)
    for joint in _JOINTS
    for angle, _, positive in joint.angles
)
"""All angles, in the order of their columns."""


def joint_angles(motion: Motion) -> JointAngles:
    """Compute the joint angles of a motion, in degrees.

    They lie within ±180°, except the pelvis' rotation, which is continuous over full turns. If the upper arm hangs or
    points straight up, only the sum of plane of elevation and axial rotation is determined; use the shoulder's
    ``flexion`` and ``adduction`` there. These and ``internal_rotation`` are angles of gait models, not ISB's, and are
    undetermined with the arm stretched out sideways.
    """
    degrees = angles_of_segments(segment_orientations(motion))
    degrees[:, 0] = np.unwrap(degrees[:, 0], period=360.0)
    return JointAngles(motion.time, ANGLE_DEFINITIONS, degrees)


def angles_of_segments(R_room_segment: Array) -> Array:
    """Compute angles ``(T, N)`` in degrees within ±180 from :func:`segment_orientations` ``(T, 24, 3, 3)``."""
    degrees = np.empty((len(R_room_segment), len(_JOINTS), 3))
    for joints in _ALIKE:
        degrees[:, joints] = np.rad2deg(_angles(joints, _between(joints, R_room_segment)))
    return degrees.reshape(len(degrees), -1)


def joint_angle_sigmas(motion: Motion, covariance: Array) -> Array:
    """Standard deviations ``(T, N)`` of the angles in degrees, to first order.

    ``covariance`` is ``(T, 24, 3, 3)`` rad², of right perturbations of the joint rotations. NaN for trunk, neck and
    shoulders, which span several joints with unknown correlations.
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


_STEP = 1e-5  # rad, of numerical differences


def _between(joints: Sequence[int], R_room_segment: Array) -> Array:
    """Rotations ``(T, J, 3, 3)`` of joints with the same axes from orientations ``(T, 24, 3, 3)``."""
    R = R_room_segment[:, _BELOW[joints]]
    return transpose(R_room_segment[:, _ABOVE[joints]]) @ R if _JOINTS[joints[0]].above else R


def _angles(joints: Sequence[int], R_above_below: Array) -> Array:
    """Angles ``(T, J, 3)`` in radians, with the defined signs, of joints with the same axes."""
    return sequence_of_rotation(R_above_below * _VIEW_SIGNS[joints], _JOINTS[joints[0]].axes) * _SIGNS[joints]


# x forward, y up, z right, as columns in the body's axes: x left, y up, z forward.
R_BODY_ISB = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
# The same for the world, whose z is up: x of the world, up, and right when facing x. OpenSim's ground has these axes.
R_WORLD_ISB = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def segment_axes(skeleton: Skeleton) -> Array:
    """Anatomical axes of each segment as columns in bone axes, ``(24, 3, 3)``."""
    R_bone_segment = _straight_limb_axes()
    for bone in range(JOINT_COUNT):
        limb = skeleton.limb(bone)
        if limb is not None:
            R_bone_segment[bone] = rotation_between(R_bone_segment[bone][:, 1], -limb) @ R_bone_segment[bone]
    return R_bone_segment


def _straight_limb_axes() -> Array:
    hanging, R_bone_segment = calibration_pose("n-pose"), np.empty((JOINT_COUNT, 3, 3))
    for bone, name in enumerate(JOINT_NAMES):
        side, _, joint = name.partition("_")
        R_bone_segment[bone] = R_BODY_ISB
        if joint in ("shoulder", "elbow", "wrist", "hand"):
            R_bone_segment[bone] = hanging[joint_index(f"{side}_shoulder")].T @ R_BODY_ISB
        if joint in ("elbow", "wrist", "hand"):  # with the palm at the thigh the forearm is pronated by 90°
            R_bone_segment[bone] = R_bone_segment[bone] @ rotation_y(-np.pi / 2 if side == "left" else np.pi / 2)
    return R_bone_segment


def segment_orientations(motion: Motion) -> Array:
    """Orientations ``(T, 24, 3, 3)`` of the segments' anatomical axes in the room (y up, :data:`R_WORLD_ISB`)."""
    return R_WORLD_ISB.T @ motion.state.R_world_bone @ segment_axes(motion.skeleton)


def mirrored(R: Array) -> Array:
    """Mirror rotations ``(..., 3, 3)`` of segments to the other side."""
    return R * np.outer(_MIRRORED, _MIRRORED)


# The two segments of each joint; any bone of the trunk measures it.
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
    """Test if both segments of an angle have sensors on the named bones; True if ``bones`` is None.

    ``angle`` names one side, ``left_hip_flexion``, or both, ``hip_flexion``.
    """
    return bones is None or not bare_segments(bones, angle)


def bare_segments(bones: Collection[str], angle: str) -> tuple[tuple[str, ...], ...]:
    """Segments of an angle without a sensor, each as its alternative bones, ``(left_ankle, left_foot)``."""
    side, _, angle_name = angle.partition("_")
    sides, name = ((side,), angle_name) if side in ("left", "right") else (("left", "right"), angle)
    ends = (
        tuple(template.format(side) for template in end) for end in _BETWEEN[name.partition("_")[0]] for side in sides
    )
    return tuple(dict.fromkeys(end for end in ends if not any(bone in bones for bone in end)))
