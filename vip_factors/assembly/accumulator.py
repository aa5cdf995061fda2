"""From the equations of terms to blocks of normal equations: shape by shape, knowing no term by its name.

Where a block goes is all that a chain and slices disagree about. Of a factor whose first frame is ``f``, the block
between its frames ``f + i`` and ``f + j`` is, in a chain, one of frame ``f + i`` with the frame ``j − i`` later, summed
with those of other factors there; in slices, of the ``i``-th and the ``j``-th frame of slice ``f``.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from vip_factors.assembly.bone_blocks import BoneBlocks
from vip_factors.assembly.charts import Charts
from vip_factors.assembly.joint_blocks import add_joints
from vip_factors.body.kinematics import BodyState
from vip_factors.geometry.rotations import Array
from vip_factors.problem.layout import STATIC, Layout, OwnerId, Place
from vip_factors.terms.equations import (
    AT_THE_FIRST_KNOT,
    BoneEquations,
    DenseEquations,
    DifferenceEquations,
    Equations,
    JacobianBlock,
    JointEquations,
    KnotEquations,
    Residuals,
)

Slot: TypeAlias = tuple[int, int]


@dataclass(frozen=True)
class PlacedPart:
    """A part whose block moves, in charted columns."""

    part: JacobianBlock
    place: Place
    jacobian: Array

    @property
    def ahead(self) -> int:
        """Frames after the factor's first one."""
        return max(self.part.ahead, 0)

    @property
    def columns(self) -> np.ndarray:
        """``(n, c)`` of each factor, or ``(1, c)`` of all."""
        width = self.jacobian.shape[3]
        return np.arange(self.place.columns.start, self.place.columns.stop).reshape(-1, width)


