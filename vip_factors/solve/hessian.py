"""Blocks of normal equations as GTSAM factors."""

import gtsam
import numpy as np

from vip_factors.geometry.rotations import Array


def coupling_factor(first_key: int, second_key: int, block: Array) -> gtsam.HessianFactor:
    """A block off the diagonal: a factor without a diagonal, which only the sum with others makes definite."""
    rows, columns = block.shape
    zero, none = np.zeros((rows, rows)), np.zeros(rows)
    return gtsam.HessianFactor(
        first_key, second_key, zero, block, none, np.zeros((columns, columns)), np.zeros(columns), 0.0
    )
