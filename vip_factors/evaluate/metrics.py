"""Errors of pose and path: which joints each published metric averages over, the common frames, and the metrics.

All metrics take an estimate and the truth at the same frames, each with its own skeleton (see :func:`common_frames`,
the one place where evaluation interpolates). Joints of which the truth knows nothing are left out of every mean.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import JOINT_NAMES, PARENTS, joint_index, joints_placed_by
from vip_factors.errors import InputError
from vip_factors.geometry.poses import Alignment, align_rigid, align_similarity, align_yaw
from vip_factors.geometry.rotations import Array, angle_between


@dataclass(frozen=True)
class Metric:
    """A number with its unit (``""`` for a ratio); NaN where it is not defined for this recording."""

    value: float
    unit: str


def _both_sides(*names: str) -> tuple[str, ...]:
    return tuple(f"{side}_{name}" for name in names for side in ("left", "right"))


# MPJPE of VIP and SIP (thesis 2.5.2): 14 joints.
POSITION_JOINTS = (*_both_sides("hip", "knee", "ankle"), "neck", "head", *_both_sides("shoulder", "elbow", "wrist"))
# MPJAE of VIP and SIP (thesis 2.5.2): 9 joints.
ORIENTATION_JOINTS = (*_both_sides("hip", "knee"), "neck", *_both_sides("shoulder", "elbow"))
# SIP error, as published by TransPose, PIP and their successors: thighs and upper arms.
SIP_JOINTS = _both_sides("hip", "shoulder")
# Kaichi et al. average over 16 joints without naming them: the 14 and the ends of the trunk's two halves are ours.
GLOBAL_JOINTS = ("pelvis", "spine3", *POSITION_JOINTS)
FEET = _both_sides("foot")


def indices(names: tuple[str, ...]) -> list[int]:
    """Their rows in a motion's joint axis."""
    return [joint_index(name) for name in names]


@dataclass(frozen=True)
class Compared:
    """Which of the joints that a metric averages over are compared: those of which the truth knows anything.

    Attributes:
        bones: names of the bones whose motion the truth knows; None: all.
    """

    bones: frozenset[str] | None = None

    def orientations(self, names: tuple[str, ...] = JOINT_NAMES) -> list[int]:
        """Rows of those bones among the named ones whose turn is known."""
        return [row for row in indices(names) if self.bones is None or JOINT_NAMES[row] in self.bones]

    def positions(self, names: tuple[str, ...] = JOINT_NAMES) -> list[int]:
        """Rows of those joints among the named ones whose place is known: they sit on the bone above."""
        return joints_placed_by(self.bones, indices(names))


EVERYTHING = Compared()


TIME_TOLERANCE = 1e-6  # seconds: rounding of frame times in files


def resample(motion: Motion, start: float, rate: float, count: int) -> Motion:
    """The motion at ``count`` frames from ``start`` on, every joint by slerp and the root linearly.

    Raises:
        InputError: where a frame lies outside the motion.
    """
    time = start + np.arange(count) / rate
    start_time, end_time = motion.time[[0, -1]]
    if count < 1 or time[0] < start_time - TIME_TOLERANCE or time[-1] > end_time + TIME_TOLERANCE:
        raise InputError(
            f"motion '{motion.name}' lasts from {start_time:.3f} to {end_time:.3f} s: cannot give {count} frames from "
            f"{start:.3f} s at {rate:g} Hz"
        )
    return Motion(motion.skeleton, *motion.poses_at(time), rate, start, motion.name)


def common_frames(estimate: Motion, truth: Motion) -> tuple[Motion, Motion, slice]:
    """Both motions at those frames of the estimate that lie within the truth; skeletons stay each one's own.

    Returns:
        The estimate (its own frames, never interpolated), the truth at the same times, and which frames of the
        estimate they are.

    Raises:
        InputError: if they do not overlap, or one is empty.
    """
    for motion, which in ((estimate, "estimate"), (truth, "truth")):
        if len(motion) == 0:
            raise InputError(f"{which} '{motion.name}' has no poses: expected at least one; is its file cut off?")
    inside = np.flatnonzero(
        (estimate.time >= truth.time[0] - TIME_TOLERANCE) & (estimate.time <= truth.time[-1] + TIME_TOLERANCE)
    )
    if len(inside) == 0:
        raise InputError(
            f"estimate ({estimate.time[0]:.3f} to {estimate.time[-1]:.3f} s) and truth ({truth.time[0]:.3f} to "
            f"{truth.time[-1]:.3f} s) share no frame: check that both use the recording's clock"
        )
    chosen = slice(int(inside[0]), int(inside[-1]) + 1)
    estimate_part = estimate.frames(chosen)
    return estimate_part, resample(truth, estimate_part.start, estimate_part.rate, len(estimate_part)), chosen


MM, CM = 1e3, 1e2
LEAST_JOINTS = 3  # fewer fix no alignment


