"""Equations summed into a chain: blocks of each frame, with the next two, and with what all frames share."""

import numpy as np

from vip_factors.assembly.accumulator import Accumulator
from vip_factors.assembly.scatter import PlacedBlock, Slot
from vip_factors.geometry.rotations import Array
from vip_factors.problem.layout import STATIC, ColumnRange, Layout
from vip_factors.solve.chain_system import ChainSystem
from vip_factors.terms.equations import AT_THE_FIRST_KNOT, JacobianBlock, KnotEquations, Residuals


class ChainAccumulator(Accumulator):
    """Sums a stretch of frames into their places in a whole chain; stretches may be summed side by side.

    Args:
        layout: where columns are.
        system: of the whole chain; of this stretch's frames the blocks are added to.
        begin, count: the stretch.

    Attributes:
        static, static_gradient: ``(s, s)`` and ``(s,)`` of this stretch, to be added to the system's.
    """

    def __init__(self, layout: Layout, system: ChainSystem, begin: int, count: int) -> None:
        super().__init__(layout, begin, count)
        self._system, s = system, layout.static_width
        self.static, self.static_gradient = np.zeros((s, s)), np.zeros(s)
        self._groups = {columns.start: number for number, (_, columns) in enumerate(layout.owners)}
        self._group_columns = [columns for _, columns in layout.owners]

    @property
    def _frames(self) -> slice:
        return slice(self.begin, self.begin + self.count)

    def slot(self, i: int, j: int) -> tuple[Slot, int]:
        """Counted from the earlier of the two frames."""
        return (0, j - i), i

    def frame_frame(self, chain: int, i: int, other: int, j: int) -> Array:
        """See the base."""
        if chain != other:
            return self._system.between[chain, other][self._frames]
        if i == j:
            return self._system.chains[chain].own[self._frames]
        following = self._system.chains[chain].following
        assert following is not None
        return following[self._frames, j - 1]

    def _group(self, columns: slice) -> int:
        return next(g for g, own in enumerate(self._group_columns) if own.start <= columns.start < own.stop)

    def frame_static(self, chain: int, i: int, columns: slice) -> Array:
        """See the base."""
        group = self._group(columns)
        start = self._group_columns[group].start
        blocks = self._system.coupling[chain, group]
        return blocks[self._frames, :, columns.start - start : columns.stop - start]

    def frame_gradient(self, chain: int, i: int) -> Array:
        """See the base."""
        return self._system.chains[chain].gradient[self._frames]

    def add_static(self, rows: np.ndarray, columns: np.ndarray, block: Array, at: Residuals, mirror: bool) -> None:
        """See the base."""
        source, _ = self.static_rows(at)
        total = block[source].sum(axis=0)
        self.static[rows[:, :, None], columns[:, None, :]] += total
        if mirror:
            self.static[columns[:, :, None], rows[:, None, :]] += total.swapaxes(1, 2)

    def add_static_gradient(self, columns: np.ndarray, vector: Array, at: Residuals) -> None:
        """See the base."""
        source, _ = self.static_rows(at)
        self.static_gradient[columns] += vector[source].sum(axis=0)

    # What walks

    def walks(self, columns: ColumnRange) -> bool:
        """See the base."""
        if columns.chain != STATIC:
            return False
        group = self._group(columns.columns)
        return self._system.groups[group].knots is not None and columns.start == self._group_columns[group].start

    def add_knots(self, equations: KnotEquations) -> None:
        """See the base."""
        columns = self.layout.columns_of(equations.owner, equations.block)
        if columns is None or self.begin:
            return
        knots = self._system.groups[self._group(columns.columns)].knots
        assert knots is not None
        knots.add_between(equations.root, equations.residual[..., 0])

    def add_each(self, chain: int, i: int, columns: ColumnRange, later: int, block: Array) -> None:
        """See the base."""
        if later == 0:
            super().add_each(chain, i, columns, later, block)
            return
        knots = self._system.groups[self._group(columns.columns)].knots
        assert knots is not None
        knots.adjacent[self.begin : self.begin + len(block), 0 if later > 0 else 1] += block

    def add_static_blocks(
        self, one: PlacedBlock, other: PlacedBlock, block: Array, at: Residuals, mirror: bool
    ) -> None:
        """See the base."""
        if not (self.walks(one.range) and _at_an_instant(one.block)):
            super().add_static_blocks(one, other, block, at, mirror)
            return
        group = self._group(one.range.columns)
        knots, start = self._system.groups[group].knots, self._group_columns[group].start
        assert knots is not None
        source, target = self.rows(one.ahead, at)
        rows, columns = one.columns - start, other.columns - start
        into = knots.own[self._frames][target]
        into[:, rows[:, :, None], columns[:, None, :]] += block[source]

    def add_static_block_gradient(self, one: PlacedBlock, vector: Array, at: Residuals) -> None:
        """See the base."""
        if not (self.walks(one.range) and _at_an_instant(one.block)):
            super().add_static_block_gradient(one, vector, at)
            return
        group = self._group(one.range.columns)
        knots = self._system.groups[group].knots
        assert knots is not None
        source, target = self.rows(one.ahead, at)
        into = knots.gradient[self._frames][target]
        into[:, one.columns - self._group_columns[group].start] += vector[source]


def _at_an_instant(block: JacobianBlock) -> bool:
    """Whether factors see a block that may walk as it is at a frame."""
    return block.ahead != AT_THE_FIRST_KNOT
