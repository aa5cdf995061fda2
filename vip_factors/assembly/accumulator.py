"""Accumulation of the equations of terms into normal equations.

Blocks are indexed by the first frame of a factor and by the columns of the frames that it depends on.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vip_factors.assembly.charts import Charts
from vip_factors.body.joint_priors import POSE_SIZE
from vip_factors.body.kinematics import MOVES, BodyState, twists_at
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
    """Jacobian block of free variables with its columns, with respect to coordinates if there are charts."""

    block: JacobianBlock
    range: ColumnRange
    jacobian: Array

    @property
    def ahead(self) -> int:
        """Frames after the factor's first one."""
        return self.block.ahead

    @property
    def columns(self) -> np.ndarray:
        """Columns ``(n, c)`` of each factor, or ``(1, c)`` common to all."""
        width = self.jacobian.shape[3]
        return np.arange(self.range.start, self.range.stop).reshape(-1, width)


class Accumulator:
    """Sums equations over a stretch of frames.

    Args:
        layout: columns of the variables.
        blocks: targets of the stretch.
        begin: first frame of the stretch.
        bodies: kinematics of the wearers in all frames.
        charts: set if coordinates are solved for instead of steps.
    """

    def __init__(
        self, layout: Layout, blocks: Blocks, begin: int, bodies: Sequence[BodyState], charts: Charts | None = None
    ) -> None:
        self.layout, self.begin, self.count, self.charts = layout, begin, len(blocks.frames), charts
        self._blocks, self._bodies, self._screws = blocks, bodies, dict[tuple[int, int, int], Array]()

    def add_term(self, term: Term[Any], evaluation: Any) -> None:
        """Add the factors of a term whose first frame is in the stretch."""
        for equations in term.equations_in(evaluation, slice(self.begin, self.begin + self.count)):
            self.add(equations)

    def add(self, equations: Equations) -> None:
        """Add the equations of one term."""
        match equations:
            case BoneEquations():
                by_twist, other_blocks = equations.derivatives()
                blocks = self._by_bones(equations, by_twist, 0) + self._placed(other_blocks, equations)
                self._add_blocks(blocks, equations)
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
                pass  # process noise is added during the elimination

    def finish(self) -> None:
        """Add deferred sums after the last term."""

    # Derivatives

    def _placed(self, blocks: Sequence[JacobianBlock], equations: Residuals) -> list[PlacedBlock]:
        """Select the blocks of free variables."""
        placed = []
        for block in blocks:
            columns = self.layout.columns_of(block.owner, block.block)
            if columns is not None:
                jacobian = block.jacobian if self.charts is None else self.charts.jacobian(block, equations.first_frame)
                placed.append(PlacedBlock(block, columns, jacobian))
        return placed

    def _by_bones(self, eq: BoneEquations | DifferenceEquations, by_twist: Array, ahead: int) -> list[PlacedBlock]:
        """Transform derivatives by the twists of bones, or their rotations alone, to joints; none for a constant body.

        A bone's twist is the sum of the screws of the joints that move it.
        """
        chain, (t, _, _, k) = self.layout.chain_of(eq.owner), by_twist.shape
        if chain is None:
            return []
        key = eq.owner.number, eq.first_frame + ahead, t
        if key not in self._screws:
            screws = self._bodies[eq.owner.number].at(slice(key[1], key[1] + t)).screws
            screws = screws if self.charts is None else self.charts.screws(eq.owner.number, key[1], screws)
            self._screws[key] = screws.swapaxes(1, 2).reshape(t, 1, -1, FRAME)
        moves = np.repeat(MOVES[:, list(eq.bones)].T, 3, axis=1)
        block = JacobianBlock(eq.owner, "joints", by_twist @ self._screws[key][:, :, :k] * moves[:, None], ahead=ahead)
        return [PlacedBlock(block, ColumnRange(chain, 0, FRAME), block.jacobian)]

    def _by_joints(self, eq: JointEquations) -> list[PlacedBlock]:
        """Derivatives by joints 1 … 23 and by the mean that is subtracted from their coordinates."""
        chain, placed, (t, n, m) = self.layout.chain_of(eq.owner), list[PlacedBlock](), eq.residual.shape
        if chain is None or not eq.acts:
            return placed
        columns, joints = ColumnRange(chain, ROOT - POSE_SIZE, ROOT), np.arange(POSE_SIZE // 3)
        for ahead, D in enumerate(eq.by_joints()):
            if self.charts is not None:
                D = D @ self.charts.joints(eq.owner.number, eq.first_frame + ahead, t)
            diagonal = np.zeros((t, len(joints), 3, len(joints), 3))
            diagonal[:, joints, :, joints] = D.swapaxes(0, 1)
            J: Array = diagonal.reshape(t, POSE_SIZE, POSE_SIZE)
            J = (J if eq.whitening is None else eq.whitening @ J).reshape(t, n, m, POSE_SIZE)
            placed.append(PlacedBlock(JacobianBlock(eq.owner, "joints", J, ahead=ahead), columns, J))
        if eq.mean is not None and eq.whitening is not None:
            by_mean = np.broadcast_to(-eq.whitening, (t, 1, *eq.whitening.shape))
            placed += self._placed([JacobianBlock(eq.owner, eq.mean, by_mean)], eq)
        return placed

    # Sums

    def _add_blocks(self, placed: Sequence[PlacedBlock], equations: Residuals) -> None:
        t, weight = len(equations.residual), equations.weight[..., None, None]
        for number, row in enumerate(placed):
            weighted = weight * row.jacobian
            self._add_gradient(row, (weighted.swapaxes(2, 3) @ equations.residual[..., None])[..., 0], equations)
            for column in placed[number:]:
                J_row, J_column = weighted, column.jacobian
                if not (row.block.is_per_factor or column.block.is_per_factor):  # summed over factors at once
                    J_row, J_column = (J.reshape(t, 1, -1, J.shape[3]) for J in (J_row, J_column))
                self._add_block(row, column, J_row.swapaxes(2, 3) @ J_column, equations)

    def _rows(self, equations: Residuals) -> tuple[slice, slice]:
        """Factors that begin in the stretch, and their frames in it, as slices."""
        start = equations.first_frame - self.begin
        low, high = max(start, 0), min(start + len(equations.residual), self.count)
        return slice(low - start, max(high, low) - start), slice(low, max(high, low))

    def _static_target(self, into: Array, values: Array, equations: Residuals) -> tuple[Array, Array]:
        """Select target and values for static columns: frame by frame, or summed if the target is for all frames."""
        source, target = self._rows(equations)
        if len(into) == self.count and self.count > 1:
            return into[target], values[source]
        return into, values[source].sum(axis=0, keepdims=True)

    def _frame_columns(self, placed: PlacedBlock) -> slice:
        start = self.layout.chain_columns[placed.range.chain].start
        return slice(start + placed.range.start, start + placed.range.stop)

    def _add_block(self, row: PlacedBlock, column: PlacedBlock, block: Array, equations: Residuals) -> None:
        """Add the block ``(t, n, c, c')`` between two sets of variables."""
        row_in_frame, column_in_frame = row.range.chain != STATIC, column.range.chain != STATIC
        if row_in_frame and column_in_frame:
            self._add_frames(row, column, block.sum(axis=1), equations)
        elif row_in_frame:
            self._add_coupling(row, column, block, equations)
        elif column_in_frame:
            self._add_coupling(column, row, block.swapaxes(2, 3), equations)
        else:
            if not (row.block.is_per_factor or column.block.is_per_factor):
                block = block.sum(axis=1, keepdims=True)
            into, block = self._static_target(self._blocks.static, block, equations)
            into[:, row.columns[:, :, None], column.columns[:, None, :]] += block
            if row is not column:
                into[:, column.columns[:, :, None], row.columns[:, None, :]] += block.swapaxes(2, 3)

    def _add_frames(self, row: PlacedBlock, column: PlacedBlock, block: Array, equations: Residuals) -> None:
        if (column.ahead, column.range.chain) < (row.ahead, row.range.chain):
            row, column, block = column, row, block.swapaxes(1, 2)
        rows, columns = self._frame_columns(row), self._frame_columns(column)
        start = column.ahead * self.layout.frame_width
        source, target = self._rows(equations)
        into = self._blocks.frames[:, row.ahead, :, start : start + self.layout.frame_width]
        into[target, rows, columns] += block[source]
        if row is not column and (row.ahead, row.range.chain) == (column.ahead, column.range.chain):
            into[target, columns, rows] += block[source].swapaxes(1, 2)

    def _add_coupling(self, frame: PlacedBlock, static: PlacedBlock, block: Array, equations: Residuals) -> None:
        source, target = self._rows(equations)
        per_factor = block.swapaxes(1, 2).reshape(len(block), block.shape[2], -1)
        block = per_factor if static.block.is_per_factor else block.sum(axis=1)
        into = self._blocks.coupling[:, frame.ahead, :, static.range.columns]
        into[target, self._frame_columns(frame)] += block[source]

    def _add_gradient(self, placed: PlacedBlock, vector: Array, equations: Residuals) -> None:
        """Add the gradient ``(t, n, c)`` of a set of variables."""
        if placed.range.chain == STATIC:
            vector = vector if placed.block.is_per_factor else vector.sum(axis=1, keepdims=True)
            into, vector = self._static_target(self._blocks.static_gradient, vector, equations)
            into[:, placed.columns] += vector
            return
        source, target = self._rows(equations)
        self._blocks.gradient[:, placed.ahead, self._frame_columns(placed)][target] += vector[source].sum(axis=1)
