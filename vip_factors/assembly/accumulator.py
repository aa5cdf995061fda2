"""From the equations of terms to blocks of normal equations: shape by shape, knowing no term by its name."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from vip_factors.assembly.bone_blocks import BoneBlocks
from vip_factors.assembly.charts import Charts
from vip_factors.assembly.scatter import PlacedBlock, Scatter
from vip_factors.body.kinematics import BodyState
from vip_factors.body.pose_prior import POSE_SIZE
from vip_factors.geometry.rotations import Array, transpose
from vip_factors.problem.layout import ROOT, Layout, OwnerId
from vip_factors.solve.slices import Blocks
from vip_factors.terms.equations import (
    BoneEquations,
    DenseEquations,
    DifferenceEquations,
    Equations,
    JointEquations,
    Residuals,
    Term,
    WalkEquations,
)

JOINTS = slice(3, ROOT)  # columns of joints 1 … 23 in a body's frame
_EACH = np.arange(POSE_SIZE).reshape(-1, 3) + JOINTS.start


class Accumulator(Scatter):
    """Sums equations over a stretch of frames; arguments as of :class:`~vip_factors.assembly.scatter.Scatter`."""

    def __init__(self, layout: Layout, blocks: Blocks, begin: int, charts: Charts | None = None) -> None:
        super().__init__(layout, blocks, begin, charts)
        self._bones: dict[int, BoneBlocks] = {}

    def add_term(self, term: Term[Any], at: Any) -> None:
        """Take in a term at a state: the factors whose first frame is in the stretch."""
        for equations in term.of_first_in(at, self.stretch):
            self.add(equations)

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
                self._add_blocks(self.placed(equations.blocks(), equations), equations)
            case WalkEquations():
                pass  # process noise, which comes in where frames are eliminated

    def finish(self, bodies: Sequence[BodyState]) -> None:
        """Carry what is known of bones over to the joints that move them; ``bodies`` of the wearers, in all frames."""
        for chain, blocks in self._bones.items():
            blocks.expand(self, chain, bodies[self.layout.chains[chain].owner.number])

    def bones_of(self, owner: OwnerId) -> BoneBlocks | None:
        """Where an owner's bones are summed; None where they are kept."""
        chain = self.layout.chain_of(owner)
        return None if chain is None else self._bones.setdefault(chain, BoneBlocks(self.count))

    def _add_bones(self, eq: BoneEquations) -> None:
        by_twist, others = eq.derivatives()
        placed, own = self.placed(others, eq), self.bones_of(eq.owner)
        # One product for all: the residual as one more column gives the gradient.
        columns = [*([by_twist] if own is not None else []), *(one.jacobian for one in placed)]
        if not columns:
            return
        J = np.concatenate([*columns, eq.residual[..., None]], axis=3)
        blocks = (eq.weight[..., None, None] * J[..., :-1]).swapaxes(2, 3) @ J
        start = by_twist.shape[3] if own is not None else 0
        if own is not None:
            own.add_frame(self, eq, blocks[:, :, :start], placed)
        for number, one in enumerate(placed):
            stop = start + one.jacobian.shape[3]
            self.scatter_gradient(one, blocks[:, :, start:stop, -1], eq)
            to = start
            for other in placed[number:]:
                self.scatter(one, other, blocks[:, :, start:stop, to : to + other.jacobian.shape[3]], eq)
                to += other.jacobian.shape[3]
            start = stop

    def _add_differences(self, eq: DifferenceEquations) -> None:
        placed, own = self.placed(eq.blocks(), eq), self.bones_of(eq.owner)
        weight = eq.weight
        if own is not None:
            own.add_differences(self, eq, weight, placed)
        self._add_blocks(placed, eq, weight)

    def _add_blocks(self, placed: Sequence[PlacedBlock], at: Residuals, weight: Array | None = None) -> None:
        weight = at.weight if weight is None else weight
        for number, one in enumerate(placed):
            pushed = (weight[..., None, None] * one.jacobian).swapaxes(2, 3)
            self.scatter_gradient(one, (pushed @ at.residual[..., None])[..., 0], at)
            for other in placed[number:]:
                self.scatter(one, other, pushed @ other.jacobian, at)


