"""What terms say of bones, summed as blocks of their twists before any joint is thought of."""

from typing import TYPE_CHECKING

import numpy as np

from vip_factors.assembly import twist
from vip_factors.body.kinematics import BodyState, twists_at
from vip_factors.body.skeleton import JOINT_COUNT
from vip_factors.geometry.rotations import Array
from vip_factors.problem.layout import STATIC, Place
from vip_factors.terms.equations import BoneEquations, DifferenceEquations

if TYPE_CHECKING:
    from vip_factors.assembly.accumulator import Accumulator, PlacedPart

SUMS = JOINT_COUNT + 1  # of the bones beyond each joint, and of all


class BoneBlocks:
    """Of one body in a stretch of ``count`` frames; sums over the bones beyond each joint, slot by slot.

    Attributes:
        information, force: ``(count, 25, 6, 6)`` and ``(count, 25, 6)``.
        beside: ``(count, 25, 6, c)`` with a block that all factors share, by its place.
        each: ``(count, n, 6, c)`` with the items of a block of which each factor has its own, by the bones and the
            place; where it walks, by how many frames later the item is.
    """

    def __init__(self, count: int) -> None:
        self.count = count
        self.information: dict[tuple[int, int], Array] = {}
        self.force: dict[int, Array] = {}
        self.beside: dict[tuple[int, Place], Array] = {}
        self.each: dict[tuple[int, tuple[int, ...], Place, int], Array] = {}

    # Adding

    def add_frame(self, sums: "Accumulator", eq: BoneEquations, blocks: Array, placed: "list[PlacedPart]") -> None:
        """Add rows ``(t, n, k, …)`` by the twist (or the turn alone), columns: the twist, the parts, the gradient."""
        (i, j), shift = sums.slot(0, 0)
        source, target = sums.rows(shift, eq)
        k = blocks.shape[2]
        own = slice(0, k)
        self._of(self.information, (i, j), (SUMS, 6, 6))[target, :, own, own] += twist.carried(
            eq.bones, blocks[source, :, :, :k]
        )
        self._of(self.force, i, (SUMS, 6))[target, :, own] += twist.carried(eq.bones, blocks[source, :, :, -1])
        start = k
        for part in placed:
            stop = start + part.jacobian.shape[3]
            self._add_part(sums, eq.bones, i, part, blocks[source, :, :, start:stop], target, 0)
            start = stop

    def add_differences(
        self, sums: "Accumulator", eq: DifferenceEquations, weight: Array, placed: "list[PlacedPart]"
    ) -> None:
        """Add factors that are linear in positions: their weights first, for the points' Jacobians come in but once."""
        c, n = eq.coefficients, len(eq.bones)
        scales: dict[tuple[int, int], Array] = {}
        pulls: dict[int, Array] = {}
        pushed = weight[..., None] * eq.residual
        for i in range(len(c)):
            for j in range(i, len(c)):
                slot, shift = sums.slot(i, j)
                source, target = sums.rows(shift, eq)
                self._of(scales, slot, (n,))[target] += c[i] * c[j] * weight[source]
            (a, _), shift = sums.slot(i, i)
            source, target = sums.rows(shift, eq)
            self._of(pulls, a, (n, 3))[target] += c[i] * pushed[source]
        J = twists_at(eq.arms)
        for (i, j), scale in scales.items():
            rows = self._rows(sums, eq, j)
            if not rows.stop:  # the last frames see no frame that is so far ahead
                continue
            now, later = self._frames(sums, eq, J, i, rows), self._frames(sums, eq, J, j, rows)
            block = now.swapaxes(2, 3) @ (scale[rows, :, None, None] * later)
            self._of(self.information, (i, j), (SUMS, 6, 6))[rows] += twist.carried(eq.bones, block)
        for i, pull in pulls.items():
            rows = self._rows(sums, eq, i)
            by_twist = self._frames(sums, eq, J, i, rows).swapaxes(2, 3)
            pulled = (by_twist @ pull[rows, :, :, None])[..., 0]
            self._of(self.force, i, (SUMS, 6))[rows] += twist.carried(eq.bones, pulled)
        for part in placed:
            self._add_difference_part(sums, eq, J, weight, part)

    def _add_difference_part(
        self, sums: "Accumulator", eq: DifferenceEquations, J: Array, weight: Array, part: "PlacedPart"
    ) -> None:
        """What ties the points in each of the frames to a part; a walking one apart by how far it is from the frame."""
        walks, seen = sums.walks(part.place), weight[..., None, None] * part.jacobian
        pulls: dict[tuple[int, int], Array] = {}
        for i, c in enumerate(eq.coefficients):
            (a, _), shift = sums.slot(i, i)
            source, target = sums.rows(shift, eq)
            later = part.ahead - i if walks else 0
            self._of(pulls, (a, later), seen.shape[1:])[target] += c * seen[source]
        for (i, later), pull in pulls.items():
            rows = self._rows(sums, eq, i)
            block = self._frames(sums, eq, J, i, rows).swapaxes(2, 3) @ pull[rows]
            self._add_part(sums, eq.bones, i, part, block, rows, later)

    def _add_part(
        self, sums: "Accumulator", bones: tuple[int, ...], i: int, part: "PlacedPart", block: Array, target: slice,
        later: int,
    ) -> None:  # fmt: skip
        k, c = block.shape[2:]
        if part.part.each:
            shape = (len(bones), 6, c)
            self._of(self.each, (i, bones, part.place, later), shape)[target, :, :k] += block
        else:
            self._of(self.beside, (i, part.place), (SUMS, 6, c))[target, :, :k] += twist.carried(bones, block)

    def _of(self, blocks: dict, key: object, shape: tuple[int, ...]) -> Array:
        if key not in blocks:
            blocks[key] = np.zeros((self.count, *shape))
        found: Array = blocks[key]
        return found

    def _rows(self, sums: "Accumulator", eq: DifferenceEquations, last: int) -> slice:
        """Rows of a slot, as far as there are positions for its last frame."""
        return slice(0, max(0, min(self.count, eq.first + len(eq.arms) - last - sums.begin)))

    def _frames(self, sums: "Accumulator", eq: DifferenceEquations, J: Array, i: int, rows: slice) -> Array:
        start = sums.begin + i - eq.first
        return J[start : start + rows.stop]

    # Carrying over to joints

    def expand(self, sums: "Accumulator", part: int, body: BodyState) -> None:
        """Add all that has been summed to the blocks of the joints and the root."""
        T = len(body.p_world_joint)
        beyond = max([1, *(j + 1 for _, j in self.information)])
        stretch = body.at(slice(sums.begin, min(sums.begin + self.count + beyond - 1, T)))
        screws = stretch.screws if sums.charts is None else sums.charts.screws(part, stretch.screws)

        def there(i: int, blocks: Array, last: int) -> tuple[Array, Array]:
            n = max(0, min(len(blocks), len(screws) - last))
            return screws[i : i + n], blocks[:n]

        for (i, j), information in self.information.items():
            now, blocks = there(i, information, j)
            n, into = len(now), sums.frame_frame(part, i, part, j)
            if i == j:
                into[:n] += twist.hessian(now, blocks)
            elif n:
                into[:n] += twist.hessian_between(now, blocks, screws[j : j + n])
        for i, force in self.force.items():
            now, blocks = there(i, force, i)
            sums.frame_gradient(part, i)[: len(now)] += twist.gradient(now, blocks)
        for (i, place), beside in self.beside.items():
            now, blocks = there(i, beside, i)
            coupling, n = twist.coupling(now, blocks), len(now)
            if place.part == STATIC:
                sums.frame_static(part, i, place.columns)[:n] += coupling
            else:
                sums.frame_frame(part, i, place.part, i)[:n, :, place.columns] += coupling
        for (i, bones, place, later), each in self.each.items():
            now, blocks = there(i, each, i)
            sums.add_each(part, i, place, later, twist.coupling_of_each(now, bones, blocks))
