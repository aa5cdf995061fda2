"""The Gaussian over bodies: how heavy people are and how long each of their lengths, and which go together."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from vip_factors.body.lengths import BODY_LENGTHS, STATURE
from vip_factors.body.npz_file import read_npz
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import Array

SHIPPED_BODY_PRIOR = Path(__file__).parent.parent / "data" / "body_prior.npz"
GROUPS = ("male", "female", "both")
VARIABLES = ("log mass", *BODY_LENGTHS)
SIZE = len(VARIABLES)
STATURE_ROW = np.concatenate([[0.0], STATURE])  # of the variables: stature is a sum of lengths


@dataclass(frozen=True)
class Observation:
    """A number that a linear combination ``row`` ``(22,)`` of the :data:`VARIABLES` is known by, with its standard
    deviation.
    """

    row: Array
    value: float
    sigma: float


@dataclass(frozen=True)
class BodyGaussian:
    """A Gaussian over the :data:`VARIABLES`, the mass's logarithm (kg) and the body's lengths in metres: mean ``(22,)``
    and covariance ``(22, 22)``.
    """

    mean: Array
    covariance: Array

    def __post_init__(self) -> None:
        mean, covariance = np.asarray(self.mean, float), np.asarray(self.covariance, float)
        if mean.shape != (SIZE,) or covariance.shape != (SIZE, SIZE):
            raise InputError(
                f"body prior: mean {mean.shape} and covariance {covariance.shape}: expected {SIZE} variables"
            )
        if not (np.all(np.isfinite(mean)) and np.all(np.isfinite(covariance))):
            raise InputError("body prior: mean or covariance holds a number that is not finite")
        object.__setattr__(self, "mean", mean)
        object.__setattr__(self, "covariance", covariance)

    @property
    def stature(self) -> tuple[float, float]:
        """Mean and standard deviation of stature in metres."""
        return float(STATURE_ROW @ self.mean), float(np.sqrt(STATURE_ROW @ self.covariance @ STATURE_ROW))

    def widened(self, factor: float) -> "BodyGaussian":
        """The same with every standard deviation ``factor`` times as large."""
        return BodyGaussian(self.mean, factor**2 * self.covariance)

    def given(self, observations: Sequence[Observation]) -> "BodyGaussian":
        """The Gaussian conditional on independent observations."""
        if not observations:
            return self
        rows = np.stack([one.row for one in observations])
        missed = np.array([one.value for one in observations]) - rows @ self.mean
        noise = np.diag([one.sigma**2 for one in observations])
        across = self.covariance @ rows.T
        gain = np.linalg.solve(rows @ across + noise, across.T).T
        # Joseph's form, which stays positive definite.
        kept = np.eye(SIZE) - gain @ rows
        covariance = kept @ self.covariance @ kept.T + gain @ noise @ gain.T
        return BodyGaussian(self.mean + gain @ missed, covariance)


@dataclass(frozen=True)
class BodyPrior:
    """Gaussians over men, women and both together, by name (:data:`GROUPS`); provenance is one line: data, number of
    people.
    """

    groups: Mapping[str, BodyGaussian]
    provenance: str = "unknown"

    def of(self, sex: str | None) -> BodyGaussian:
        """The Gaussian of ``"male"``, ``"female"`` or, for None, both together.

        Raises:
            InputError: for anything else.
        """
        if sex not in ("male", "female", None):
            raise InputError(f"sex '{sex}': expected 'male', 'female' or nothing")
        return self.groups[sex or "both"]


@cache
def _read(path: Path) -> BodyPrior:
    file = read_npz(path, "not a prior over bodies")
    try:
        if tuple(file["variables"].ravel().tolist()) != VARIABLES:
            raise ValueError("other variables")
        groups = {name: BodyGaussian(file[f"{name}_mean"], file[f"{name}_covariance"]) for name in GROUPS}
        return BodyPrior(groups, str(file["provenance"]))
    except (KeyError, TypeError, ValueError) as error:
        raise FileFormatError(
            f"{path}: not a prior over bodies ({error}); expected an npz with a mean ({SIZE},) and a covariance "
            f"({SIZE}, {SIZE}) of {', '.join(GROUPS)}, the variables' names and provenance, as the "
            "shipped file has them"
        ) from error


def load_body_prior(path: str | Path | None = None) -> BodyPrior:
    """A trained prior over bodies; the one shipped with the package if no path is given.

    Raises:
        FileFormatError: if the file is not one.
    """
    return _read(Path(path) if path is not None else SHIPPED_BODY_PRIOR)
