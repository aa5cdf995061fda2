"""Equations summed into slices by compiled code: what :class:`~vip_factors.assembly.slices.SliceAccumulator` does."""

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from vip_factors.assembly.accumulator import add_mean, force_of
from vip_factors.assembly.charts import Charts
from vip_factors.assembly.slices import SliceAccumulator
from vip_factors.body.kinematics import BodyState
from vip_factors.body.skeleton import PARENTS
from vip_factors.compiled import kernels
from vip_factors.geometry.rotations import Array
from vip_factors.problem.layout import FRAME, STATIC, Layout, OwnerId
from vip_factors.solve.slices import Slices
from vip_factors.terms.equations import (
    BoneEquations,
    DenseEquations,
    DifferenceEquations,
    Equations,
    JacobianBlock,
    JointEquations,
    KnotEquations,
)

_PARENTS = np.array(PARENTS)


class CompiledSliceAccumulator(SliceAccumulator):
    """Sums all frames of a stretch into slices; arguments as there."""

    def __init__(self, layout: Layout, slices: Slices, frames: int, charts: Charts | None) -> None:
        super().__init__(layout, slices, frames, charts)
        self._bodies = dict[int, Any]()  # by chain

    def add(self, equations: Equations) -> None:
        """Take in the equations of one term."""
        match equations:
            case BoneEquations():
                by_twist, others = equations.derivatives()
                self._add(equations, others, self._body(equations.owner), by_twist)
            case DifferenceEquations():
                self._add(equations, equations.blocks(), self._body(equations.owner))
            case DenseEquations():
                self._add(equations, equations.blocks(), None)
            case JointEquations():
                self._add_joints(equations)
            case KnotEquations():
                self.add_knots(equations)

    def finish(self, bodies: Sequence[BodyState]) -> None:
        """See the base."""
        for chain, sums in self._bodies.items():
            wearer = self.layout.chains[chain].owner.number
            screws = bodies[wearer].screws
            sums.expand(screws if self.charts is None else self.charts.screws(wearer, screws))

    def _body(self, owner: OwnerId) -> Any:
        """Where an owner's bones are summed; None where they are kept."""
        chain = self.layout.chain_of(owner)
        if chain is not None and chain not in self._bodies:
            first, others = self.layout.chain_columns[chain].start, self._width - FRAME + self.layout.static_width
            self._bodies[chain] = kernels.BodySums(self._hessian, self._gradient, first, self._width, _PARENTS, others)
        return None if chain is None else self._bodies[chain]

    def _add(
        self, eq: BoneEquations | DifferenceEquations | DenseEquations, blocks: Sequence[JacobianBlock], body: Any,
        by_twist: Array | None = None,
    ) -> None:  # fmt: skip
        placed = [
            (one.jacobian, self._start(one.range.chain, one.ahead) + one.range.start, one.block.each)
            for one in self.placed(blocks, eq)
        ]
        rows = eq.residual, _of_each(eq.confidence), eq.loss.loss.value, _of_each(eq.loss.k), placed
        if body is None:
            kernels.add_columns(self._hessian, self._gradient, eq.first, *rows)
        elif isinstance(eq, DifferenceEquations):
            body.add_differences(eq.first, _numbers(eq.bones), eq.arms, eq.coefficients, *rows)
        elif isinstance(eq, BoneEquations):
            body.add_bones(eq.first, _numbers(eq.bones), by_twist, *rows)

    def _start(self, chain: int, ahead: int) -> int:
        """First column of a chain's frame, or of what all frames share, in a slice."""
        return self._static if chain == STATIC else ahead * self._width + self.layout.chain_columns[chain].start

    def _add_joints(self, eq: JointEquations) -> None:
        chain, body = self.layout.chain_of(eq.owner), self._body(eq.owner)
        if chain is None or not eq.acts:
            return
        by_joints = [
            D if self.charts is None else D @ self.charts.joints(eq.owner.number, eq.first + ahead, len(D))
            for ahead, D in enumerate(eq.by_joints())
        ]
        if eq.whitening is None:
            shape = by_joints[0].shape[:3]
            weight = np.broadcast_to(eq.weight.reshape(*shape[:2], -1), shape)
            body.add_each_joint(eq.first, by_joints[0], eq.residual.reshape(shape), weight)
            return
        force = force_of(eq)
        body.add_joints(eq.first, np.stack(by_joints), eq.information, eq.weight[:, 0], force)
        if eq.mean is not None:
            for ahead, D in enumerate(by_joints):
                add_mean(self, eq, chain, ahead, D, force)


def _of_each(values: np.ndarray | float) -> Array:
    """What factors ``(t, n)`` have, as it is broadcast to them."""
    return np.asarray(values, dtype=float).reshape(np.shape(values) or (1, 1))


@cache
def _numbers(bones: tuple[int, ...]) -> np.ndarray:
    return np.array(bones)
