"""Axes of elbows and knees as they were found, and what is taken for likely of them."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from vip_factors.body.hinges import HINGE_OF, HINGE_SIGMAS, HINGE_VARIABLES, HINGES, Hinge
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array

# rad: no combination of a found hinge's variables is taken to be known better. An axis is told in the bone above, and
# where that bone is, is a matter of its sensor's mounting: some degrees off, and anew with every strapping.
LEAST_SIGMA = np.deg2rad(3.0)


@dataclass(frozen=True)
class HingeEstimate:
    """The axis that an elbow or a knee was found to turn about.

    Attributes:
        joint: its name.
        variables: ``(n,)`` radians: two tilts of its axis, then an offset of each of its rows
            (:data:`~vip_factors.body.hinges.HINGES`).
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
        """What it may do."""
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
    """A Gaussian over the variables of all hinges; of anybody, if nothing is said.

    Attributes:
        mean: ``(H,)`` radians.
        covariance: ``(H, H)`` rad².
    """

    mean: Array = field(default_factory=lambda: np.zeros(HINGE_VARIABLES))
    covariance: Array = field(default_factory=lambda: np.diag(HINGE_SIGMAS**2))

    @classmethod
    def about(cls, found: Sequence[HingeEstimate]) -> "HingePrior":
        """Of somebody some of whose hinges were found before, on another recording; the others are anybody's.

        None is believed better than :data:`LEAST_SIGMA`.
        """
        usual = cls()
        mean, covariance = usual.mean, usual.covariance
        for one in found:
            values, vectors = np.linalg.eigh(one.covariance)
            columns = one.hinge.columns
            mean[columns] = one.variables
            covariance[np.ix_(columns, columns)] = (vectors * np.maximum(values, LEAST_SIGMA**2)) @ vectors.T
        return cls(mean, covariance)

    @property
    def whitening(self) -> Array:
        """``(H, H)`` per radian."""
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self.covariance)))

    def hinges(self) -> tuple[HingeEstimate, ...]:
        """One by one."""
        return hinge_estimates(self.mean, self.covariance)


def hinge_estimates(variables: Array, covariance: Array) -> tuple[HingeEstimate, ...]:
    """Each hinge of the variables ``(H,)`` of all of them and their covariance ``(H, H)``."""
    return tuple(
        HingeEstimate(one.joint, variables[one.columns], covariance[np.ix_(one.columns, one.columns)]) for one in HINGES
    )
