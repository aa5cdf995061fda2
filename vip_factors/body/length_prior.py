"""What is known of the lengths of a person whose body was found before: how far each of them may still be off."""

from dataclasses import dataclass

import numpy as np

from vip_factors.body.anthropometry import likely_body
from vip_factors.body.lengths import LENGTHS
from vip_factors.body.skeleton import Skeleton
from vip_factors.body.variation import BodyVariation
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array

# m: no combination of lengths is taken to be known better. Soft tissue and a detector's habits err alike in every
# frame, and what was found counts each of them as news.
LEAST_SIGMA = 0.003


@dataclass(frozen=True)
class LengthPrior:
    """A Gaussian about the lengths of a skeleton.

    Attributes:
        names: ``B`` of :data:`~vip_factors.body.lengths.LENGTHS`, or of another version's.
        covariance: ``(B, B)`` m², of changes of the skeleton.
    """

    names: tuple[str, ...]
    covariance: Array

    def __post_init__(self) -> None:
        covariance, count = np.asarray(self.covariance, dtype=float), len(self.names)
        if covariance.shape != (count, count) or len(set(self.names)) != count:
            raise InputError(f"covariance of {count} lengths has shape {covariance.shape}: expected ({count}, {count})")
        symmetric = np.all(np.isfinite(covariance)) and np.allclose(covariance, covariance.T, atol=1e-9)
        if not symmetric or np.any(np.diag(covariance) < 0):
            raise InputError("covariance of lengths: expected finite numbers, symmetric, with variances of 0 or more")
        object.__setattr__(self, "covariance", covariance)

    def variation(self, skeleton: Skeleton) -> BodyVariation:
        """How ``skeleton`` may change, and how likely: lengths without a name here as those of anybody else."""
        whole = likely_body(skeleton.stature).variation.covariance
        known = [(LENGTHS.index(name), place) for place, name in enumerate(self.names) if name in LENGTHS]
        if known:
            at, given = (np.array(column) for column in zip(*known, strict=True))
            whole[at, :] = whole[:, at] = 0.0
            whole[np.ix_(at, at)] = self.covariance[np.ix_(given, given)]
        values, vectors = np.linalg.eigh(whole)
        covariance = (vectors * np.maximum(values, LEAST_SIGMA**2)) @ vectors.T
        return BodyVariation.about_mean(skeleton, covariance)
