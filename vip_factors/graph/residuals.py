"""The residuals of one kind of factor, of all frames at once."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vip_factors.factors.robust import RobustLoss
from vip_factors.geometry.rotations import Array


@dataclass(frozen=True)
class Residuals:
    """``n`` factors in each of ``t`` frames.

    Attributes:
        kind: of factor.
        residual: ``(t, n, m)``, whitened.
        confidence: ``(t, n)``, dividing the variance; zero where the factor does not exist.
        loss: of the norm of each residual.
    """

    kind: str
    residual: Array
    confidence: np.ndarray | float
    loss: RobustLoss

    @cached_property
    def norm(self) -> Array:
        """Norms ``(t, n)`` of the whitened residuals."""
        return np.sqrt(self.confidence * np.einsum("tni,tni->tn", self.residual, self.residual))

    @property
    def cost(self) -> float:
        """Sum of the losses."""
        return float(np.sum(self.loss.cost(self.norm)))

    @property
    def weight(self) -> Array:
        """Weights ``(t, n)`` on the squared residuals in the normal equations."""
        return self.confidence * self.loss.weight(self.norm)


@dataclass(frozen=True)
class MotionResiduals(Residuals):
    """Factors on ``n`` points over three frames, each counted by the frame it is centred on.

    Attributes:
        start: frame of the first.
        sites: which of all points, in their order.
        coefficients: ``(3,)`` of the points' positions before, now and after, whitened.
        by_heading: ``(t, n, 3)`` derivative by each sensor's heading, whitened, or None.
    """

    start: int
    sites: slice
    coefficients: Array
    by_heading: Array | None = None
