"""Elbows and knees as hinges: their axes, the variation between people, and estimates."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from vip_factors.body.skeleton import joint_index
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array

LEFT, DOWN, UP, FORWARD = (1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)

# The carrying angle of elbows varies by about 8°, half of it a tilt of the axis; knees vary as much between bow-legged
# and knock-kneed people. A skeleton's zero of rotation about the limb is as uncertain.
AXIS_SIGMA_DEG = 5.0
OFFSET_SIGMA_DEG = 5.0


@dataclass(frozen=True)
class Hinge:
    """Joint that turns about an axis fixed in the upper bone."""

    joint: str  # name of the joint
    axis: Array  # (3,) usual axis in the upper bone
    normals: Array  # (3, 2) directions of its tilts
    # (3, n) directions in the lower bone that stay perpendicular to the axis: along the limb, and one across it unless
    # the lower bone can rotate about itself
    square: Array
    rows: slice  # rows of these directions among those of all hinges
    tilts: slice  # columns of the tilts among the variables of all hinges

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
    """Estimated axis of an elbow or a knee."""

    joint: str  # name of the joint
    variables: Array  # (n,) radians: two tilts of its axis, then an offset for each row (HINGES)
    covariance: Array  # (n, n) rad²; NaN if unknown

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
