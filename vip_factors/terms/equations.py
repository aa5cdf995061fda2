"""What a term is, and what it says: residuals of all its factors at once, and their derivatives when asked for.

A term has ``n`` factors in each of ``t`` successive frames, the first of which is ``first``. Shapes differ in what the
factors see: bones and points of a body in one frame, points moving over frames, joints, or plain columns.
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
    """Factor on the squared residual in the normal equations (IRLS), for norms of any shape."""
    if loss.loss is Loss.HUBER:
        return np.minimum(1.0, loss.k / np.maximum(norm, 1e-300))
    if loss.loss is Loss.CAUCHY:
        return 1 / (1 + (norm / loss.k) ** 2)
    return np.ones_like(norm)


def robust_cost(loss: RobustLoss, norm: Array) -> Array:
    """The loss itself: half the square near zero."""
    if loss.loss is Loss.HUBER:
        return np.where(norm <= loss.k, 0.5 * norm**2, loss.k * (norm - 0.5 * loss.k))
    if loss.loss is Loss.CAUCHY:
        return 0.5 * loss.k**2 * np.log1p((norm / loss.k) ** 2)
    return 0.5 * norm**2


@dataclass(frozen=True)
class Residuals:
    """``n`` factors in each of ``t`` frames.

    Attributes:
        first: frame of the first.
        residual: ``(t, n, m)``, whitened.
        confidence: ``(t, n)``, dividing the variance; zero where the factor does not exist.
        loss: of the norm of each residual.
    """

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
        return float(np.sum(robust_cost(self.loss, self.norm)))

    @property
    def weight(self) -> Array:
        """Weights ``(t, n)`` on the squared residuals in the normal equations."""
        if self.loss.loss is Loss.SQUARE:
            return np.full(self.residual.shape[:2], self.confidence, dtype=float)
        return self.confidence * robust_weight(self.loss, self.norm)


@dataclass(frozen=True)
class JacobianBlock:
    """Derivative of factors by one named block of variables.

    Attributes:
        owner, block: whose, and which: a name that the :class:`~vip_factors.problem.layout.Layout` knows.
        jacobian: ``(t, n, m, c)``, whitened.
        each: whether every factor has its own item of the block, in order; else all have the whole block.
        ahead: of a block that each frame has of its own: how many frames after its first one the factor sees it.
    """

    owner: OwnerId
    block: str
    jacobian: Array
    each: bool = False
    ahead: int = 0

    def times(self, by_block: Array) -> "JacobianBlock":
        """Of what depends on the factors by ``(t, n, k, m)``."""
        return replace(self, jacobian=by_block @ self.jacobian)


def differenced(blocks: Iterable[JacobianBlock], coefficients: Array) -> tuple[JacobianBlock, ...]:
    """Blocks of positions in successive frames as those of a linear combination ``(r + 1,)`` of each with the next."""
    return tuple(
        replace(
            one,
            jacobian=sum(
                c * one.jacobian[i : i + len(one.jacobian) - len(coefficients) + 1] for i, c in enumerate(coefficients)
            ),
        )
        for one in blocks
    )


@dataclass(frozen=True)
class BoneEquations(Residuals):
    """Factors that see the bones ``n`` of ``owner`` in one frame: how they are turned, or where a point on each is.

    ``derivatives``: ``(t, n, m, 6)`` by the twist of the bone, or ``(t, n, m, 3)`` where only its turn matters; and the
    other blocks.
    """

    owner: OwnerId
    bones: tuple[int, ...]
    derivatives: Callable[[], tuple[Array, tuple[JacobianBlock, ...]]]


@dataclass(frozen=True)
class DifferenceEquations(Residuals):
    """Factors on the motion of points, linear in where they are in successive frames; three rows each.

    Attributes:
        owner: whose body.
        bones: ``n``, that the points are fixed to.
        arms: ``(t + r, n, 3)`` from the root to the points, world axes, in the frames from ``first`` on.
        coefficients: ``(r + 1,)``, whitened, of the positions in successive frames.
        blocks: what else is seen.
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
        by_joints: of each frame ``(t, 23, 3, 3)``: how a joint's three coordinates change with its rotation.
        whitening: ``(69, 69)`` where one factor a frame sees all coordinates together; None where each joint (or each
            of its coordinates) is a factor, and coordinates are whitened already.
        mean: a block that the coordinates are compared with.
        acts: False where no factor has a derivative.
    """

    owner: OwnerId
    by_joints: Callable[[], tuple[Array, ...]]
    whitening: Array | None = None
    mean: str | None = None
    acts: bool = True


@dataclass(frozen=True)
class DenseEquations(Residuals):
    """Factors on few columns, each derivative written out."""

    blocks: Callable[[], tuple[JacobianBlock, ...]]


@dataclass(frozen=True)
class WalkEquations(Residuals):
    """Factors between values of a block that steps from time to time: ``n`` of one row, of each step.

    ``residual`` is ``(K, n, 1)``, its frames are steps; ``root`` ``(K, n)`` is one over the sigmas.
    """

    owner: OwnerId
    block: str
    root: Array


Equations = BoneEquations | DifferenceEquations | JointEquations | DenseEquations | WalkEquations


def prior_equations(
    block: JacobianBlock, residual: Array, loss: RobustLoss = SQUARE, first: int = 0
) -> Iterator[DenseEquations]:
    """The equations of a prior on what all frames share, or on the frame ``first``.

    ``block`` is of ``(1, n, m, c)``, as many factors as it has items, or one on all of them; ``residual`` ``(n, m)``,
    whitened.
    """
    yield DenseEquations(first, residual[None], 1.0, loss, lambda: (block,))


class Evaluation(Protocol):
    """A part of a problem at a state, which terms look at."""

    @property
    def frames(self) -> int:
        """Number of frames."""
        ...

    @property
    def is_beginning(self) -> bool:
        """Whether its first frame is that of the whole, with which the priors on what all frames share come."""
        ...

    @property
    def frame_share(self) -> float:
        """What a frame counts."""
        ...


At = TypeVar("At", bound=Evaluation)


@dataclass(frozen=True)
class Term(Generic[At]):
    """One kind of factor.

    Attributes:
        kind: its name, in costs, messages and pictures.
        reach: frames that a factor sees after its first one.
        of_first: the equations of the factors whose first frame lies in a stretch of frames, at a state; nothing if
            there are none.
        every_frame: whether frames repeat what the term says: then each counts by the time that it stands for
            (``frame_share`` of what the term looks at), not once.
    """

    kind: str
    reach: int
    of_first: Callable[[At, slice], Iterator[Equations]]
    every_frame: bool = True

    @classmethod
    def prior(cls, kind: str, equations: Callable[[At], Iterator[Equations]]) -> "Term[At]":
        """A term on what all frames share: it counts once, and comes with the very first frame."""

        def of_first(at: At, first: slice) -> Iterator[Equations]:
            if at.is_beginning and first.start == 0:
                yield from equations(at)

        return cls(kind, 0, of_first, every_frame=False)

    def equations(self, at: At, first: slice) -> Iterator[Equations]:
        """The equations of the factors whose first frame lies in a stretch, as much as they count."""
        for one in self.of_first(at, first):
            if self.every_frame:  # share times the cost: what is far off is forgiven as before
                share = at.frame_share  # the equations are new, and nobody else's yet: no copy of them
                object.__setattr__(one, "confidence", one.confidence * share)
                object.__setattr__(one, "loss", one.loss.tempered(share))
            yield one

    def of_first_in(self, at: At, frames: slice) -> Iterator[Equations]:
        """The equations of the factors whose first frame lies in a stretch."""
        first = slice(frames.start, min(frames.stop, at.frames - self.reach))
        if first.stop > first.start:
            yield from self.equations(at, first)

    def all(self, at: At) -> Iterator[Equations]:
        """The equations of all factors."""
        yield from self.of_first_in(at, slice(0, at.frames))
