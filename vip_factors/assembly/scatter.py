"""Where blocks of normal equations go: all that a chain and slices disagree about.

Of a factor whose first frame is ``f``, the block between its frames ``f + i`` and ``f + j`` is, in a chain, one of
frame ``f + i`` with the frame ``j − i`` later, summed with those of other factors there; in slices, of the ``i``-th and
the ``j``-th frame of slice ``f``.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from vip_factors.assembly.charts import Charts
from vip_factors.geometry.rotations import Array
from vip_factors.problem.layout import STATIC, ColumnRange, Layout
from vip_factors.terms.equations import JacobianBlock, Residuals

Slot: TypeAlias = tuple[int, int]


@dataclass(frozen=True)
class PlacedBlock:
    """A Jacobian block of variables that move, by coordinates where there are charts."""

    block: JacobianBlock
    range: ColumnRange
    jacobian: Array

    @property
    def ahead(self) -> int:
        """Frames after the factor's first one."""
        return max(self.block.ahead, 0)

    @property
    def columns(self) -> np.ndarray:
        """``(n, c)`` of each factor, or ``(1, c)`` of all."""
        width = self.jacobian.shape[3]
        return np.arange(self.range.start, self.range.stop).reshape(-1, width)


class Scatter(ABC):
    """Adds blocks of a stretch of frames to where they belong.

    Args:
        layout: where columns are.
        begin, count: the stretch.
        charts: of coordinates, where steps are not what is solved for.
    """

    def __init__(self, layout: Layout, begin: int, count: int, charts: Charts | None = None) -> None:
        self.layout, self.begin, self.count, self.charts = layout, begin, count, charts

    @property
    def stretch(self) -> slice:
        """The frames."""
        return slice(self.begin, self.begin + self.count)

    @abstractmethod
    def slot(self, i: int, j: int) -> tuple[Slot, int]:
        """Which slot, and how many frames after a factor's first one its row is."""

    @abstractmethod
    def frame_frame(self, chain: int, i: int, other: int, j: int) -> Array:
        """The blocks ``(count, w, w')`` of two chains in a slot."""

    @abstractmethod
    def frame_static(self, chain: int, i: int, columns: slice) -> Array:
        """The blocks ``(count, w, k)`` of a chain with columns of one owner in the static vector."""

    @abstractmethod
    def frame_gradient(self, chain: int, i: int) -> Array:
        """The gradient ``(count, w)`` of a chain's frames in a slot."""

    @abstractmethod
    def add_static(self, rows: np.ndarray, columns: np.ndarray, block: Array, at: Residuals, mirror: bool) -> None:
        """Add ``(t, n, r, c)`` at static ``rows`` ``(n or 1, r)`` and ``columns``, and its mirror image if asked to."""

    @abstractmethod
    def add_static_gradient(self, columns: np.ndarray, vector: Array, at: Residuals) -> None:
        """Add ``(t, n, c)`` at columns ``(n or 1, c)``."""

    def walks(self, columns: ColumnRange) -> bool:
        """Whether the values of a block change from frame to frame, between knots."""
        return False

    def add_each(self, chain: int, i: int, columns: ColumnRange, later: int, block: Array) -> None:
        """Add blocks ``(n ≤ count, w, k)`` of a chain with a static block's values ``later`` frames after its own."""
        self.frame_static(chain, i, columns.columns)[: len(block)] += block

    def rows(self, shift: int, at: Residuals) -> tuple[slice, slice]:
        """Which of the factors have their row in the stretch, and which rows these are."""
        start = at.first + shift - self.begin
        low, high = max(start, 0), min(start + len(at.residual), self.count)
        return slice(low - start, max(high, low) - start), slice(low, max(high, low))

    def static_rows(self, at: Residuals) -> tuple[slice, slice]:
        """The same of those whose first frame is in the stretch: what they say of static variables counts once."""
        return self.rows(0, at)

    def placed(self, blocks: Sequence[JacobianBlock], at: Residuals) -> list[PlacedBlock]:
        """Those blocks whose variables move."""
        found = []
        for block in blocks:
            columns = self.layout.columns_of(block.owner, block.block)
            if columns is not None:
                jacobian = block.jacobian if self.charts is None else self.charts.jacobian(block, at.first)
                found.append(PlacedBlock(block, columns, jacobian))
        return found

    def scatter(self, one: PlacedBlock, other: PlacedBlock, block: Array, at: Residuals) -> None:
        """Add the block ``(t, n, c, c')`` between two sets of variables."""
        mirror = one is not other
        first, second = one.range.chain != STATIC, other.range.chain != STATIC
        if first and second:
            self._scatter_frames(one, other, block.sum(axis=1), at)
        elif first:
            self._scatter_coupling(one, other, block, at)
        elif second:
            self._scatter_coupling(other, one, block.swapaxes(2, 3), at)
        else:
            self.add_static_blocks(one, other, block, at, mirror)

    def add_static_blocks(
        self, one: PlacedBlock, other: PlacedBlock, block: Array, at: Residuals, mirror: bool
    ) -> None:
        """Add the block ``(t, n, c, c')`` between two sets of static variables."""
        if not (one.block.each or other.block.each):
            block = block.sum(axis=1, keepdims=True)
        self.add_static(one.columns, other.columns, block, at, mirror)

    def _scatter_frames(self, one: PlacedBlock, other: PlacedBlock, block: Array, at: Residuals) -> None:
        if (other.ahead, other.range.chain) < (one.ahead, one.range.chain):
            one, other, block = other, one, block.swapaxes(1, 2)
        (i, j), shift = self.slot(one.ahead, other.ahead)
        source, target = self.rows(shift, at)
        into = self.frame_frame(one.range.chain, i, other.range.chain, j)
        into[target, one.range.columns, other.range.columns] += block[source]
        if one is not other and i == j and one.range.chain == other.range.chain:
            into[target, other.range.columns, one.range.columns] += block[source].swapaxes(1, 2)

    def _scatter_coupling(self, frame: PlacedBlock, static: PlacedBlock, block: Array, at: Residuals) -> None:
        (i, _), shift = self.slot(frame.ahead, frame.ahead)
        source, target = self.rows(shift, at)
        of_each = block.swapaxes(1, 2).reshape(len(block), block.shape[2], -1)
        block = of_each if static.block.each else block.sum(axis=1)
        into = self.frame_static(frame.range.chain, i, static.range.columns)
        into[target, frame.range.columns] += block[source]

    def scatter_gradient(self, one: PlacedBlock, vector: Array, at: Residuals) -> None:
        """Add ``(t, n, c)`` of a set of variables."""
        if one.range.chain == STATIC:
            self.add_static_block_gradient(one, vector, at)
            return
        (i, _), shift = self.slot(one.ahead, one.ahead)
        source, target = self.rows(shift, at)
        self.frame_gradient(one.range.chain, i)[target, one.range.columns] += vector[source].sum(axis=1)

    def add_static_block_gradient(self, one: PlacedBlock, vector: Array, at: Residuals) -> None:
        """Add ``(t, n, c)`` of a set of static variables."""
        self.add_static_gradient(one.columns, vector if one.block.each else vector.sum(axis=1, keepdims=True), at)
