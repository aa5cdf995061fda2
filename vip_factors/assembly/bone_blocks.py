"""From what factors say of the twists of bones to normal equations of the joints that turn them.

A factor that sees a bone has a Jacobian of few rows by that twist, and the twist is the sum of the screws of the
joints above it. So its ``JᵀJ`` is first a 6×6 block of its bone; blocks of bones beyond the same joint are added up,
and only the sums meet the screws: the composite inertias of rigid body dynamics (Featherstone, "Rigid Body Dynamics
Algorithms", 6.2). Frames with a hundred rows cost hardly more than frames with one.
"""

from functools import cache

import numpy as np

from vip_factors.assembly.scatter import PlacedBlock, Scatter
from vip_factors.body.kinematics import MOVES, BodyState, twists_at
from vip_factors.body.skeleton import JOINT_COUNT
from vip_factors.geometry.rotations import Array
from vip_factors.problem.layout import FRAME, STATIC, ColumnRange
from vip_factors.terms.equations import BoneEquations, DifferenceEquations

SUMS = JOINT_COUNT + 1  # of the bones beyond each joint, and of all


class BoneBlocks:
    """Of one body in a stretch of ``count`` frames; sums over the bones beyond each joint, slot by slot.

    Attributes:
        information, force: ``(count, 25, 6, 6)`` and ``(count, 25, 6)``.
        coupling: ``(count, 25, 6, c)`` with a block that all factors share, by its columns.
        each: ``(count, n, 6, c)`` with the items of a block of which each factor has its own, by the bones and columns.
    """

    def __init__(self, count: int) -> None:
        self.count = count
        self.information: dict[tuple[int, int], Array] = {}
        self.force: dict[int, Array] = {}
        self.coupling: dict[tuple[int, ColumnRange], Array] = {}
        self.each: dict[tuple[int, tuple[int, ...], ColumnRange], Array] = {}

    # Adding

    def add_frame(self, sums: Scatter, eq: BoneEquations, blocks: Array, placed: list[PlacedBlock]) -> None:
        """Add rows ``(t, n, k, …)`` by the twist (or the turn alone), columns: the twist, the parts, the gradient."""
        source, target = sums.rows(eq)
        k = blocks.shape[2]
        own = slice(0, k)
        self._of(self.information, (0, 0), (SUMS, 6, 6))[target, :, own, own] += carried(
            eq.bones, blocks[source, :, :, :k]
        )
        self._of(self.force, 0, (SUMS, 6))[target, :, own] += carried(eq.bones, blocks[source, :, :, -1])
        start = k
        for one in placed:
            stop = start + one.jacobian.shape[3]
            self._add_part(eq.bones, 0, one, blocks[source, :, :, start:stop], target)
            start = stop

    def add_differences(self, sums: Scatter, eq: DifferenceEquations, weight: Array, placed: list[PlacedBlock]) -> None:
        """Add factors that are linear in positions: their weights first, for the points' Jacobians come in but once."""
        c, n = eq.coefficients, len(eq.bones)
        scales: dict[tuple[int, int], Array] = {}
        forces: dict[int, Array] = {}
        pushed = weight[..., None] * eq.residual
        source, target = sums.rows(eq)
        for i in range(len(c)):
            for j in range(i, len(c)):
                self._of(scales, (i, j), (n,))[target] += c[i] * c[j] * weight[source]
            self._of(forces, i, (n, 3))[target] += c[i] * pushed[source]
        J = twists_at(eq.arms)
        for (i, j), scale in scales.items():
            rows = self._rows(sums, eq, j)
            if not rows.stop:  # the last frames see no frame that is so far ahead
                continue
            now, later = self._frames(sums, eq, J, i, rows), self._frames(sums, eq, J, j, rows)
            block = now.swapaxes(2, 3) @ (scale[rows, :, None, None] * later)
            self._of(self.information, (i, j), (SUMS, 6, 6))[rows] += carried(eq.bones, block)
        for i, force in forces.items():
            rows = self._rows(sums, eq, i)
            by_twist = self._frames(sums, eq, J, i, rows).swapaxes(2, 3)
            pulled = (by_twist @ force[rows, :, :, None])[..., 0]
            self._of(self.force, i, (SUMS, 6))[rows] += carried(eq.bones, pulled)
        for one in placed:
            self._add_difference_part(sums, eq, J, weight, one)

    def _add_difference_part(
        self, sums: Scatter, eq: DifferenceEquations, J: Array, weight: Array, one: PlacedBlock
    ) -> None:
        """What ties the points in each of the frames to a part."""
        seen = weight[..., None, None] * one.jacobian
        source, target = sums.rows(eq)
        forces: dict[int, Array] = {}
        for i, c in enumerate(eq.coefficients):
            self._of(forces, i, seen.shape[1:])[target] += c * seen[source]
        for i, force in forces.items():
            rows = self._rows(sums, eq, i)
            block = self._frames(sums, eq, J, i, rows).swapaxes(2, 3) @ force[rows]
            self._add_part(eq.bones, i, one, block, rows)

    def _add_part(self, bones: tuple[int, ...], i: int, one: PlacedBlock, block: Array, target: slice) -> None:
        k, c = block.shape[2:]
        if one.block.each:
            self._of(self.each, (i, bones, one.range), (len(bones), 6, c))[target, :, :k] += block
        else:
            self._of(self.coupling, (i, one.range), (SUMS, 6, c))[target, :, :k] += carried(bones, block)

    def _of(self, blocks: dict, key: object, shape: tuple[int, ...]) -> Array:
        if key not in blocks:
            blocks[key] = np.zeros((self.count, *shape))
        found: Array = blocks[key]
        return found

    def _rows(self, sums: Scatter, eq: DifferenceEquations, last: int) -> slice:
        """Rows of a slot, as far as there are positions for its last frame."""
        return slice(0, max(0, min(self.count, eq.first + len(eq.arms) - last - sums.begin)))

    def _frames(self, sums: Scatter, eq: DifferenceEquations, J: Array, i: int, rows: slice) -> Array:
        start = sums.begin + i - eq.first
        return J[start : start + rows.stop]

    # Carrying over to joints

    def expand(self, sums: Scatter, chain: int, body: BodyState) -> None:
        """Add all that has been summed to the blocks of the joints and the root."""
        T = len(body.p_world_joint)
        beyond = max([1, *(j + 1 for _, j in self.information)])
        stretch = body.at(slice(sums.begin, min(sums.begin + self.count + beyond - 1, T)))
        screws = stretch.screws
        if sums.charts is not None:
            screws = sums.charts.screws(sums.layout.chains[chain].owner.number, screws)

        def there(i: int, blocks: Array, last: int) -> tuple[Array, Array]:
            n = max(0, min(len(blocks), len(screws) - last))
            return screws[i : i + n], blocks[:n]

        for (i, j), information in self.information.items():
            now, blocks = there(i, information, j)
            n, into = len(now), sums.frame_frame(chain, i, chain, j)
            if i == j:
                into[:n] += hessian(now, blocks)
            elif n:
                into[:n] += hessian_between(now, blocks, screws[j : j + n])
        for i, force in self.force.items():
            now, blocks = there(i, force, i)
            sums.frame_gradient(chain, i)[: len(now)] += gradient(now, blocks)
        for (i, columns), block_of_all in self.coupling.items():
            now, blocks = there(i, block_of_all, i)
            by_joints, n = coupling(now, blocks), len(now)
            if columns.chain == STATIC:
                sums.frame_static(chain, i, columns.columns)[:n] += by_joints
            else:
                sums.frame_frame(chain, i, columns.chain, i)[:n, :, columns.columns] += by_joints
        for (i, bones, columns), each in self.each.items():
            now, blocks = there(i, each, i)
            sums.frame_static(chain, i, columns.columns)[: len(now)] += coupling_of_each(now, bones, blocks)


