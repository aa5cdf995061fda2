"""Gaussian pose prior over joint rotations (thesis eqs. 3.14, 3.28), joint limits (thesis eq. 3.15) and hinges.

Limits are the ranges of motion of the American Academy of Orthopaedic Surgeons ("Joint Motion: Method of Measuring and
Recording", 1965; tabulated with later measurements by Norkin & White, "Measurement of Joint Motion"), in body axes: x
to the wearer's left, y up, z forward, T-pose at identity. They are wider than the table for two reasons: coordinates of
a rotation vector are not clinical angles if a joint moves about several axes (shoulders), and the bend of trunk and
neck may be shared among joints in different ways. Elbows and knees are hinges, whose axes vary between people.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path

import numpy as np

from vip_factors.body.skeleton import JOINT_COUNT, JOINT_NAMES, joint_index
from vip_factors.errors import InputError
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

    Attributes:
        mean: ``(69,)`` radians.
        whitening: ``(69, 69)`` per radian: ``L`` with ``Σ⁻¹ = Lᵀ L`` (thesis eq. 3.28).
        provenance: one line: data, number of frames, what was held out.
    """

    mean: Array
    whitening: Array
    provenance: str = "unknown"

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


LEFT, DOWN, UP, FORWARD = (1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)

# The carrying angle of elbows varies by about 8°, half of it a tilt of the axis; knees vary as much between bow-legged
# and knock-kneed people. A skeleton's zero of rotation about the limb is as uncertain.
AXIS_SIGMA_DEG = 5.0
OFFSET_SIGMA_DEG = 5.0


@dataclass(frozen=True)
class Hinge:
    """Joint that turns about an axis fixed in the upper bone.

    Attributes:
        joint: name of the joint.
        axis: ``(3,)`` usual axis in the upper bone.
        normals: ``(3, 2)`` directions of its tilts.
        square: ``(3, n)`` directions in the lower bone that stay perpendicular to the axis: along the limb, and one
            across it unless the lower bone can rotate about itself.
        rows: rows of these directions among those of all hinges.
        tilts: columns of the tilts among the variables of all hinges.
    """

    joint: str
    axis: Array
    normals: Array
    square: Array
    rows: slice
    tilts: slice

    @property
    def columns(self) -> np.ndarray:
        """Columns among the variables of all hinges: two tilts, then an offset for each row."""
        rows = np.arange(self.rows.start, self.rows.stop)
        return np.concatenate([np.arange(self.tilts.start, self.tilts.stop), TILTS + rows])

    @property
    def index(self) -> int:
        """Number of the joint in the skeleton."""
        return joint_index(self.joint)

    def direction(self, tilt: Array) -> Array:
        """Unit axis ``(3,)`` tilted by ``(2,)`` radians."""
        long = self.axis + self.normals @ tilt
        return long / np.linalg.norm(long)

    def tilt_to(self, axis: Array) -> Array:
        """Tilt ``(2,)`` of an axis ``(3,)`` within a right angle of the usual one."""
        return np.asarray(self.normals.T @ axis / (self.axis @ axis))

    def direction_by_tilt(self, tilt: Array) -> Array:
        """Derivative ``(3, 2)`` of :meth:`direction`."""
        long = self.axis + self.normals @ tilt
        length = np.linalg.norm(long)
        unit = long / length
        return (np.eye(3) - np.outer(unit, unit)) @ self.normals / length

    def carrying_angle(self, tilt: Array, offset: float) -> float:
        """Outward angle in radians of the stretched lower limb relative to the upper one.

        ``offset`` is the sine of the lower limb's angle to the plane of flexion; the upper limb's angle to it follows
        from the axis's ``tilt``, ``(2,)`` radians.
        """
        outwards = 1.0 if self.joint.startswith("left") else -1.0
        upper = float(self.direction(tilt) @ self.square[:, 0])
        return outwards * float(np.arcsin(np.clip(offset, -1.0, 1.0)) - np.arcsin(upper))


def _hinges() -> tuple[Hinge, ...]:
    elbow = (UP, (LEFT, FORWARD), (LEFT,))  # pronation is free
    knee = (LEFT, (UP, FORWARD), (DOWN, FORWARD))
    hinges, row = list[Hinge](), 0
    for name, (axis, normals, square) in (("elbow", elbow), ("knee", knee)):
        for side in ("left", "right"):
            rows = slice(row, row + len(square))
            tilts = slice(2 * len(hinges), 2 * len(hinges) + 2)
            hinges.append(Hinge(f"{side}_{name}", np.array(axis), np.array(normals).T, np.array(square).T, rows, tilts))
            row = rows.stop
    return tuple(hinges)


