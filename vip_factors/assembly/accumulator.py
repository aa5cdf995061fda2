"""From the equations of terms to blocks of normal equations: shape by shape, knowing no term by its name."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from vip_factors.assembly.charts import Charts
from vip_factors.assembly.scatter import PlacedBlock, Scatter
from vip_factors.body.kinematics import MOVES, BodyState, twists_at
from vip_factors.body.pose_prior import POSE_SIZE
from vip_factors.geometry.rotations import Array, transpose
from vip_factors.problem.layout import FRAME, ROOT, ColumnRange, Layout
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

JOINTS = slice(3, ROOT)  # columns of joints 1 … 23 in a body's frame
_EACH = np.arange(POSE_SIZE).reshape(-1, 3) + JOINTS.start


class Accumulator(Scatter):
    """Sums equations over a stretch of frames.

    Args:
        layout, blocks, begin, charts: as of :class:`~vip_factors.assembly.scatter.Scatter`.
        bodies: of the wearers, in all frames.
    """

    def __init__(
        self, layout: Layout, blocks: Blocks, begin: int, bodies: Sequence[BodyState], charts: Charts | None = None
    ) -> None:
        super().__init__(layout, blocks, begin, charts)
        self._bodies, self._screws = bodies, dict[tuple[int, int, int], Array]()

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

    def finish(self) -> None:
        """Take in what was put off until all terms are there."""

    def _add_bones(self, eq: BoneEquations) -> None:
        by_twist, others = eq.derivatives()
        self._add_blocks([*self._by_joints(eq, by_twist, 0), *self.placed(others, eq)], eq)

    def _add_differences(self, eq: DifferenceEquations) -> None:
        by_twist, t = twists_at(eq.arms), len(eq.residual)
        blocks = self.placed(eq.blocks(), eq)
        for ahead, c in enumerate(eq.coefficients):
            blocks += self._by_joints(eq, c * by_twist[ahead : ahead + t], ahead)
        self._add_blocks(blocks, eq)

    def _by_joints(self, eq: BoneEquations | DifferenceEquations, by_twist: Array, ahead: int) -> list[PlacedBlock]:
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

    def _add_blocks(self, placed: Sequence[PlacedBlock], at: Residuals) -> None:
        t, weight = len(at.residual), at.weight[..., None, None]
        for number, one in enumerate(placed):
            pushed = weight * one.jacobian
            self.scatter_gradient(one, (pushed.swapaxes(2, 3) @ at.residual[..., None])[..., 0], at)
            for other in placed[number:]:
                first, second = pushed, other.jacobian
                if not (one.block.each or other.block.each):  # summed over factors at once
                    first, second = (J.reshape(t, 1, -1, J.shape[3]) for J in (first, second))
                self.scatter(one, other, first.swapaxes(2, 3) @ second, at)


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
