"""A fixed-lag smoother of a chain: frames are eliminated in time order, what all frames share last.

It is the elimination that iSAM2 does with keys constrained to time order and leaves marginalised, kept as a list
instead of a tree: for a chain the tree is one. What the list brings: what is left behind a frame can be taken up again
at any of them (a frame that moved is linearised anew, a late measurement put in), what all frames share may wander,
and covariances of the newest and of the oldest frame cost a few products. It knows nothing of bodies.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from scipy.linalg import solve_triangular

from vip_factors.errors import SolveError
from vip_factors.geometry.rotations import Array
from vip_factors.solve.elimination import eliminate_part


@dataclass(frozen=True)
class _Eliminated:
    """A frame's conditionals, and what is known of the later ones from it and all before."""

    conditionals: tuple[gtsam.GaussianConditional, ...]
    rest: gtsam.GaussianFactorGraph


class FixedLagChain:
    """The eliminated frames of the lag. Of marginalised ones later frames hold all that they said."""

    def __init__(self) -> None:
        self._frames: dict[int, _Eliminated] = {}
        self._past: gtsam.GaussianFactorGraph | None = None  # what is known from the frames that were marginalised

    @property
    def numbers(self) -> range:
        """Numbers of the frames that are kept."""
        return range(min(self._frames), max(self._frames) + 1) if self._frames else range(0)

    def eliminate(self, number: int, keys: Sequence[int], factors: gtsam.GaussianFactorGraph) -> None:
        """Put in a frame, behind the one before it; what was kept of this and of later ones is replaced.

        Args:
            number: of the frame: one of those that are kept, or the next.
            keys: to eliminate, in this order: its own, and of shared variables that no later frame has.
            factors: all whose first frame this is.

        Raises:
            SolveError: if a variable is not determined, or for another number.
        """
        kept = self.numbers
        if kept and not kept[0] <= number <= kept[-1] + 1:
            raise SolveError(f"frame {number} does not follow one of the frames {kept[0]} to {kept[-1]}")
        before = self._frames[number - 1].rest if number - 1 in self._frames else self._past
        for later in range(number, kept.stop):
            del self._frames[later]
        graph = gtsam.GaussianFactorGraph()
        if before is not None:
            graph.push_back(before)
        graph.push_back(factors)
        net, rest = _eliminated(graph, keys)
        self._frames[number] = _Eliminated(tuple(net.at(index) for index in range(net.size())), rest)

    def marginalise_before(self, number: int) -> None:
        """Marginalise the frames with a smaller number: what is known from them stays."""
        for kept in [one for one in self._frames if one < number]:
            self._past = self._frames.pop(kept).rest

    def solution(self, shared: int | None) -> "LagSolution":
        """All variables of the lag; ``shared`` is the key of what the newest frame shares with those to come, if any.

        Raises:
            SolveError: if it is not determined.
        """
        conditionals = [one for number in self.numbers for one in self._frames[number].conditionals]
        if shared is not None:
            last, _ = _eliminated(self._frames[max(self._frames)].rest, [shared])
            conditionals.append(last.at(0))
        return LagSolution(conditionals)


class LagSolution:
    """The minimum over the lag, and how sure it is."""

    def __init__(self, conditionals: Sequence[gtsam.GaussianConditional]) -> None:
        net = gtsam.GaussianBayesNet()
        for conditional in conditionals:
            net.push_back(conditional)
        self._conditionals = conditionals
        self._values = net.optimize()

    def at(self, key: int) -> Array:
        """A variable."""
        return np.asarray(self._values.at(key))

    def covariance(self, key: int) -> Array:
        """Marginal covariance of a variable; the later it was eliminated, the less it costs.

        With ``R`` the triangular factor of all, it is ``YᵀY`` for ``RᵀY = E``, with ``E`` the variable's columns: one
        substitution forwards. No information matrix is inverted, so an accelerometer's double integration costs no
        digits.
        """
        places = [int(one.keys()[0]) for one in self._conditionals]
        start = places.index(key)
        width = len(self._conditionals[start].d())
        owed: dict[int, Array] = {key: -np.eye(width)}  # what earlier rows leave on the right-hand side
        total = np.zeros((width, width))
        for place, conditional in zip(places[start:], self._conditionals[start:], strict=True):
            if place not in owed:
                continue
            Y = solve_triangular(conditional.R(), -owed.pop(place), trans="T", check_finite=False)
            total += Y.T @ Y
            keys, S, column = conditional.keys(), conditional.S(), 0
            for parent in (int(keys[index]) for index in range(1, len(keys))):
                block = S[:, column : column + self._values.at(parent).shape[0]]
                column += block.shape[1]
                left = block.T @ Y
                owed[parent] = owed[parent] + left if parent in owed else left
        return total


def _eliminated(
    graph: gtsam.GaussianFactorGraph, keys: Sequence[int]
) -> tuple[gtsam.GaussianBayesNet, gtsam.GaussianFactorGraph]:
    ordering = gtsam.Ordering()
    for key in keys:
        ordering.push_back(key)
    return eliminate_part(graph, ordering)
