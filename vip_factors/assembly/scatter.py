"""Where blocks of normal equations go: by the first frame of a factor, and the columns of the frames that it sees."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vip_factors.assembly.charts import Charts
from vip_factors.geometry.rotations import Array
from vip_factors.problem.layout import STATIC, ColumnRange, Layout
from vip_factors.solve.slices import Blocks
from vip_factors.terms.equations import JacobianBlock, Residuals


@dataclass(frozen=True)
class PlacedBlock:
    """A Jacobian block of variables that move, by coordinates where there are charts."""

    block: JacobianBlock
    range: ColumnRange
    jacobian: Array

    @property
    def ahead(self) -> int:
        """Frames after the factor's first one."""
        return self.block.ahead

    @property
    def columns(self) -> np.ndarray:
        """``(n, c)`` of each factor, or ``(1, c)`` of all."""
        width = self.jacobian.shape[3]
        return np.arange(self.range.start, self.range.stop).reshape(-1, width)


class Scatter:
    """Adds blocks of the factors whose first frame is in a stretch to where they belong.

    Args:
        layout: where columns are.
        blocks: of the stretch.
        begin: its first frame.
        charts: of coordinates, where steps are not what is solved for.
    """

    def __init__(self, layout: Layout, blocks: Blocks, begin: int, charts: Charts | None = None) -> None:
        self.layout, self.begin, self.count, self.charts = layout, begin, len(blocks.frames), charts
        self._blocks = blocks

    @property
    def stretch(self) -> slice:
        """The frames."""
        return slice(self.begin, self.begin + self.count)

    def frame_frame(self, chain: int, i: int, other: int, j: int) -> Array:
        """The blocks ``(count, w, w')`` of a chain in a factor's ``i``-th frame with another in its ``j``-th."""
        rows, columns = self.layout.chain_columns[chain], self.layout.chain_columns[other]
        start = j * self.layout.frame_width
        return self._blocks.frames[:, i, rows, start + columns.start : start + columns.stop]

    def frame_static(self, chain: int, i: int, columns: slice) -> Array:
        """The blocks ``(count, w, k)`` of a chain in a factor's ``i``-th frame with columns of the static vector."""
        return self._blocks.coupling[:, i, self.layout.chain_columns[chain], columns]

    def frame_gradient(self, chain: int, i: int) -> Array:
        """The gradient ``(count, w)`` of a chain in a factor's ``i``-th frame."""
        return self._blocks.gradient[:, i, self.layout.chain_columns[chain]]

    def add_static(self, rows: np.ndarray, columns: np.ndarray, block: Array, at: Residuals, mirror: bool) -> None:
        """Add ``(t, n, r, c)`` at static ``rows`` ``(n or 1, r)`` and ``columns``, and its mirror image if asked to."""
        into, block = self._of_each(self._blocks.static, block, at)
        into[:, rows[:, :, None], columns[:, None, :]] += block
        if mirror:
            into[:, columns[:, :, None], rows[:, None, :]] += block.swapaxes(2, 3)

    def add_static_gradient(self, columns: np.ndarray, vector: Array, at: Residuals) -> None:
        """Add ``(t, n, c)`` at columns ``(n or 1, c)``."""
        into, vector = self._of_each(self._blocks.static_gradient, vector, at)
        into[:, columns] += vector

    def _of_each(self, into: Array, values: Array, at: Residuals) -> tuple[Array, Array]:
        source, target = self.rows(at)
        if len(into) == self.count and self.count > 1:
            return into[target], values[source]
        return into, values[source].sum(axis=0, keepdims=True)

    def rows(self, at: Residuals) -> tuple[slice, slice]:
        """Which of the factors begin in the stretch, and in which of its frames."""
        start = at.first - self.begin
        low, high = max(start, 0), min(start + len(at.residual), self.count)
        return slice(low - start, max(high, low) - start), slice(low, max(high, low))

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
        first, second = one.range.chain != STATIC, other.range.chain != STATIC
        if first and second:
            self._scatter_frames(one, other, block.sum(axis=1), at)
        elif first:
            self._scatter_coupling(one, other, block, at)
        elif second:
            self._scatter_coupling(other, one, block.swapaxes(2, 3), at)
        else:
            if not (one.block.each or other.block.each):
                block = block.sum(axis=1, keepdims=True)
            self.add_static(one.columns, other.columns, block, at, mirror=one is not other)

    def _scatter_frames(self, one: PlacedBlock, other: PlacedBlock, block: Array, at: Residuals) -> None:
        if (other.ahead, other.range.chain) < (one.ahead, one.range.chain):
            one, other, block = other, one, block.swapaxes(1, 2)
        i, j = one.ahead, other.ahead
        source, target = self.rows(at)
        into = self.frame_frame(one.range.chain, i, other.range.chain, j)
        into[target, one.range.columns, other.range.columns] += block[source]
        if one is not other and i == j and one.range.chain == other.range.chain:
            into[target, other.range.columns, one.range.columns] += block[source].swapaxes(1, 2)

    def _scatter_coupling(self, frame: PlacedBlock, static: PlacedBlock, block: Array, at: Residuals) -> None:
        source, target = self.rows(at)
        of_each = block.swapaxes(1, 2).reshape(len(block), block.shape[2], -1)
        block = of_each if static.block.each else block.sum(axis=1)
        into = self.frame_static(frame.range.chain, frame.ahead, static.range.columns)
        into[target, frame.range.columns] += block[source]

    def scatter_gradient(self, one: PlacedBlock, vector: Array, at: Residuals) -> None:
        """Add ``(t, n, c)`` of a set of variables."""
        if one.range.chain == STATIC:
            vector = vector if one.block.each else vector.sum(axis=1, keepdims=True)
            self.add_static_gradient(one.columns, vector, at)
            return
        source, target = self.rows(at)
        self.frame_gradient(one.range.chain, one.ahead)[target, one.range.columns] += vector[source].sum(axis=1)