def align_frames(estimate: Motion, truth: Motion, scale: bool = False, compared: Compared = EVERYTHING) -> Alignment:
    """Rigid motion (or similarity) of every frame that takes the estimate's 14 joints onto the truth's."""
    _same_frames(estimate, truth)
    joints = compared.positions(POSITION_JOINTS)
    if len(joints) < LEAST_JOINTS:
        raise InputError(f"the truth knows {len(joints)} of the compared joints: expected at least {LEAST_JOINTS}")
    align = align_similarity if scale else align_rigid
    return align(estimate.state.p_world_joint[:, joints], truth.state.p_world_joint[:, joints])


def position_error(estimate: Motion, truth: Motion, alignment: Alignment | None = None) -> Array:
    """Distance of every joint from its true place, ``(T, 24)`` metres, after an alignment if given."""
    _same_frames(estimate, truth)
    points = estimate.state.p_world_joint
    if alignment is not None:
        points = alignment.apply(points)
    return np.linalg.norm(points - truth.state.p_world_joint, axis=-1)


def orientation_error(estimate: Motion, truth: Motion, alignment: Alignment | None = None) -> Array:
    """Geodesic angle of every bone from its true world orientation, ``(T, 24)`` rad, after an alignment if given."""
    _same_frames(estimate, truth)
    R = estimate.state.R_world_bone
    if alignment is not None:
        R = alignment.R_target_source[:, None] @ R
    return angle_between(R, truth.state.R_world_bone)


def local_orientation_error(estimate: Motion, truth: Motion) -> Array:
    """Geodesic angle of every joint rotation (bone in its parent), ``(T, 24)`` rad; joint 0 is the pelvis's."""
    _same_frames(estimate, truth)
    return angle_between(estimate.R_parent_child, truth.R_parent_child)


def mpjpe(estimate: Motion, truth: Motion, compared: Compared = EVERYTHING) -> float:
    """Mean per-joint position error in mm: 14 joints, rigid alignment of every frame (thesis eq. 2.72)."""
    error = position_error(estimate, truth, align_frames(estimate, truth, compared=compared))
    return float(MM * error[:, compared.positions(POSITION_JOINTS)].mean())


def mpjpe_offsets_removed(estimate: Motion, truth: Motion, compared: Compared = EVERYTHING) -> float:
    """As :func:`mpjpe`, in mm, without the mean offset of each joint in the axes of the true bone above it.

    Two skeletons that define a joint at different points of a bone differ by such an offset.
    """
    alignment, joints = align_frames(estimate, truth, compared=compared), compared.positions(POSITION_JOINTS)
    difference = alignment.apply(estimate.state.p_world_joint) - truth.state.p_world_joint
    above = [max(PARENTS[joint], 0) for joint in joints]
    offset = np.einsum("tjik,tji->tjk", truth.state.R_world_bone[:, above], difference[:, joints])
    return float(MM * np.linalg.norm(offset - offset.mean(axis=0), axis=-1).mean())


def pa_mpjpe(estimate: Motion, truth: Motion, compared: Compared = EVERYTHING) -> float:
    """As :func:`mpjpe` with scale, in mm."""
    error = position_error(estimate, truth, align_frames(estimate, truth, True, compared))
    return float(MM * error[:, compared.positions(POSITION_JOINTS)].mean())


def mpjae(estimate: Motion, truth: Motion, compared: Compared = EVERYTHING) -> float:
    """Mean angular error in degrees: world orientation of 9 bones after the alignment of :func:`mpjpe` (eq. 2.73)."""
    error = orientation_error(estimate, truth, align_frames(estimate, truth, compared=compared))
    return float(np.rad2deg(error[:, compared.orientations(ORIENTATION_JOINTS)].mean()))


def sip_error(estimate: Motion, truth: Motion, compared: Compared = EVERYTHING) -> float:
    """Mean angular error in degrees of thighs and upper arms in the world (SIP error), after one yaw of all frames.

    NaN if the truth knows none of these bones.
    """
    bones = compared.orientations(SIP_JOINTS)
    if not bones:
        return float("nan")
    points, reference = (
        motion.state.p_world_joint[:, compared.positions()].reshape(-1, 3) for motion in (estimate, truth)
    )
    R_world_bone = align_yaw(points, reference).R_target_source @ estimate.state.R_world_bone[:, bones]
    return float(np.rad2deg(angle_between(R_world_bone, truth.state.R_world_bone[:, bones]).mean()))


def local_mpjae(estimate: Motion, truth: Motion, compared: Compared = EVERYTHING) -> float:
    """Mean angular error in degrees of the same 9 joints, each relative to its parent."""
    return float(
        np.rad2deg(local_orientation_error(estimate, truth)[:, compared.orientations(ORIENTATION_JOINTS)].mean())
    )