class Accumulator(ABC):
    """Sums equations over a stretch of frames.

    Args:
        layout: where columns are.
        begin, count: the stretch.
        charts: of coordinates, where steps are not what is solved for.
    """

    def __init__(self, layout: Layout, begin: int, count: int, charts: Charts | None = None) -> None:
        self.layout, self.begin, self.count, self.charts = layout, begin, count, charts
        self._bones: dict[int, BoneBlocks] = {}

    @property
    def stretch(self) -> slice:
        """The frames."""
        return slice(self.begin, self.begin + self.count)

    # Where blocks go

    @abstractmethod
    def slot(self, i: int, j: int) -> tuple[Slot, int]:
        """Which slot, and how many frames after a factor's first one its row is."""

    @abstractmethod
    def frame_frame(self, part: int, i: int, other: int, j: int) -> Array:
        """The blocks ``(count, w, w')`` of two parts in a slot."""

    @abstractmethod
    def frame_static(self, part: int, i: int, columns: slice) -> Array:
        """The blocks ``(count, w, k)`` of a part with columns of one owner in the static vector."""

    @abstractmethod
    def frame_gradient(self, part: int, i: int) -> Array:
        """``(count, w)``."""

    @abstractmethod
    def add_static(self, rows: np.ndarray, columns: np.ndarray, block: Array, at: Residuals, mirror: bool) -> None:
        """Add ``(t, n, r, c)`` at static ``rows`` ``(n or 1, r)`` and ``columns``, and its mirror image if asked to."""

    @abstractmethod
    def add_static_gradient(self, columns: np.ndarray, vector: Array, at: Residuals) -> None:
        """Add ``(t, n, c)`` at columns ``(n or 1, c)``."""

    def walks(self, place: Place) -> bool:
        """Whether the values of a block change from frame to frame, between knots."""
        return False

    def add_each(self, part: int, i: int, place: Place, later: int, block: Array) -> None:
        """Add blocks ``(n ≤ count, w, k)`` of a part with a static block's values ``later`` frames after its own."""
        self.frame_static(part, i, place.columns)[: len(block)] += block

    def rows(self, shift: int, at: Residuals) -> tuple[slice, slice]:
        """Which of the factors have their row in the stretch, and which rows these are."""
        start = at.first + shift - self.begin
        low, high = max(start, 0), min(start + len(at.residual), self.count)
        return slice(low - start, max(high, low) - start), slice(low, max(high, low))

    def static_rows(self, at: Residuals) -> tuple[slice, slice]:
        """The same of those whose first frame is in the stretch: what they say of static variables counts once."""
        return self.rows(0, at)

    # Shapes

    def add(self, equations: Equations) -> None:
        """Take in the equations of one term."""
        match equations:
            case BoneEquations():
                self._add_bones(equations)
            case DifferenceEquations():
                self._add_differences(equations)
            case JointEquations():
                add_joints(self, equations)
            case DenseEquations():
                parts = self.placed(equations.blocks(), equations)
                self._add_parts(parts, equations)
            case KnotEquations():
                self.add_knots(equations)

    def add_knots(self, equations: KnotEquations) -> None:
        """Add factors between knots."""
        raise NotImplementedError("variables do not walk here")

    def finish(self, bodies: Sequence[BodyState]) -> None:
        """Carry what is known of bones over to the joints that move them; ``bodies`` of the wearers, in all frames."""
        for part, blocks in self._bones.items():
            blocks.expand(self, part, bodies[self.layout.parts[part].owner.number])

    def placed(self, parts: Sequence[JacobianBlock], at: Residuals) -> list[PlacedPart]:
        """Those parts whose blocks move."""
        found = []
        for part in parts:
            place = self.layout.place(part.owner, part.block)
            if place is not None:
                jacobian = part.jacobian if self.charts is None else self.charts.part(part, at.first)
                found.append(PlacedPart(part, place, jacobian))
        return found

    def bones_of(self, owner: OwnerId) -> tuple[int, BoneBlocks] | None:
        """Where an owner's bones are summed; None where they are kept."""
        part = self.layout.part_of(owner)
        if part is None:
            return None
        if part not in self._bones:
            self._bones[part] = BoneBlocks(self.count)
        return part, self._bones[part]

    def _add_bones(self, eq: BoneEquations) -> None:
        by_twist, parts = eq.derivatives()
        placed, own = self.placed(parts, eq), self.bones_of(eq.owner)
        # One product for all: the residual as one more column gives the gradient.
        columns = [*([by_twist] if own else []), *(part.jacobian for part in placed)]
        if not columns:
            return
        J = np.concatenate([*columns, eq.residual[..., None]], axis=3)
        blocks = (eq.weight[..., None, None] * J[..., :-1]).swapaxes(2, 3) @ J
        start = by_twist.shape[3] if own else 0
        if own is not None:
            own[1].add_frame(self, eq, blocks[:, :, :start], placed)
        for number, one in enumerate(placed):
            stop = start + one.jacobian.shape[3]
            self._scatter_gradient(one, blocks[:, :, start:stop, -1], eq)
            to = start
            for other in placed[number:]:
                self._scatter(one, other, blocks[:, :, start:stop, to : to + other.jacobian.shape[3]], eq)
                to += other.jacobian.shape[3]
            start = stop

    def _add_differences(self, eq: DifferenceEquations) -> None:
        placed, own = self.placed(eq.blocks(), eq), self.bones_of(eq.owner)
        weight = eq.weight
        if own is not None:
            own[1].add_differences(self, eq, weight, placed)
        self._add_parts(placed, eq, weight)

    def _add_parts(self, placed: Sequence[PlacedPart], at: Residuals, weight: Array | None = None) -> None:
        weight = at.weight if weight is None else weight
        for number, one in enumerate(placed):
            pushed = (weight[..., None, None] * one.jacobian).swapaxes(2, 3)
            self._scatter_gradient(one, (pushed @ at.residual[..., None])[..., 0], at)
            for other in placed[number:]:
                self._scatter(one, other, pushed @ other.jacobian, at)

    # Scattering

    def _scatter(self, one: PlacedPart, other: PlacedPart, block: Array, at: Residuals) -> None:
        """Add the block ``(t, n, c, c')`` between two parts."""
        mirror = one is not other
        first, second = one.place.part != STATIC, other.place.part != STATIC
        if first and second:
            self._scatter_frames(one, other, block.sum(axis=1), at)
        elif first:
            self._scatter_coupling(one, other, block, at)
        elif second:
            self._scatter_coupling(other, one, block.swapaxes(2, 3), at)
        else:
            self.add_static_parts(one, other, block, at, mirror)

    def add_static_parts(self, one: PlacedPart, other: PlacedPart, block: Array, at: Residuals, mirror: bool) -> None:
        """Add the block ``(t, n, c, c')`` between two static parts."""
        if not (one.part.each or other.part.each):
            block = block.sum(axis=1, keepdims=True)
        self.add_static(one.columns, other.columns, block, at, mirror)

    def _scatter_frames(self, one: PlacedPart, other: PlacedPart, block: Array, at: Residuals) -> None:
        if (other.ahead, other.place.part) < (one.ahead, one.place.part):
            one, other, block = other, one, block.swapaxes(1, 2)
        (i, j), shift = self.slot(one.ahead, other.ahead)
        source, target = self.rows(shift, at)
        into = self.frame_frame(one.place.part, i, other.place.part, j)
        into[target, one.place.columns, other.place.columns] += block[source]
        if one is not other and i == j and one.place.part == other.place.part:
            into[target, other.place.columns, one.place.columns] += block[source].swapaxes(1, 2)

    def _scatter_coupling(self, frame: PlacedPart, static: PlacedPart, block: Array, at: Residuals) -> None:
        (i, _), shift = self.slot(frame.ahead, frame.ahead)
        source, target = self.rows(shift, at)
        side_by_side = block.swapaxes(1, 2).reshape(len(block), block.shape[2], -1)
        block = side_by_side if static.part.each else block.sum(axis=1)
        into = self.frame_static(frame.place.part, i, static.place.columns)
        into[target, frame.place.columns] += block[source]

    def _scatter_gradient(self, one: PlacedPart, vector: Array, at: Residuals) -> None:
        if one.place.part == STATIC:
            self.add_static_gradient_part(one, vector, at)
            return
        (i, _), shift = self.slot(one.ahead, one.ahead)
        source, target = self.rows(shift, at)
        self.frame_gradient(one.place.part, i)[target, one.place.columns] += vector[source].sum(axis=1)

    def add_static_gradient_part(self, one: PlacedPart, vector: Array, at: Residuals) -> None:
        """Add ``(t, n, c)`` of a static part."""
        self.add_static_gradient(one.columns, vector if one.part.each else vector.sum(axis=1, keepdims=True), at)


def at_an_instant(part: JacobianBlock) -> bool:
    """Whether factors see a block that may walk as it is at a frame."""
    return part.ahead != AT_THE_FIRST_KNOT