def add_joints(sums: Scatter, eq: JointEquations) -> None:
    """Take in the equations of one term."""
    chain = sums.layout.chain_of(eq.owner)
    if chain is None or not eq.acts:
        return
    by_joints = [
        D if sums.charts is None else D @ sums.charts.joints(eq.owner.number, eq.first + ahead, len(D))
        for ahead, D in enumerate(eq.by_joints())
    ]
    if eq.whitening is None:
        _add_separate(sums, eq, chain, by_joints[0])
    else:
        _add_together(sums, eq, chain, by_joints)


def _add_separate(sums: Scatter, eq: JointEquations, chain: int, D: Array) -> None:
    """Each joint by itself, or each of its coordinates."""
    source, target = sums.rows(eq)
    weighted = transpose(eq.weight.reshape(*D.shape[:2], -1, 1) * D)[source]
    into = sums.frame_frame(chain, 0, chain, 0)[target]
    into[:, _EACH[:, :, None], _EACH[:, None, :]] += weighted @ D[source]
    sums.frame_gradient(chain, 0)[target, JOINTS] += _blocks_apply(weighted, eq.residual[source])


def _add_together(sums: Scatter, eq: JointEquations, chain: int, by_joints: list[Array]) -> None:
    """All coordinates at once: ``P`` between block-diagonal ``D``."""
    assert eq.whitening is not None
    P, force, weight = eq.information, force_of(eq), eq.weight[..., None, None]
    assert P is not None
    source, target = sums.rows(eq)
    for i, D in enumerate(by_joints):
        Dt = transpose(D[source])
        half = _blocks_times(weight[source] * Dt, P)  # Dᵀ P
        sums.frame_frame(chain, i, chain, i)[target, JOINTS, JOINTS] += _blocks_times(Dt, transpose(half))
        sums.frame_gradient(chain, i)[target, JOINTS] += _blocks_apply(Dt, force[source])
        for j in range(i + 1, len(by_joints)):
            block = transpose(_blocks_times(transpose(by_joints[j][source]), transpose(half)))
            sums.frame_frame(chain, i, chain, j)[target, JOINTS, JOINTS] += block
        if eq.mean is not None:
            add_mean(sums, eq, chain, i, D, force)


def force_of(eq: JointEquations) -> Array:
    """What pulls at the coordinates ``(t, 69)`` of all joints together."""
    assert eq.whitening is not None
    return eq.weight * (eq.residual[:, 0] @ eq.whitening)


def add_mean(sums: Scatter, eq: JointEquations, chain: int, i: int, D: Array, force: Array) -> None:
    """The block that coordinates are compared with: its derivative is theirs, turned round."""
    assert eq.mean is not None
    mean, P = sums.layout.columns_of(eq.owner, eq.mean), eq.information
    if mean is None:
        return
    assert P is not None
    source, target = sums.rows(eq)
    weight = eq.weight[..., None, None]
    sums.frame_static(chain, i, mean.columns)[target, JOINTS] -= _blocks_times(weight[source] * transpose(D[source]), P)
    columns = np.arange(mean.start, mean.stop)[None]
    sums.add_static(columns, columns, weight * P, eq, mirror=False)
    sums.add_static_gradient(columns, -force[:, None], eq)


def _blocks_times(blocks: Array, matrix: Array) -> Array:
    """``B M`` ``(t, 69, 69)`` for block-diagonal ``B``, given as ``(t, 23, 3, 3)``; ``M`` ``(69, 69)`` or stacked."""
    rows = matrix.reshape(*matrix.shape[:-2], POSE_SIZE // 3, 3, matrix.shape[-1])
    return (blocks @ rows).reshape(len(blocks), POSE_SIZE, POSE_SIZE)


def _blocks_apply(blocks: Array, vector: Array) -> Array:
    """``B v`` ``(t, 69)`` for block-diagonal ``B``."""
    return (blocks @ vector.reshape(len(blocks), POSE_SIZE // 3, 3, 1)).reshape(len(blocks), POSE_SIZE)
