"""The normal equations of chains eliminated frame by frame, each a dense block that LAPACK takes in three calls.

What all frames share stands behind the two frames that a frame sees, and is eliminated last. So only one row of blocks
is made at a time, and what is kept of a frame is how it depends on those after it. Chains that have nothing in common
in a frame are eliminated one after the other: wearers before a camera that stands still cost what they cost alone.
Where a camera moves, its poses are eliminated behind the wearers, a segment at a time, where that is less work.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from scipy.linalg import solve_triangular
from scipy.linalg.blas import dtrsv
from scipy.linalg.lapack import dpotrf

from vip_factors.errors import SolveError
from vip_factors.geometry.rotations import Array
from vip_factors.solve.chain_system import ChainSystem
from vip_factors.solve.elimination import LinearSystem, eliminate
from vip_factors.solve.segments import SEGMENT, SegmentedStrand
from vip_factors.solve.strands import Border, Strand

MOST_KNOTS = 12  # of one group; of more GTSAM eliminates those early that no later frame sees
_UNDETERMINED = "standard deviations: the data do not determine everything that is looked for"


def is_dense(system: ChainSystem) -> bool:
    """Whether a system is nothing but chains that share few columns."""
    return not system.extra and all(
        group.knots is None or len(group.knots.keys) <= MOST_KNOTS for group in system.groups
    )


class ChainElimination:
    """The triangular factor of a linearisation with ``damping`` units on the diagonal.

    Args:
        system, damping: what is eliminated.
        apart: whether chains that meet another in every frame may each be eliminated by themselves.

    Raises:
        SolveError: if a variable is not determined.
    """

    def __init__(self, system: ChainSystem, damping: float, apart: bool = True) -> None:
        self._system, self._border, last = system, Border(system), _met_by_all(system) if apart else None
        H, vector = self._border.information(damping)
        self._strands: Sequence[Strand | SegmentedStrand]
        if last is not None:
            self._strands = [SegmentedStrand(system, self._border, last)]
        else:
            self._strands = [Strand(system, self._border, numbers) for numbers in _tied_chains(system)]
        for strand in self._strands:
            strand.eliminate(damping, H, vector)
        shared, failed = dpotrf(H) if len(vector) else (H, 0)
        if failed:
            raise SolveError("the linear system is not determined")
        self._static, self._vector = np.asarray(shared), vector

    def step(self) -> "ChainSteps":
        """The minimum of the quadratic."""
        half = dtrsv(self._static, self._vector, trans=1) if len(self._vector) else self._vector
        shared = dtrsv(self._static, half) if len(half) else half
        steps = dict[int, Array]()
        for strand in self._strands:
            steps |= strand.given(shared)
        return ChainSteps(self._system, steps, self._border.by_key(shared))

    def border_covariance(self) -> tuple[Array, dict[int, slice]]:
        """Joint covariance ``(s, s)`` of what all frames share, and where in it each group and knot is."""
        return _inverse_of_square(self._static), self._border.columns

    def marginals(self, progress: Callable[[float], None]) -> dict[int, Array]:
        """Covariance of every variable by key, where none are apart; ``progress`` is told what fraction is done."""
        covariance, places = self.border_covariance()
        found = _blocks(covariance, places)
        count = len(found) + self._system.frames * len(self._system.chains)
        for strand in self._strands:
            assert isinstance(strand, Strand)
            for of_frame in strand.marginals(covariance):
                found |= of_frame
                progress(len(found) / count)
        return found


def _met_by_all(system: ChainSystem) -> int | None:
    """The chain that two others or more meet, and these nothing else, in frames enough; else None."""
    last = len(system.chains) - 1
    meet = last > 1 and set(system.between) == {(number, last) for number in range(last)}
    return last if meet and all(one.tied for one in system.chains) and system.frames > SEGMENT else None


def _tied_chains(system: ChainSystem) -> list[list[int]]:
    """Numbers of chains that meet in a frame, together."""
    found = [{number} for number in range(len(system.chains))]
    for pair in system.between:
        met = [one for one in found if one & set(pair)]
        found = [one for one in found if one not in met] + [set[int]().union(*met)]
    return [sorted(one) for one in found]


@dataclass(frozen=True)
class ChainSteps:
    """A solution: steps ``(T, w)`` of each chain by its number, and vectors of what they share by GTSAM's names."""

    system: ChainSystem
    steps: dict[int, Array]
    shared: dict[int, Array]

    def at(self, key: int) -> Array:
        """Of one frame or group."""
        if key in self.shared:
            return self.shared[key]
        for number, chain in enumerate(self.system.chains):
            if 0 <= key - chain.keys[0] < len(chain.keys):
                return np.asarray(self.steps[number][key - chain.keys[0]])
        raise KeyError(key)


