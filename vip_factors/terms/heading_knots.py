"""A heading between the knots of its walk: what orientation and acceleration factors see of it at their instant."""

import numpy as np

from vip_factors.geometry.rotations import Array


def knot_weights(knots: Array, time: Array) -> Array:
    """What each knot counts at each instant, ``(T, K)``: linear between neighbours, constant beyond the ends.

    Args:
        knots: ``(K,)`` ascending seconds.
        time: ``(T,)`` seconds.
    """
    return np.stack([np.interp(time, knots, unit) for unit in np.eye(len(knots))], axis=1)
