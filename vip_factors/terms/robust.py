"""Robust losses: what they cost, and what they weigh."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from vip_factors.geometry.rotations import Array


class Loss(StrEnum):
    """What becomes of a whitened residual's norm ``r`` beyond the tuning constant ``k``."""

    SQUARE = "square"
    HUBER = "huber"
    CAUCHY = "cauchy"


@dataclass(frozen=True)
class RobustLoss:
    """A loss of the norm of one whitened residual; ``k`` is in standard deviations."""

    loss: Loss = Loss.SQUARE
    k: float = 1.345

    def tempered(self, share: float) -> "RobustLoss":
        """``share`` times this loss, of residuals that are scaled by its root."""
        if self.loss is Loss.SQUARE:
            return self
        return RobustLoss(self.loss, float(self.k * np.sqrt(share)))

    def weight(self, norm: Array) -> Array:
        """Factor on the squared residual in the normal equations (IRLS), for norms of any shape."""
        if self.loss is Loss.HUBER:
            return np.minimum(1.0, self.k / np.maximum(norm, 1e-300))
        if self.loss is Loss.CAUCHY:
            return 1 / (1 + (norm / self.k) ** 2)
        return np.ones_like(norm)

    def cost(self, norm: Array) -> Array:
        """The loss itself: half the square near zero."""
        if self.loss is Loss.HUBER:
            return np.where(norm <= self.k, 0.5 * norm**2, self.k * (norm - 0.5 * self.k))
        if self.loss is Loss.CAUCHY:
            return 0.5 * self.k**2 * np.log1p((norm / self.k) ** 2)
        return 0.5 * norm**2


SQUARE = RobustLoss()