# Whether the joint of a row is one that moves the joint of a column, or is it; the root's translation moves all.
_above = np.column_stack([MOVES, np.eye(JOINT_COUNT + 1)[:, -1]])
_ABOVE = np.kron(_above, np.ones((3, 3)))
_BELOW = np.kron(_above.T - np.eye(JOINT_COUNT + 1), np.ones((3, 3)))
_HALF = np.kron(_above - 0.5 * np.eye(JOINT_COUNT + 1), np.ones((3, 3)))  # a half that gives the whole with its mirror


@cache
def _movers(bones: tuple[int, ...]) -> Array:
    """Of each joint, which of these bones it moves: ``(25, n)``."""
    return np.asarray(MOVES[:, list(bones)], dtype=float, order="C")


@cache
def _moved_columns(bones: tuple[int, ...], columns: int) -> Array:
    """Of each column of a frame, which of these bones it moves, each repeated: ``(75, n · columns)``."""
    return np.asarray(np.kron(_movers(bones), np.ones((3, columns))), dtype=float)


def carried(bones: tuple[int, ...], blocks: Array) -> Array:
    """Sums ``(T, 25, …)`` of what is known of bones ``(T, n, …)``, over all that each joint moves."""
    T, n, *shape = blocks.shape
    return (_movers(bones) @ blocks.reshape(T, n, -1)).reshape(T, -1, *shape)


def hessian(screws: Array, information: Array) -> Array:
    """``(T, 75, 75)`` of symmetric information ``(T, 25, 6, 6)`` on twists, as :func:`carried` sums it."""
    half = _transposed(screws) @ _flat(information @ screws)
    half *= _HALF
    return half + half.swapaxes(1, 2)


def hessian_between(screws: Array, information: Array, screws_after: Array) -> Array:
    """``(T, 75, 75)`` of information ``(T, 25, 6, 6)`` between the twists in a frame and those in another.

    Two joints meet in what the lower of them moves; those on different limbs do not.
    """
    H = _transposed(screws) @ _flat(information @ screws_after)
    H *= _ABOVE
    below = _transposed(information.swapaxes(2, 3) @ screws) @ _flat(screws_after)
    below *= _BELOW
    H += below
    return H


def gradient(screws: Array, force: Array) -> Array:
    """``(T, 75)`` of forces on twists ``(T, 25, 6)``, as :func:`carried` sums them."""
    return coupling(screws, force[..., None])[..., 0]


def coupling(screws: Array, blocks: Array) -> Array:
    """``(T, 75, c)`` of blocks ``(T, 25, 6, c)`` between twists and other variables, as :func:`carried` sums them."""
    return (screws.swapaxes(2, 3) @ blocks).reshape(len(screws), FRAME, -1)


def coupling_of_each(screws: Array, bones: tuple[int, ...], blocks: Array) -> Array:
    """``(T, 75, n · c)`` of blocks ``(T, n, 6, c)`` between the twist of each bone and variables of its own."""
    T, n, _, c = blocks.shape
    block = _transposed(screws) @ blocks.swapaxes(1, 2).reshape(T, 6, n * c)
    block *= _moved_columns(bones, c)
    return block


def _flat(screws: Array) -> Array:
    """Side by side: ``(T, 6, 75)``."""
    return screws.swapaxes(1, 2).reshape(len(screws), 6, FRAME)


def _transposed(screws: Array) -> Array:
    """One below the other: ``(T, 75, 6)``."""
    return screws.swapaxes(2, 3).reshape(len(screws), FRAME, 6)