def root_relative_mpjpe(estimate: Motion, truth: Motion, compared: Compared = EVERYTHING) -> float:
    """Mean position error in mm over 24 joints, the pelvis subtracted, nothing turned (3DPW)."""
    _same_frames(estimate, truth)
    points, reference = estimate.state.p_world_joint, truth.state.p_world_joint
    difference = (points - points[:, :1]) - (reference - reference[:, :1])
    return float(MM * np.linalg.norm(difference, axis=-1)[:, compared.positions()].mean())


def global_position_error(estimate: Motion, truth: Motion, compared: Compared = EVERYTHING) -> float:
    """Mean position error in cm over 16 joints, nothing aligned (Kaichi et al.)."""
    return float(CM * position_error(estimate, truth)[:, compared.positions(GLOBAL_JOINTS)].mean())


def _same_frames(estimate: Motion, truth: Motion) -> None:
    if len(estimate) != len(truth) or abs(estimate.rate - truth.rate) > 1e-6 * truth.rate:
        raise InputError(
            f"estimate has {len(estimate)} frames at {estimate.rate:g} Hz, truth {len(truth)} at {truth.rate:g} Hz: "
            "expected the same frames; see common_frames"
        )


CHUNK = 100  # frames, as WHAM and its successors take


def root_translation_error(estimate: Motion, truth: Motion) -> tuple[float, float]:
    """Mean error of the root after a rigid alignment of the whole path: in cm, and in % of the true path length.

    The percentage is NaN for a root that stays within 10 cm of path.
    """
    points, reference = estimate.state.p_world_joint[:, 0], truth.state.p_world_joint[:, 0]
    error = np.linalg.norm(align_rigid(points, reference).apply(points) - reference, axis=-1).mean()
    length = np.linalg.norm(np.diff(reference, axis=0), axis=-1).sum()
    path_min_m = 0.1  # a root that moves less has no path to take a percentage of
    return float(CM * error), float(100 * error / length) if length > path_min_m else float("nan")


def yaw_aligned_position_error(estimate: Motion, truth: Motion, compared: Compared = EVERYTHING) -> float:
    """Mean position error in cm over 24 joints after one yaw and one translation for all frames.

    Exactly the gauge of an inertial reconstruction is removed: what is left is pose, drift and tilt.
    """
    points, reference = (
        motion.state.p_world_joint[:, compared.positions()].reshape(-1, 3) for motion in (estimate, truth)
    )
    moved = align_yaw(points, reference).apply(points)
    return float(CM * np.linalg.norm(moved - reference, axis=-1).mean())


def w_mpjpe(estimate: Motion, truth: Motion, compared: Compared = EVERYTHING) -> float:
    """World MPJPE in mm: chunks of 100 frames, similarity fitted on each one's first two frames; 24 joints."""
    return _chunked(estimate, truth, compared, lambda points: points[:2])


def wa_mpjpe(estimate: Motion, truth: Motion, compared: Compared = EVERYTHING) -> float:
    """World-aligned MPJPE in mm: chunks of 100 frames, similarity fitted on the whole chunk; 24 joints."""
    return _chunked(estimate, truth, compared, lambda points: points)


def _chunked(estimate: Motion, truth: Motion, compared: Compared, fitted: Callable[[Array], Array]) -> float:
    points, reference = (motion.state.p_world_joint[:, compared.positions()] for motion in (estimate, truth))
    errors = []
    for first_frame in range(0, len(points), CHUNK):
        chunk, target = points[first_frame : first_frame + CHUNK], reference[first_frame : first_frame + CHUNK]
        alignment = align_similarity(fitted(chunk).reshape(-1, 3), fitted(target).reshape(-1, 3))
        moved = alignment.apply(chunk.reshape(-1, 3)).reshape(target.shape)
        errors.append(np.linalg.norm(moved - target, axis=-1))
    return float(MM * np.concatenate(errors).mean())


def jitter(motion: Motion) -> float:
    """Mean norm of the third derivative of the 24 joint positions in m/s³: third difference × fps³.

    NaN for fewer than four frames.
    """
    if len(motion) < 4:
        return float("nan")
    jerk = np.diff(motion.state.p_world_joint, n=3, axis=0) * motion.rate**3
    return float(np.linalg.norm(jerk, axis=-1).mean())


def foot_sliding(estimate: Motion, truth: Motion, compared: Compared = EVERYTHING) -> float:
    """Mean displacement per frame of the estimated foot joints, in mm, while the true ones move less than 1 cm.

    It depends on the frame rate, as published. NaN if the true feet never stand, or are not known.
    """
    feet = compared.positions(FEET)
    moved, reference = (
        np.linalg.norm(np.diff(motion.state.p_world_joint[:, feet], axis=0), axis=-1) for motion in (estimate, truth)
    )
    still_m = 0.01  # per frame: a true foot slower than this stands
    still = reference < still_m
    return float(MM * moved[still].mean()) if np.any(still) else float("nan")
