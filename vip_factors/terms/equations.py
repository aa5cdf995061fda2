"""Terms and their equations: residuals of all factors of one kind at once, with derivatives on demand.

A term has ``n`` factors in each of ``t`` successive frames. The classes of equations differ in the variables of their
factors: bones and points of a body in one frame, points over several frames, joints, or plain columns.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Generic, Protocol, TypeVar

import numpy as np

from vip_factors.factor_settings import SQUARE, Loss, RobustLoss
from vip_factors.geometry.rotations import Array
from vip_factors.problem.layout import OwnerId


def robust_weight(loss: RobustLoss, norm: Array) -> Array:
    """Weight of the squared residual in the normal equations (IRLS), for norms of any shape."""
    if loss.loss is Loss.HUBER:
        return np.minimum(1.0, loss.k / np.maximum(norm, 1e-300))
    if loss.loss is Loss.CAUCHY:
        return 1 / (1 + (norm / loss.k) ** 2)
    return np.ones_like(norm)


def robust_cost(loss: RobustLoss, norm: Array) -> Array:
    """Robust loss of residual norms; half the square near zero."""
    if loss.loss is Loss.HUBER:
        return np.where(norm <= loss.k, 0.5 * norm**2, loss.k * (norm - 0.5 * loss.k))
    if loss.loss is Loss.CAUCHY:
        return 0.5 * loss.k**2 * np.log1p((norm / loss.k) ** 2)
    return 0.5 * norm**2


@dataclass(frozen=True)
class Residuals:
    """``n`` factors in each of ``t`` frames.

    Attributes:
        first_frame: frame of the first factors.
        residual: ``(t, n, m)``, whitened.
        confidence: ``(t, n)``, divides the variance; zero where the factor does not exist.
        loss: robust loss of each residual's norm.
    """

    first_frame: int
    residual: Array
    confidence: np.ndarray | float
    loss: RobustLoss

    @cached_property
    def norm(self) -> Array:
        """Norms ``(t, n)`` of the whitened residuals."""
        return np.sqrt(self.confidence * np.einsum("tni,tni->tn", self.residual, self.residual))

    @property
    def cost(self) -> float:
        """Sum of the factors' robust losses."""
        return float(np.sum(robust_cost(self.loss, self.norm)))

    @property
    def weight(self) -> Array:
        """Weights ``(t, n)`` on the squared residuals in the normal equations."""
        if self.loss.loss is Loss.SQUARE:
            return np.full(self.residual.shape[:2], self.confidence, dtype=float)
        return self.confidence * robust_weight(self.loss, self.norm)


@dataclass(frozen=True)
class JacobianBlock:
    """Derivative of factors with respect to one named block of variables.

    Attributes:
        owner, block: owner and name of the block in the :class:`~vip_factors.problem.layout.Layout`.
        jacobian: ``(t, n, m, c)``, whitened.
        is_per_factor: True if factor ``i`` depends on item ``i`` of the block; False if each depends on all of it.
        ahead: for blocks of frames, the number of frames after the factor's first one.
    """

    owner: OwnerId
    block: str
    jacobian: Array
    is_per_factor: bool = False
    ahead: int = 0

    def times(self, by_block: Array) -> "JacobianBlock":
        """Apply the chain rule: multiply by ``(t, n, k, m)`` from the left."""
        return replace(self, jacobian=by_block @ self.jacobian)


def finite_difference(blocks: Iterable[JacobianBlock], coefficients: Array) -> tuple[JacobianBlock, ...]:
    """Combine derivatives of positions in ``r + 1`` successive frames linearly, with coefficients ``(r + 1,)``."""

    def combination(jacobian: Array) -> Array:
        count = len(jacobian) - len(coefficients) + 1
        return np.asarray(sum(c * jacobian[i : i + count] for i, c in enumerate(coefficients)))

    return tuple(replace(block, jacobian=combination(block.jacobian)) for block in blocks)


@dataclass(frozen=True)
class BoneEquations(Residuals):
    """Factors on the orientation of ``n`` bones in one frame, or on a point of each.

    Attributes:
        owner: whose body.
        bones: bone of each factor.
        derivatives: with respect to the bone's twist ``(t, n, m, 6)``, or its rotation alone ``(t, n, m, 3)``; and the
            other blocks.
    """

    owner: OwnerId
    bones: tuple[int, ...]
    derivatives: Callable[[], tuple[Array, tuple[JacobianBlock, ...]]]


@dataclass(frozen=True)
class DifferenceEquations(Residuals):
    """Factors on the motion of points, linear in their positions in successive frames; three rows each.

    Attributes:
        owner: whose body.
        bones: ``n`` bones that the points are fixed to.
        arms: ``(t + r, n, 3)`` m from the root to the points, world axes, in the frames from ``first_frame`` on.
        coefficients: ``(r + 1,)``, whitened, of the positions in successive frames.
        blocks: derivatives with respect to other blocks.
    """

    owner: OwnerId
    bones: tuple[int, ...]
    arms: Array
    coefficients: Array
    blocks: Callable[[], tuple[JacobianBlock, ...]] = tuple