HINGES = _hinges()
HINGE_OF = {hinge.joint: hinge for hinge in HINGES}
ROWS = HINGES[-1].rows.stop
# Variables: two tilts of each hinge's axis, then an offset for each row.
TILTS = 2 * len(HINGES)
HINGE_VARIABLES = TILTS + ROWS
HINGE_SIGMAS = np.radians(np.repeat([AXIS_SIGMA_DEG, OFFSET_SIGMA_DEG], [TILTS, ROWS]))


# rad, lower bound for any combination of an estimated hinge's variables: the upper bone's axes depend on its sensor's
# mounting, which differs by some degrees each time that it is strapped on
LEAST_SIGMA = np.deg2rad(3.0)


@dataclass(frozen=True)
class HingeEstimate:
    """Estimated axis of an elbow or a knee.

    Attributes:
        joint: name of the joint.
        variables: ``(n,)`` radians: two tilts of its axis, then an offset for each row (:data:`HINGES`).
        covariance: ``(n, n)`` rad²; NaN if unknown.
    """

    joint: str
    variables: Array
    covariance: Array

    def __post_init__(self) -> None:
        if self.joint not in HINGE_OF:
            raise InputError(f"'{self.joint}' is no hinge: expected one of {', '.join(HINGE_OF)}")
        count = len(self.hinge.columns)
        if self.variables.shape != (count,) or self.covariance.shape != (count, count):
            raise InputError(
                f"hinge {self.joint} has {len(self.variables)} variables and a covariance of shape "
                f"{self.covariance.shape}: expected {count} and ({count}, {count})"
            )

    @property
    def hinge(self) -> Hinge:
        """Definition of the joint's hinge."""
        return HINGE_OF[self.joint]

    @property
    def axis(self) -> Array:
        """Unit axis ``(3,)`` in the upper bone."""
        return self.hinge.direction(self.variables[:2])

    @property
    def sigma(self) -> Array:
        """Standard deviations ``(2,)`` of the tilts in radians."""
        return np.sqrt(np.diag(self.covariance)[:2])

    @property
    def carrying_angle(self) -> float:
        """Outward angle of the stretched lower limb in radians: carrying angle of an elbow, valgus of a knee."""
        return self.hinge.carrying_angle(self.variables[:2], float(self.variables[2]))

    @property
    def carrying_sigma(self) -> float:
        """Standard deviation of the carrying angle in radians."""
        by_variables = np.zeros(len(self.variables))
        by_variables[:2] = -self.hinge.square[:, 0] @ self.hinge.direction_by_tilt(self.variables[:2])
        by_variables[2] = 1.0
        return float(np.sqrt(by_variables @ self.covariance @ by_variables))


@dataclass(frozen=True)
class HingePrior:
    """Gaussian over the variables of all hinges, ``(H,)`` rad and ``(H, H)`` rad²; by default of the population."""

    mean: Array = field(default_factory=lambda: np.zeros(HINGE_VARIABLES))
    covariance: Array = field(default_factory=lambda: np.diag(HINGE_SIGMAS**2))

    @classmethod
    def about(cls, estimates: Sequence[HingeEstimate]) -> "HingePrior":
        """Make the prior from earlier estimates of some hinges, with sigmas of at least :data:`LEAST_SIGMA`."""
        usual = cls()
        mean, covariance = usual.mean, usual.covariance
        for estimate in estimates:
            values, vectors = np.linalg.eigh(estimate.covariance)
            columns = estimate.hinge.columns
            mean[columns] = estimate.variables
            covariance[np.ix_(columns, columns)] = (vectors * np.maximum(values, LEAST_SIGMA**2)) @ vectors.T
        return cls(mean, covariance)

    @property
    def whitening(self) -> Array:
        """Inverse square root ``(H, H)`` of the covariance, per radian."""
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self.covariance)))

    def hinges(self) -> tuple[HingeEstimate, ...]:
        """Marginal Gaussian of each hinge."""
        return hinge_estimates(self.mean, self.covariance)


def hinge_estimates(variables: Array, covariance: Array) -> tuple[HingeEstimate, ...]:
    """Split the variables ``(H,)`` of all hinges and their covariance ``(H, H)`` by hinge."""
    return tuple(
        HingeEstimate(hinge.joint, variables[hinge.columns], covariance[np.ix_(hinge.columns, hinge.columns)])
        for hinge in HINGES
    )
