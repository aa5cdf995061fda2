"""Factors of one kind, evaluated for all frames at once: of one sensor or point where they belong to one."""

from dataclasses import dataclass

import numpy as np

from vip_factors.factors.robust import RobustLoss
from vip_factors.geometry.rotations import Array


@dataclass(frozen=True)
class PoseTerm:
    """Factors on single frames.

    Attributes:
        kind: of factor.
        residual: ``(T, m)``, whitened.
        mask: ``(T,)`` one where the factor exists, else zero.
        loss: of the norm of each residual.
        columns: ``(k,)`` that the residual depends on.
        jacobian: ``(T, m, k)`` of the whitened residual, or None if not asked for.
    """

    kind: str
    residual: Array
    mask: Array
    loss: RobustLoss
    columns: list[int]
    jacobian: Array | None

    @property
    def norm(self) -> Array:
        """Norms ``(T,)`` of the whitened residuals."""
        return np.linalg.norm(self.residual, axis=1)

    @property
    def cost(self) -> float:
        """Sum of the losses."""
        return float(self.mask @ self.loss.cost(self.norm))

    @property
    def weight(self) -> Array:
        """Weights ``(T,)`` on the squared residuals in the normal equations."""
        return self.mask * self.loss.weight(self.norm)


@dataclass(frozen=True)
class MotionTerm:
    """Factors on one point over three frames, each counted by the frame it is centred on.

    Attributes:
        kind: of factor.
        start: frame of the first.
        residual: ``(t, 3)``, whitened.
        mask: ``(t,)``, dividing the variance; zero where the factor does not exist.
        loss: of the norm of each residual.
        point: index into the sensors, then the contacts.
        coefficients: ``(3,)`` of the point's position before, now and after, whitened.
        by_heading: ``(t, 3)`` derivative by the sensor's heading, whitened, or None.
    """

    kind: str
    start: int
    residual: Array
    mask: Array
    loss: RobustLoss
    point: int
    coefficients: Array
    by_heading: Array | None

    @property
    def norm(self) -> Array:
        """Norms ``(t,)`` of the whitened residuals."""
        return np.sqrt(self.mask) * np.linalg.norm(self.residual, axis=1)

    @property
    def cost(self) -> float:
        """Sum of the losses."""
        return float(np.sum(self.loss.cost(self.norm)))

    @property
    def weight(self) -> Array:
        """Weights ``(t,)`` on the squared residuals in the normal equations."""
        return self.mask * self.loss.weight(self.norm)
