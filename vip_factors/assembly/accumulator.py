"""From the equations of terms to blocks of normal equations: shape by shape, knowing no term by its name.

Blocks go by the first frame of a factor, and by the columns of the frames that it sees.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vip_factors.assembly.charts import Charts
from vip_factors.body.kinematics import MOVES, BodyState, twists_at
from vip_factors.body.pose_prior import POSE_SIZE
from vip_factors.geometry.rotations import Array
from vip_factors.problem.layout import FRAME, ROOT, STATIC, ColumnRange, Layout
from vip_factors.solve.slices import Blocks
from vip_factors.terms.equations import (
    BoneEquations,
    DenseEquations,
    DifferenceEquations,
    Equations,
    JacobianBlock,
    JointEquations,
    Residuals,
    Term,
    WalkEquations,
)


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


class Accumulator:
    """Sums equations over a stretch of frames.

    Args:
        layout: where columns are.
        blocks: of the stretch.
        begin: its first frame.
        bodies: of the wearers, in all frames.
        charts: of coordinates, where steps are not what is solved for.
    """

    def __init__(
        self, layout: Layout, blocks: Blocks, begin: int, bodies: Sequence[BodyState], charts: Charts | None = None
    ) -> None:
        self.layout, self.begin, self.count, self.charts = layout, begin, len(blocks.frames), charts
        self._blocks, self._bodies, self._screws = blocks, bodies, dict[tuple[int, int, int], Array]()

    def add_term(self, term: Term[Any], at: Any) -> None:
        """Take in a term at a state: the factors whose first frame is in the stretch."""
        for equations in term.of_first_in(at, slice(self.begin, self.begin + self.count)):
            self.add(equations)

    def add(self, equations: Equations) -> None:
        """Take in the equations of one term."""
        match equations:
            case BoneEquations():
                by_twist, others = equations.derivatives()
                self._add_blocks([*self._by_bones(equations, by_twist, 0), *self._placed(others, equations)], equations)
            case DifferenceEquations():
                by_twist, t = twists_at(equations.arms), len(equations.residual)
                blocks = self._placed(equations.blocks(), equations)
                for ahead, c in enumerate(equations.coefficients):
                    blocks += self._by_bones(equations, c * by_twist[ahead : ahead + t], ahead)
                self._add_blocks(blocks, equations)
            case JointEquations():
                self._add_blocks(self._by_joints(equations), equations)
            case DenseEquations():
                self._add_blocks(self._placed(equations.blocks(), equations), equations)
            case WalkEquations():
                pass  # process noise, which comes in where frames are eliminated

    def finish(self) -> None:
        """Take in what was put off until all terms are there."""

    # Derivatives

    def _placed(self, blocks: Sequence[JacobianBlock], at: Residuals) -> list[PlacedBlock]:
        """Those blocks whose variables move."""
        placed = []
        for block in blocks:
            columns = self.layout.columns_of(block.owner, block.block)
            if columns is not None:
                jacobian = block.jacobian if self.charts is None else self.charts.jacobian(block, at.first)
                placed.append(PlacedBlock(block, columns, jacobian))
        return placed

    def _by_bones(self, eq: BoneEquations | DifferenceEquations, by_twist: Array, ahead: int) -> list[PlacedBlock]:
        """What sees the twists of bones, or their turns alone, by the joints that move them: a twist is the sum of
        their screws. Nothing of a body that is kept."""
        chain, (t, _, _, k) = self.layout.chain_of(eq.owner), by_twist.shape
        if chain is None:
            return []
        key = eq.owner.number, eq.first + ahead, t
        if key not in self._screws:
            screws = self._bodies[eq.owner.number].at(slice(key[1], key[1] + t)).screws
            screws = screws if self.charts is None else self.charts.screws(eq.owner.number, key[1], screws)
            self._screws[key] = screws.swapaxes(1, 2).reshape(t, 1, -1, FRAME)
        moved = np.repeat(MOVES[:, list(eq.bones)].T, 3, axis=1)
        block = JacobianBlock(eq.owner, "joints", by_twist @ self._screws[key][:, :, :k] * moved[:, None], ahead=ahead)
        return [PlacedBlock(block, ColumnRange(chain, 0, FRAME), block.jacobian)]

    def _by_joints(self, eq: JointEquations) -> list[PlacedBlock]:
        """What sees joints 1 … 23, and the block that their coordinates are compared with."""
        chain, placed, (t, n, m) = self.layout.chain_of(eq.owner), list[PlacedBlock](), eq.residual.shape
        if chain is None or not eq.acts:
            return placed
        columns, each = ColumnRange(chain, ROOT - POSE_SIZE, ROOT), np.arange(POSE_SIZE // 3)
        for ahead, D in enumerate(eq.by_joints()):
            if self.charts is not None:
                D = D @ self.charts.joints(eq.owner.number, eq.first + ahead, t)
            diagonal = np.zeros((t, len(each), 3, len(each), 3))
            diagonal[:, each, :, each] = D.swapaxes(0, 1)
            J: Array = diagonal.reshape(t, POSE_SIZE, POSE_SIZE)
            J = (J if eq.whitening is None else eq.whitening @ J).reshape(t, n, m, POSE_SIZE)
            placed.append(PlacedBlock(JacobianBlock(eq.owner, "joints", J, ahead=ahead), columns, J))
        if eq.mean is not None and eq.whitening is not None:
            by_mean = np.broadcast_to(-eq.whitening, (t, 1, *eq.whitening.shape))
            placed += self._placed([JacobianBlock(eq.owner, eq.mean, by_mean)], eq)
        return placed

    # Sums

    def _add_blocks(self, placed: Sequence[PlacedBlock], at: Residuals) -> None:
        t, weight = len(at.residual), at.weight[..., None, None]
        for number, one in enumerate(placed):
            pushed = weight * one.jacobian
            self._add_gradient(one, (pushed.swapaxes(2, 3) @ at.residual[..., None])[..., 0], at)
            for other in placed[number:]:
                first, second = pushed, other.jacobian
                if not (one.block.each or other.block.each):  # summed over factors at once
                    first, second = (J.reshape(t, 1, -1, J.shape[3]) for J in (first, second))
                self._add_block(one, other, first.swapaxes(2, 3) @ second, at)

    def _rows(self, at: Residuals) -> tuple[slice, slice]:
        """Which of the factors begin in the stretch, and in which of its frames."""
        start = at.first - self.begin
        low, high = max(start, 0), min(start + len(at.residual), self.count)
        return slice(low - start, max(high, low) - start), slice(low, max(high, low))

    def _of_each(self, into: Array, values: Array, at: Residuals) -> tuple[Array, Array]:
        """Where what is said of static columns goes: each frame's, or all together where there is one for all."""
        source, target = self._rows(at)
        if len(into) == self.count and self.count > 1:
            return into[target], values[source]
        return into, values[source].sum(axis=0, keepdims=True)

    def _frame_columns(self, one: PlacedBlock) -> slice:
        start = self.layout.chain_columns[one.range.chain].start
        return slice(start + one.range.start, start + one.range.stop)

    def _add_block(self, one: PlacedBlock, other: PlacedBlock, block: Array, at: Residuals) -> None:
        """Add the block ``(t, n, c, c')`` between two sets of variables."""
        first, second = one.range.chain != STATIC, other.range.chain != STATIC
        if first and second:
            self._add_frames(one, other, block.sum(axis=1), at)
        elif first:
            self._add_coupling(one, other, block, at)
        elif second:
            self._add_coupling(other, one, block.swapaxes(2, 3), at)
        else:
            if not (one.block.each or other.block.each):
                block = block.sum(axis=1, keepdims=True)
            into, block = self._of_each(self._blocks.static, block, at)
            into[:, one.columns[:, :, None], other.columns[:, None, :]] += block
            if one is not other:
                into[:, other.columns[:, :, None], one.columns[:, None, :]] += block.swapaxes(2, 3)

    def _add_frames(self, one: PlacedBlock, other: PlacedBlock, block: Array, at: Residuals) -> None:
        if (other.ahead, other.range.chain) < (one.ahead, one.range.chain):
            one, other, block = other, one, block.swapaxes(1, 2)
        rows, columns, start = (
            self._frame_columns(one),
            self._frame_columns(other),
            other.ahead * self.layout.frame_width,
        )
        source, target = self._rows(at)
        into = self._blocks.frames[:, one.ahead, :, start : start + self.layout.frame_width]
        into[target, rows, columns] += block[source]
        if one is not other and one.ahead == other.ahead and one.range.chain == other.range.chain:
            into[target, columns, rows] += block[source].swapaxes(1, 2)

    def _add_coupling(self, frame: PlacedBlock, static: PlacedBlock, block: Array, at: Residuals) -> None:
        source, target = self._rows(at)
        of_each = block.swapaxes(1, 2).reshape(len(block), block.shape[2], -1)
        block = of_each if static.block.each else block.sum(axis=1)
        into = self._blocks.coupling[:, frame.ahead, :, static.range.columns]
        into[target, self._frame_columns(frame)] += block[source]

    def _add_gradient(self, one: PlacedBlock, vector: Array, at: Residuals) -> None:
        """Add ``(t, n, c)`` of a set of variables."""
        if one.range.chain == STATIC:
            vector = vector if one.block.each else vector.sum(axis=1, keepdims=True)
            into, vector = self._of_each(self._blocks.static_gradient, vector, at)
            into[:, one.columns] += vector
            return
        source, target = self._rows(at)
        self._blocks.gradient[:, one.ahead, self._frame_columns(one)][target] += vector[source].sum(axis=1)
