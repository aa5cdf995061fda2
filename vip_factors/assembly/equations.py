"""What a term says, in one of a few shapes: residuals of all its factors at once, and their derivatives when asked for.

A term has ``n`` factors in each of ``t`` successive frames, the first of which is ``first``. Shapes differ in what the
factors see: bones and points of a body in one frame, points moving over frames, joints, or plain columns.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from vip_factors.geometry.rotations import Array
from vip_factors.problem.layout import OwnerId
from vip_factors.terms.robust import RobustLoss

AT_THE_FIRST_KNOT = -1


@dataclass(frozen=True)
class Residuals:
    """``n`` factors in each of ``t`` frames.

    Attributes:
        kind: of factor.
        first: frame of the first.
        residual: ``(t, n, m)``, whitened.
        confidence: ``(t, n)``, dividing the variance; zero where the factor does not exist.
        loss: of the norm of each residual.
    """

    kind: str
    first: int
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
class Part:
    """Derivative of factors by one named block of variables.

    Attributes:
        owner, block: whose, and which: a name that the :class:`~vip_factors.problem.layout.Layout` knows.
        jacobian: ``(t, n, m, c)``, whitened.
        each: whether every factor has its own item of the block, in order; else all have the whole block.
        ahead: of a block that changes with time: how many frames after its first one the factor sees it; or
            ``AT_THE_FIRST_KNOT``, of one that walks, where it does not see it at the instant of a frame.
    """

    owner: OwnerId
    block: str
    jacobian: Array
    each: bool = False
    ahead: int = 0


@dataclass(frozen=True)
class BoneEquations(Residuals):
    """Factors that see a bone in one frame: how it is turned, or where a point on it is.

    Attributes:
        owner: whose body.
        bones: ``n``, of each factor.
        derivatives: ``(t, n, m, 6)`` by the twist of the bone, or ``(t, n, m, 3)`` where only its turn matters; and the
            parts.
    """

    owner: OwnerId
    bones: tuple[int, ...]
    derivatives: Callable[[], tuple[Array, tuple[Part, ...]]]


@dataclass(frozen=True)
class DifferenceEquations(Residuals):
    """Factors on the motion of points, linear in where they are in successive frames; three rows each.

    Attributes:
        owner: whose body.
        bones: ``n``, that the points are fixed to.
        arms: ``(t + r, n, 3)`` from the root to the points, world axes, in the frames from ``first`` on.
        coefficients: ``(r + 1,)``, whitened, of the positions in successive frames.
        parts: what else is seen.
    """

    owner: OwnerId
    bones: tuple[int, ...]
    arms: Array
    coefficients: Array
    parts: tuple[Part, ...] = ()


@dataclass(frozen=True)
class JointEquations(Residuals):
    """Factors on the rotations of joints 1 … 23 in one frame or in successive ones.

    Attributes:
        owner: whose joints.
        by_joints: of each frame ``(t, 23, 3, 3)``: how a joint's three coordinates change with its rotation.
        whitening: ``(69, 69)`` where one factor a frame sees all coordinates together; None where each joint (or each
            of its coordinates) is a factor, and coordinates are whitened already.
        information: ``whitening`` squared.
        mean: a block that the coordinates are compared with.
        acts: False where no factor has a derivative.
    """

    owner: OwnerId
    by_joints: Callable[[], tuple[Array, ...]]
    whitening: Array | None = None
    information: Array | None = None
    mean: str | None = None
    acts: bool = True


@dataclass(frozen=True)
class DenseEquations(Residuals):
    """Factors on few columns, each derivative written out."""

    parts: Callable[[], tuple[Part, ...]]


@dataclass(frozen=True)
class KnotEquations(Residuals):
    """Factors between the values of a block at neighbouring knots: ``n`` of one row, from each knot to the next.

    ``residual`` is ``(K − 1, n, 1)``, its frames are knots; ``root`` ``(K − 1, n)`` is one over the sigmas.
    """

    owner: OwnerId
    block: str
    root: Array


def tempered(equations: "Equations", share: Array) -> "Equations":
    """The same factors with ``share`` ``(t, 1)`` times their cost: what is far off is forgiven as before."""
    confidence, loss = equations.confidence * share, equations.loss.tempered(share)
    return replace(equations, confidence=confidence, loss=loss)


Equations = BoneEquations | DifferenceEquations | JointEquations | DenseEquations | KnotEquations
