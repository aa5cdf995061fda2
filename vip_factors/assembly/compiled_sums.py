"""Equations summed by compiled code: what the accumulators of slices and of chains do with NumPy."""

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from vip_factors.assembly.accumulator import Accumulator, add_mean, force_of
from vip_factors.assembly.chain import ChainAccumulator
from vip_factors.assembly.charts import Charts
from vip_factors.assembly.slices import SliceAccumulator
from vip_factors.body.kinematics import BodyState
from vip_factors.body.skeleton import PARENTS
from vip_factors.compiled import kernels
from vip_factors.geometry.rotations import Array
from vip_factors.problem.layout import FRAME, STATIC, Layout, OwnerId
from vip_factors.solve.chain_system import REACH, ChainSystem
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


class _Compiled(Accumulator):
    """Sums a stretch of frames into ``target``, where compiled code finds the places of a slice's columns."""

    by_first_frame = True

    def into(self, target: Any) -> None:
        """Begin."""
        self._target = target
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
            there = min(self.begin + self.count + REACH, len(bodies[wearer].p_world_joint))
            screws = bodies[wearer].at(slice(self.begin, there)).screws
            sums.expand(screws if self.charts is None else self.charts.screws(wearer, screws))

    def _body(self, owner: OwnerId) -> Any:
        """Where an owner's bones are summed; None where they are kept."""
        chain = self.layout.chain_of(owner)
        if chain is not None and chain not in self._bodies:
            first, width = self.layout.chain_columns[chain].start, self.layout.frame_width
            others = width - FRAME + self.layout.static_width
            self._bodies[chain] = kernels.BodySums(self._target, first, width, _PARENTS, others)
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
        first = eq.first - self.begin
        if body is None:
            kernels.add_columns(self._target, first, *rows)
        elif isinstance(eq, DifferenceEquations):
            body.add_differences(first, _numbers(eq.bones), eq.arms, eq.coefficients, *rows)
        elif isinstance(eq, BoneEquations):
            body.add_bones(first, _numbers(eq.bones), by_twist, *rows)

    def _start(self, chain: int, ahead: int) -> int:
        """First column of a chain's frame, or of what all frames share, in a slice."""
        width = self.layout.frame_width
        return (REACH + 1) * width if chain == STATIC else ahead * width + self.layout.chain_columns[chain].start

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
            body.add_each_joint(eq.first - self.begin, by_joints[0], eq.residual.reshape(shape), weight)
            return
        force = force_of(eq)
        body.add_joints(eq.first - self.begin, np.stack(by_joints), eq.information, eq.weight[:, 0], force)
        if eq.mean is not None:
            for ahead, D in enumerate(by_joints):
                add_mean(self, eq, chain, ahead, D, force)


class CompiledSliceAccumulator(_Compiled, SliceAccumulator):
    """Sums all frames of a stretch into slices; arguments as there."""

    def __init__(self, layout: Layout, slices: Slices, frames: int, charts: Charts | None) -> None:
        super().__init__(layout, slices, frames, charts)
        self.into(kernels.Target(self._hessian, self._gradient))


class CompiledChainAccumulator(_Compiled, ChainAccumulator):
    """Sums a stretch of frames into chains in which nothing walks; arguments and attributes as there.

    It takes the factors whose first frame is in the stretch: it writes into the frames behind it, too.
    """

    def __init__(self, layout: Layout, system: ChainSystem, begin: int, count: int) -> None:
        super().__init__(layout, system, begin, count)
        chains = [(one.rows, one.gradient, _places(system, layout, p), one.tied) for p, one in enumerate(system.chains)]
        self.into(kernels.Target(chains, self.static, self.static_gradient, begin, count))


def _places(system: ChainSystem, layout: Layout, chain: int) -> np.ndarray:
    """Where in a chain's rows the columns ``(W + s,)`` of a frame and of what is shared are; −1 if nowhere."""
    own, places = layout.chain_columns[chain], np.full(layout.frame_width + layout.static_width, -1)
    places[own] = np.arange(own.stop - own.start)
    rows = system.chains[chain].rows
    met = [(layout.chain_columns[q].start, blocks) for (p, q), blocks in system.between.items() if p == chain]
    for (p, g), blocks in system.coupling.items():
        if p == chain:
            met.append((layout.frame_width + system.groups[g].columns.start, blocks))
    start = rows.shape[2] - sum(blocks.shape[2] for _, blocks in met)
    for at, blocks in met:  # in the order in which they lie there
        places[at : at + blocks.shape[2]] = np.arange(start, start + blocks.shape[2])
        start += blocks.shape[2]
    return places


def _of_each(values: np.ndarray | float) -> Array:
    """What factors ``(t, n)`` have, as it is broadcast to them."""
    return np.asarray(values, dtype=float).reshape(np.shape(values) or (1, 1))


@cache
def _numbers(bones: tuple[int, ...]) -> np.ndarray:
    return np.array(bones)
