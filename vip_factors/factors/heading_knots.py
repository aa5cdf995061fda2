"""A heading between the knots of its walk: what orientation and acceleration factors see of it at their instant."""

from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np

from vip_factors.geometry.rotations import Array


def knot_weights(knots: Array, time: Array) -> Array:
    """What each knot counts at each instant, ``(T, K)``: linear between neighbours, constant beyond the ends.

    Args:
        knots: ``(K,)`` ascending seconds.
        time: ``(T,)`` seconds.
    """
    return np.stack([np.interp(time, knots, unit) for unit in np.eye(len(knots))], axis=1)


@dataclass(frozen=True)
class HeadingAt:
    """One sensor's heading at one instant: a weighted sum of knots, whose GTSAM keys these are."""

    keys: Sequence[int]
    weights: Sequence[float]

    def value(self, values: gtsam.Values) -> float:
        """The heading in radians."""
        return float(sum(weight * values.atDouble(key) for key, weight in zip(self.keys, self.weights, strict=True)))

    def blocks(self, by_heading: Array) -> list[Array]:
        """A derivative ``(m,)`` by the heading, as blocks ``(m, 1)`` by each knot."""
        return [weight * by_heading[:, None] for weight in self.weights]


def heading_at(heading: int | HeadingAt) -> HeadingAt:
    """A constant heading is a single key."""
    return heading if isinstance(heading, HeadingAt) else HeadingAt((heading,), (1.0,))