@dataclass(frozen=True)
class JointEquations(Residuals):
    """Factors on the rotations of joints 1 … 23 in one frame or in successive ones.

    Attributes:
        owner: whose joints.
        by_joints: for each frame ``(t, 23, 3, 3)``, derivative of a joint's three coordinates by its rotation.
        whitening: ``(69, 69)`` if there is one factor in each frame, on all coordinates; None if each joint (or each
            of its coordinates) is a factor with whitened coordinates.
        mean: name of the block that is subtracted from the coordinates, or None.
        acts: False if all derivatives are zero.
    """

    owner: OwnerId
    by_joints: Callable[[], tuple[Array, ...]]
    whitening: Array | None = None
    mean: str | None = None
    acts: bool = True


@dataclass(frozen=True)
class DenseEquations(Residuals):
    """Factors on few columns with explicit derivatives."""

    blocks: Callable[[], tuple[JacobianBlock, ...]]


@dataclass(frozen=True)
class WalkEquations(Residuals):
    """Random walk of a block's ``n`` items: factors between successive values.

    ``residual`` is ``(K, n, 1)`` for ``K`` steps; ``root`` ``(K, n)`` is the inverse of the standard deviations.
    """

    owner: OwnerId
    block: str
    root: Array


Equations = BoneEquations | DifferenceEquations | JointEquations | DenseEquations | WalkEquations


def prior_equations(
    block: JacobianBlock, residual: Array, loss: RobustLoss = SQUARE, first_frame: int = 0
) -> Iterator[DenseEquations]:
    """Build the equations of a prior on static variables, or on the frame ``first_frame``.

    ``block`` has a Jacobian ``(1, n, m, c)``; ``residual`` is ``(n, m)``, whitened.
    """
    yield DenseEquations(first_frame, residual[None], 1.0, loss, lambda: (block,))


class Evaluation(Protocol):
    """Part of a problem at a state: the argument of a term."""

    @property
    def frames(self) -> int:
        """Number of frames of the problem."""
        ...

    @property
    def is_beginning(self) -> bool:
        """True if the first frame is that of the recording; priors on static variables belong to it."""
        ...

    @property
    def frame_share(self) -> float:
        """Scale of one frame's information, at most 1: time step over the correlation time of model errors."""
        ...


EvaluationT = TypeVar("EvaluationT", bound=Evaluation)


@dataclass(frozen=True)
class Term(Generic[EvaluationT]):
    """One kind of factor.

    Attributes:
        kind: name in costs, messages and pictures.
        reach: number of frames after its first one that a factor depends on.
        factors: function of an evaluation and a stretch of frames; yields the equations of the factors whose first
            frame lies in the stretch.
        every_frame: True if frames repeat the same information; their weight is scaled by ``frame_share`` then.
    """

    kind: str
    reach: int
    factors: Callable[[EvaluationT, slice], Iterator[Equations]]
    every_frame: bool = True

    @classmethod
    def prior(cls, kind: str, equations: Callable[[EvaluationT], Iterator[Equations]]) -> "Term[EvaluationT]":
        """Make a term on static variables; it counts once, with the first frame of the recording."""

        def factors(evaluation: EvaluationT, stretch: slice) -> Iterator[Equations]:
            if evaluation.is_beginning and stretch.start == 0:
                yield from equations(evaluation)

        return cls(kind, 0, factors, every_frame=False)

    def equations(self, evaluation: EvaluationT, stretch: slice) -> Iterator[Equations]:
        """Yield the weighted equations of the factors whose first frame lies in a stretch."""
        for equations in self.factors(evaluation, stretch):
            if self.every_frame:  # scales the cost, so that the loss treats outliers alike
                share = evaluation.frame_share  # the equations are not shared yet: changed without a copy
                object.__setattr__(equations, "confidence", equations.confidence * share)
                object.__setattr__(equations, "loss", equations.loss.tempered(share))
            yield equations

    def equations_in(self, evaluation: EvaluationT, frames: slice) -> Iterator[Equations]:
        """Yield the equations of the factors that begin in a stretch and end in the evaluation's frames."""
        stretch = slice(frames.start, min(frames.stop, evaluation.frames - self.reach))
        if stretch.stop > stretch.start:
            yield from self.equations(evaluation, stretch)

    def all_equations(self, evaluation: EvaluationT) -> Iterator[Equations]:
        """Yield the equations of all factors."""
        yield from self.equations_in(evaluation, slice(0, evaluation.frames))
