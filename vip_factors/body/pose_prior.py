"""Gaussian pose prior over joint rotations (thesis eqs. 3.14, 3.28) and joint limits (thesis eq. 3.15).

Limits are the ranges of motion of the American Academy of Orthopaedic Surgeons ("Joint Motion: Method of Measuring and
Recording", 1965; tabulated with later measurements by Norkin & White, "Measurement of Joint Motion"), in body axes: x
to the wearer's left, y up, z forward, T-pose at identity. They are wider than the table for two reasons: coordinates of
a rotation vector are not clinical angles if a joint moves about several axes (shoulders), and the bend of trunk and
neck may be shared among joints in different ways.
"""

from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

import numpy as np

from vip_factors.body.skeleton import JOINT_COUNT, JOINT_NAMES
from vip_factors.geometry.rotations import Array, log

Range = tuple[float, float]

# Degrees about x, y, z of the left side and the middle; the right side is the mirror image.
RANGES_DEG: dict[str, tuple[Range, Range, Range]] = {
    # x: flexion 120 is negative, extension 30; y: external rotation positive 45; z: abduction positive 45
    "left_hip": ((-125, 35), (-50, 60), (-35, 60)),
    # x: flexion positive 140, hyperextension up to 10 but 1 to 6 on average; otherwise a hinge, with a little axial
    # rotation of the shank
    "left_knee": ((-5, 150), (-25, 25), (-15, 15)),
    # x: plantar flexion positive 50, dorsiflexion 20 to 30 with a bent knee; y: toes out; z: eversion positive 20,
    # inversion 35
    "left_ankle": ((-40, 55), (-30, 45), (-40, 30)),
    # x: toes bend up (negative) by 70 when the heel lifts
    "left_foot": ((-75, 45), (-15, 15), (-15, 15)),
    # whole trunk: flexion positive 80, extension 25, sideways 35, turning 45
    "spine1": ((-30, 60), (-30, 30), (-30, 30)),
    "spine2": ((-25, 45), (-30, 30), (-25, 25)),
    "spine3": ((-20, 40), (-25, 25), (-20, 20)),
    # neck and head together: flexion positive 45 to 60, extension 45 to 75, sideways 45, turning 60 to 80
    "neck": ((-40, 40), (-50, 50), (-35, 35)),
    "head": ((-50, 50), (-60, 60), (-40, 40)),
    # y: protraction negative; z: elevation positive 30, depression 10
    "left_collar": ((-25, 25), (-30, 25), (-15, 40)),
    # z: arm down negative 90, overhead positive 90 with the shoulder blade; y: forward across the chest negative 130
    "left_shoulder": ((-130, 90), (-140, 75), (-120, 100)),
    # y: flexion negative 150, hyperextension 10; x: pronation and supination 80, also in z for a bent elbow (the hinge
    # is another factor)
    "left_elbow": ((-85, 85), (-155, 15), (-85, 85)),
    # z: flexion negative 80, extension 70; y: towards the thumb negative 20, away 30; x: the forearm's rotation
    "left_wrist": ((-90, 90), (-30, 40), (-85, 75)),
    # knuckles: flexion negative
    "left_hand": ((-15, 15), (-20, 20), (-90, 30)),
}  # fmt: skip
POSE_SIZE = 3 * (JOINT_COUNT - 1)
SHIPPED_PRIOR = Path(__file__).parent.parent / "data" / "pose_prior.npz"


@dataclass(frozen=True)
class PosePrior:
    """Gaussian over the joint rotations of a pose, with the residual ``whitening @ (x − mean)``.

    ``x`` is the stack of rotation vectors Log(R_parent_child) of joints 1 … 23, in radians (:func:`joint_vector`).
    """

    mean: Array  # (69,) radians
    whitening: Array  # (69, 69) per radian: L with Σ⁻¹ = Lᵀ L (thesis eq. 3.28).
    provenance: str = "unknown"  # one line: data, number of frames, what was held out

    def residual(self, x: Array) -> Array:
        """Whitened deviation ``(..., 69)`` of joint vectors ``(..., 69)``: unit variance where the prior holds."""
        return (x - self.mean) @ self.whitening.T

    @cached_property
    def information(self) -> Array:
        """Inverse covariance ``(69, 69)``, ``Lᵀ L``."""
        return self.whitening.T @ self.whitening


def joint_vector(R_parent_child: Array) -> Array:
    """Stacked rotation vectors ``(..., 69)`` in radians of joints 1 … 23, from rotations ``(..., 24, 3, 3)``."""
    return log(R_parent_child[..., 1:, :, :]).reshape(*R_parent_child.shape[:-3], POSE_SIZE)


def mirror_joint_vector(x: Array) -> Array:
    """Mirror a pose ``(..., 69)``: exchange the sides, and (x, y, z) → (x, −y, −z)."""
    vectors = np.asarray(x, float).reshape(*np.shape(x)[:-1], JOINT_COUNT - 1, 3)
    mirrored_names = [name.replace("left_", "_").replace("right_", "left_") for name in JOINT_NAMES[1:]]
    swapped = [JOINT_NAMES.index(f"right{name}" if name[0] == "_" else name) - 1 for name in mirrored_names]
    return (vectors[..., swapped, :] * np.array([1.0, -1.0, -1.0])).reshape(np.shape(x))


@cache
def load_pose_prior(path: Path = SHIPPED_PRIOR) -> PosePrior:
    """Load a trained prior, by default the one shipped with the package."""
    with np.load(path) as file:
        return PosePrior(file["mean"].astype(float), file["whitening"].astype(float), str(file["provenance"]))


@dataclass(frozen=True)
class JointLimits:
    """Bounds ``(69,)`` in radians of the stacked rotation vectors of joints 1 … 23."""

    lower: Array
    upper: Array

    def violation(self, x: Array) -> Array:
        """Signed distance of joint vectors ``(..., 69)`` from the limits in radians; zero inside."""
        return np.minimum(x - self.lower, 0.0) + np.maximum(x - self.upper, 0.0)

    def reaching(self, x: Array, tolerance: float) -> "JointLimits":
        """Limits that leave room for what most of the joint vectors ``(T, 69)`` do beyond these, by the median and by
        more than ``beyond``, in radians.
        """
        outside = self.violation(x)
        is_exceeded = np.where(np.abs(np.median(outside, axis=0)) > tolerance, 1.0, 0.0)
        return JointLimits(
            self.lower + is_exceeded * outside.min(axis=0), self.upper + is_exceeded * outside.max(axis=0)
        )


def load_joint_limits() -> JointLimits:
    """Load the limits of a healthy adult, alike on both sides."""
    lower, upper = np.zeros((2, len(JOINT_NAMES) - 1, 3))
    for name, ranges in RANGES_DEG.items():
        lower[JOINT_NAMES.index(name) - 1], upper[JOINT_NAMES.index(name) - 1] = np.radians(ranges).T
    mirrored = mirror_joint_vector(np.stack([lower.ravel(), upper.ravel()])).reshape(2, -1, 3)
    right = [joint - 1 for joint, name in enumerate(JOINT_NAMES) if name.startswith("right_")]
    lower[right] = np.minimum(*mirrored[:, right])
    upper[right] = np.maximum(*mirrored[:, right])
    return JointLimits(lower.ravel(), upper.ravel())
