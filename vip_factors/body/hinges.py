"""Elbows and knees as hinges: the axis each turns about, how it varies between people, and the estimate of it."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from vip_factors.body.skeleton import joint_index
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array

LEFT, DOWN, UP, FORWARD = (1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)

# Degrees. The carrying angle of elbows is 8° more or less, half of it a tilt of the axis; knees differ as much between
# bow-legged and knock-kneed people. Where a skeleton's zero of turning about the limb is, is as uncertain.
AXIS_SIGMA_DEG = 5.0
OFFSET_SIGMA_DEG = 5.0


@dataclass(frozen=True)
class Hinge:
    """One joint that turns about an axis fixed in the bone above it.

    Attributes:
        joint: its name.
        axis: ``(3,)`` of it, usually, in the bone above.
        normals: ``(3, 2)`` the directions that it may be tilted to.
        square: ``(3, n)`` directions in the bone below that stay square to the axis: along the limb, and, where the
            bone below cannot turn about itself, one across.
        rows: of these among those of all hinges.
        tilts: of its axis among those of all hinges.
    """

    joint: str
    axis: Array
    normals: Array
    square: Array
    rows: slice
    tilts: slice

    @property
    def columns(self) -> np.ndarray:
        """Of its own variables among those of all hinges: two tilts, then an offset of each of its rows."""
        rows = np.arange(self.rows.start, self.rows.stop)
        return np.concatenate([np.arange(self.tilts.start, self.tilts.stop), TILTS + rows])

    @property
    def index(self) -> int:
        """Number of the joint in the skeleton."""
        return joint_index(self.joint)

    def direction(self, tilt: Array) -> Array:
        """The axis ``(3,)``, a unit vector, tilted by ``(2,)`` radians."""
        long = self.axis + self.normals @ tilt
        return long / np.linalg.norm(long)

    def tilt_to(self, axis: Array) -> Array:
        """The tilt ``(2,)`` of an axis ``(3,)`` that is less than a right angle off the usual one."""
        return np.asarray(self.normals.T @ axis / (self.axis @ axis))

    def direction_by_tilt(self, tilt: Array) -> Array:
        """Derivative ``(3, 2)`` of :meth:`direction`."""
        long = self.axis + self.normals @ tilt
        length = np.linalg.norm(long)
        unit = long / length
        return (np.eye(3) - np.outer(unit, unit)) @ self.normals / length

    def carrying_angle(self, tilt: Array, offset: float) -> float:
        """Radians by which the lower limb, stretched, is off the upper one's line, away from the body's middle.

        At rest both lie along the first of ``square``; ``offset`` is the sine of how far the lower one is off the plane
        that it bends in, and the upper one is off it by the axis's ``tilt``, ``(2,)`` radians.
        """
        outwards = 1.0 if self.joint.startswith("left") else -1.0
        upper = float(self.direction(tilt) @ self.square[:, 0])
        return outwards * float(np.arcsin(np.clip(offset, -1.0, 1.0)) - np.arcsin(upper))


def _hinges() -> tuple[Hinge, ...]:
    elbow = (UP, (LEFT, FORWARD), (LEFT,))  # the forearm turns about itself: pronation
    knee = (LEFT, (UP, FORWARD), (DOWN, FORWARD))
    found, row = list[Hinge](), 0
    for name, (axis, normals, square) in (("elbow", elbow), ("knee", knee)):
        for side in ("left", "right"):
            rows = slice(row, row + len(square))
            tilts = slice(2 * len(found), 2 * len(found) + 2)
            found.append(Hinge(f"{side}_{name}", np.array(axis), np.array(normals).T, np.array(square).T, rows, tilts))
            row = rows.stop
    return tuple(found)


HINGES = _hinges()
HINGE_OF = {one.joint: one for one in HINGES}
ROWS = HINGES[-1].rows.stop
# Of the variables: two tilts of each hinge's axis, then an offset of each row.
TILTS = 2 * len(HINGES)
HINGE_VARIABLES = TILTS + ROWS
HINGE_SIGMAS = np.radians(np.repeat([AXIS_SIGMA_DEG, OFFSET_SIGMA_DEG], [TILTS, ROWS]))


# rad: no combination of a found hinge's variables is taken to be known better. An axis is told in the bone above, and
# where that bone is, is a matter of its sensor's mounting: some degrees off, and anew with every strapping.
LEAST_SIGMA = np.deg2rad(3.0)


@dataclass(frozen=True)
class HingeEstimate:
    """The axis that an elbow or a knee was found to turn about.

    Attributes:
        joint: its name.
        variables: ``(n,)`` radians: two tilts of its axis, then an offset of each of its rows (:data:`HINGES`).
        covariance: ``(n, n)`` rad²; NaN if not known.
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
        """The joint's usual axis, and how it may tilt."""
        return HINGE_OF[self.joint]

    @property
    def axis(self) -> Array:
        """``(3,)`` unit vector in the bone above."""
        return self.hinge.direction(self.variables[:2])

    @property
    def sigma(self) -> Array:
        """``(2,)`` standard deviations in radians towards the directions that the axis may be tilted to."""
        return np.sqrt(np.diag(self.covariance)[:2])

    @property
    def carrying_angle(self) -> float:
        """Radians by which the lower limb, stretched, is off the upper one's line, outwards.

        The carrying angle of an elbow; of a knee, knock-kneed above and bow-legged below zero.
        """
        return self.hinge.carrying_angle(self.variables[:2], float(self.variables[2]))

    @property
    def carrying_sigma(self) -> float:
        """Standard deviation of the carrying angle, which is small, in radians."""
        by_variables = np.zeros(len(self.variables))
        by_variables[:2] = -self.hinge.square[:, 0] @ self.hinge.direction_by_tilt(self.variables[:2])
        by_variables[2] = 1.0
        return float(np.sqrt(by_variables @ self.covariance @ by_variables))


@dataclass(frozen=True)
class HingePrior:
    """A Gaussian over the variables of all hinges, ``(H,)`` radians and ``(H, H)`` rad²; of anybody, if nothing is
    said.
    """

    mean: Array = field(default_factory=lambda: np.zeros(HINGE_VARIABLES))
    covariance: Array = field(default_factory=lambda: np.diag(HINGE_SIGMAS**2))

    @classmethod
    def about(cls, estimates: Sequence[HingeEstimate]) -> "HingePrior":
        """Of somebody some of whose hinges were found before, on another recording; the others are anybody's.

        None is believed better than :data:`LEAST_SIGMA`.
        """
        usual = cls()
        mean, covariance = usual.mean, usual.covariance
        for one in estimates:
            values, vectors = np.linalg.eigh(one.covariance)
            columns = one.hinge.columns
            mean[columns] = one.variables
            covariance[np.ix_(columns, columns)] = (vectors * np.maximum(values, LEAST_SIGMA**2)) @ vectors.T
        return cls(mean, covariance)

    @property
    def whitening(self) -> Array:
        """``(H, H)`` per radian, the inverse square root of the covariance."""
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self.covariance)))

    def hinges(self) -> tuple[HingeEstimate, ...]:
        """The Gaussian of each hinge by itself."""
        return hinge_estimates(self.mean, self.covariance)


def hinge_estimates(variables: Array, covariance: Array) -> tuple[HingeEstimate, ...]:
    """Each hinge of the variables ``(H,)`` of all of them and their covariance ``(H, H)``."""
    return tuple(
        HingeEstimate(one.joint, variables[one.columns], covariance[np.ix_(one.columns, one.columns)]) for one in HINGES
    )