def chain_marginals(system: LinearSystem, progress: Callable[[float], None] = lambda done: None) -> dict[int, Array]:
    """Marginal covariance of every variable, by key, of the undamped linearisation at a solution.

    Args:
        system: the linearisation.
        progress: called with what fraction is done.

    Raises:
        SolveError: if a variable is not determined.
    """
    progress(0.0)
    try:
        if isinstance(system, ChainSystem) and is_dense(system):
            elimination = ChainElimination(system, 0.0, apart=False)
        else:
            return tree_marginals(system)
    except (SolveError, RuntimeError) as error:
        raise SolveError(_UNDETERMINED) from error
    return elimination.marginals(progress)


def tree_marginals(system: LinearSystem) -> dict[int, Array]:
    """Of GTSAM's Bayes tree: of a user's own terms, which may tie anything, and of many knots."""
    graph, ordering = gtsam.GaussianFactorGraph(), gtsam.Ordering()
    for part, keys in system.stretches(0.0):
        graph.push_back(part)
        for index in range(keys.size()):
            ordering.push_back(keys.at(index))
    tree = graph.eliminateMultifrontal(ordering)
    return {ordering.at(index): tree.marginalCovariance(ordering.at(index)) for index in range(ordering.size())}


def last_marginals(system: LinearSystem, keys: Sequence[int]) -> dict[int, Array]:
    """Marginal covariances of the variables that are eliminated last: of what all frames share, at no further cost.

    Raises:
        SolveError: if a variable is not determined.
    """
    return _blocks(*_last_covariance(system, keys))


def last_covariance(system: LinearSystem, keys: Sequence[int]) -> Array:
    """Joint covariance ``(n, n)`` of the variables that are eliminated last, side by side in the order of ``keys``.

    Raises:
        SolveError: if a variable is not determined.
    """
    covariance, places = _last_covariance(system, keys)
    columns = np.concatenate([np.zeros(0, int), *(np.arange(places[key].start, places[key].stop) for key in keys)])
    return np.array(covariance[np.ix_(columns, columns)], dtype=float)


def _last_covariance(system: LinearSystem, keys: Sequence[int]) -> tuple[Array, dict[int, slice]]:
    """Of all that are eliminated last, and where in it each is."""
    if isinstance(system, ChainSystem) and is_dense(system):
        return ChainElimination(system, 0.0).border_covariance()
    net, tail = eliminate(system.stretches(0.0)), gtsam.GaussianBayesNet()
    for index in range(net.size()):
        if net.at(index).keys()[0] in set(keys):
            tail.push_back(net.at(index))
    R, _ = tail.matrix()
    if not np.all(np.abs(np.diag(R)) > 0):
        raise SolveError(_UNDETERMINED)
    places, start = dict[int, slice](), 0
    for index in range(tail.size()):
        block = slice(start, start + len(tail.at(index).R()))
        places[int(tail.at(index).keys()[0])] = block
        start = block.stop
    if set(places) != set(keys):
        raise SolveError("covariance: the variables asked for are not the last ones")
    return _inverse_of_square(R), places


def _blocks(covariance: Array, places: Mapping[int, slice]) -> dict[int, Array]:
    return {key: np.array(covariance[own, own], dtype=float) for key, own in places.items()}


def _inverse_of_square(R: Array) -> Array:
    """Of ``Rᵀ R``; inverting that itself would lose twice the digits."""
    inverse = solve_triangular(R, np.eye(len(R)), check_finite=False) if len(R) else R
    return np.asarray(inverse @ inverse.T, dtype=float)
