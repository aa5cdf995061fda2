"""The normal equations of chains eliminated frame by frame, each a dense block that LAPACK takes in three calls.

What all frames share stands behind the two frames that a frame sees, and is eliminated last. So only one row of blocks
is made at a time, and what is kept of a frame is how it depends on those after it. Chains that have nothing in common
in a frame are eliminated one after the other: wearers before a camera that stands still cost what they cost alone.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from scipy.linalg import solve_triangular
from scipy.linalg.blas import dtrsv
from scipy.linalg.lapack import dpotrf

from vip_factors.compiled import kernels
from vip_factors.errors import SolveError
from vip_factors.geometry.rotations import Array
from vip_factors.solve.chain_system import REACH, Chain, ChainSystem
from vip_factors.solve.elimination import LinearSystem, eliminate
from vip_factors.solve.slices import eliminated

MOST_KNOTS = 12  # of one group; of more GTSAM eliminates those early that no later frame sees
Piece = tuple[Array, int, int, int]  # blocks (t, r, c) of some frames' rows, the first row, column and frame


def is_dense(system: ChainSystem) -> bool:
    """Whether a system is nothing but chains that share few columns."""
    return not system.extra and all(
        group.knots is None or len(group.knots.keys) <= MOST_KNOTS for group in system.groups
    )


class ChainElimination:
    """The triangular factor of a linearisation with ``damping`` units on the diagonal.

    Raises:
        SolveError: if a variable is not determined.
    """

    def __init__(self, system: ChainSystem, damping: float) -> None:
        self._system, self._border = system, _Border(system)
        H, vector = self._border.static(damping)
        self._strands = [_Strand(system, self._border, numbers) for numbers in _tied_chains(system)]
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


def _tied_chains(system: ChainSystem) -> list[list[int]]:
    """Numbers of chains that meet in a frame, together."""
    found = [{number} for number in range(len(system.chains))]
    for pair in system.between:
        met = [one for one in found if one & set(pair)]
        found = [one for one in found if one not in met] + [set[int]().union(*met)]
    return [sorted(one) for one in found]


class _Strand:
    """Chains that meet in a frame, side by side: of each frame ``R x + S y = d``, ``y`` the two frames after it, where
    frames are tied, and those columns of the border that it sees.

    Args:
        system, border: of all chains.
        numbers: of the chains.
    """

    def __init__(self, system: ChainSystem, border: "_Border", numbers: Sequence[int]) -> None:
        self._chains, self._numbers = [system.chains[number] for number in numbers], numbers
        self._places = _places(self._chains)
        self._width = self._places[-1].stop
        self._ahead = REACH * self._width if any(one.tied for one in self._chains) else 0
        seen = sorted({group for chain, group in system.coupling if chain in numbers})
        self._columns = np.concatenate([np.zeros(0, int), *(border.of_group[group] for group in seen)])
        self._pieces = list(self._in_frames(system))
        start = self._width + self._ahead
        for group in seen:
            for place, number in zip(self._places, numbers, strict=True):
                if (number, group) in system.coupling:
                    blocks = border.coupling(number, group, system.coupling[number, group])
                    self._pieces += [(block, place.start, start + column, first) for block, column, first in blocks]
            start += len(border.of_group[group])
        rows, self._d = (system.frames, self._width, start), np.zeros((system.frames, self._width))
        self._rows = np.empty(rows)

    def _in_frames(self, system: ChainSystem) -> Iterator[Piece]:
        for place, chain in zip(self._places, self._chains, strict=True):
            yield chain.own, place.start, place.start, 0
            following = chain.following
            if following is not None:
                for ahead in range(REACH):
                    yield following[:, ahead], place.start, (ahead + 1) * self._width + place.start, 0
        for (p, q), blocks in system.between.items():
            if p in self._numbers:
                first, second = (self._places[self._numbers.index(number)].start for number in (p, q))
                yield blocks, first, second, 0

    def eliminate(self, damping: float, H: Array, vector: Array) -> None:
        """Eliminate all frames; what they say of the border is added to ``H`` and ``vector``.

        Raises:
            SolveError: if a variable is not determined.
        """
        n, start = self._rows.shape[2], self._width + self._ahead
        M, v = np.zeros((n, n)), np.zeros(n)
        gradient = np.concatenate([one.gradient for one in self._chains], axis=1)
        damped = damping * np.concatenate([one.damping for one in self._chains])
        if kernels is None:
            self._eliminate_purely(gradient, damped, M, v)
        elif not kernels.eliminate_chain(self._pieces, gradient, damped, self._ahead, M, v, self._rows, self._d):
            raise SolveError("the linear system is not determined")
        said = np.triu(M[start:, start:])  # the border may have the columns in another order
        H[np.ix_(self._columns, self._columns)] += said + np.triu(said, 1).T
        vector[self._columns] += v[start:]

    def _eliminate_purely(self, gradient: Array, damped: Array, M: Array, v: Array) -> None:
        w, ahead = self._width, self._ahead
        seen = w + ahead
        for t, g in enumerate(gradient):
            M[:ahead, :ahead], M[:ahead, seen:], v[:ahead] = M[w:seen, w:seen], M[w:seen, seen:], v[w:seen]
            M[:seen, ahead:seen], M[ahead:seen], v[ahead:seen] = 0.0, 0.0, 0.0
            for blocks, row, column, first in self._pieces:
                if first <= t < first + len(blocks):
                    M[row : row + blocks.shape[1], column : column + blocks.shape[2]] += blocks[t - first]
            M[range(w), range(w)] += damped
            rest = np.array(M[w:, w:])
            R, S_transposed = eliminated(M[:w, :w], np.array(M[:w, w:]), rest)
            self._rows[t, :, :w], self._rows[t, :, w:], self._d[t] = R, S_transposed.T, dtrsv(R, v[:w] - g, trans=1)
            M[w:, w:], v[w:] = rest, v[w:] - S_transposed @ self._d[t]

    def given(self, border: Array) -> dict[int, Array]:
        """Steps ``(T, w)`` of each chain, by its number, of the border's ``(s,)``."""
        steps, shared = self._d.copy(), border[self._columns]
        if kernels is not None:
            kernels.substitute_chain(self._rows, shared, self._ahead, steps)
        else:
            later, w = np.zeros(self._ahead), self._width
            for t in range(len(steps) - 1, -1, -1):
                right = steps[t] - self._rows[t, :, w:] @ np.concatenate([later, shared])
                steps[t] = dtrsv(self._rows[t, :, :w], right)
                later = np.concatenate([steps[t], later])[: self._ahead]
        return {number: steps[:, place] for number, place in zip(self._numbers, self._places, strict=True)}


class _Border:
    """What frames share, side by side: the static vector, then the later knots of groups that walk."""

    def __init__(self, system: ChainSystem) -> None:
        self.system, self.width = system, len(system.static)
        self.of_group = list[np.ndarray]()  # all columns of each, its later knots behind its own
        self.columns = {group.key: group.columns for group in system.groups}
        for group in system.groups:
            own = [np.arange(group.columns.start, group.columns.stop)]
            if group.knots is not None:
                for key in group.knots.keys:
                    later = self.columns[key] = slice(self.width, self.width + group.knots.columns)
                    own.append(np.arange(later.start, later.stop))
                    self.width = later.stop
            self.of_group.append(np.concatenate(own))

    def coupling(self, chain: int, group: int, blocks: Array) -> Iterator[tuple[Array, int, int]]:
        """What ties frames of a chain to a group ``(t, w, c)``, with the first of its columns and the first frame."""
        knots = self.system.groups[group].knots
        if knots is None or chain != knots.chain:
            yield blocks, 0, 0
            return
        S, weights = knots.columns, knots.weights[:, :, None, None]
        after, before = np.concatenate([weights[1:], weights[-1:]]), np.concatenate([weights[:1], weights[:-1]])
        yield blocks[:, :, S:], S, 0
        for k in range(len(knots.keys) + 1):
            some = np.flatnonzero(weights[:, k] + after[:, k] + before[:, k])
            if len(some):
                near = slice(some[0], some[-1] + 1)
                seen = weights[near, k] * blocks[near, :, :S]
                seen += after[near, k] * knots.adjacent[near, 0] + before[near, k] * knots.adjacent[near, 1]
                yield seen, 0 if k == 0 else blocks.shape[2] + (k - 1) * S, int(near.start)

    def static(self, damping: float) -> tuple[Array, Array]:
        """What all frames together say of the border, ``(s, s)`` and ``(s,)``: the upper triangle counts."""
        system, n = self.system, len(self.system.static)
        H, vector = np.zeros((self.width, self.width)), np.zeros(self.width)
        H[:n, :n] = system.static + np.diag(damping * system.static_damping)
        g = system.static_gradient.copy()
        for group in system.groups:
            if group.knots is not None:
                group.knots.add_static(H[group.columns, group.columns], g[group.columns])
                for k, key in enumerate(group.knots.keys, start=1):
                    own, gradient, static, following = group.knots.of_later(k, damping)
                    at = self.columns[key]
                    H[at, at], vector[at] = own, -gradient
                    H[group.columns, at] = static.T
                    if following is not None:
                        H[at, self.columns[group.knots.keys[k]]] = following
        vector[:n] = -g
        return H, vector

    def by_key(self, values: Array) -> dict[int, Array]:
        """Vectors of groups and knots."""
        return {key: values[columns] for key, columns in self.columns.items()}


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


def _places(chains: Sequence[Chain]) -> list[slice]:
    """Columns of each chain in a frame."""
    ends = np.cumsum([0, *(len(one.damping) for one in chains)]).tolist()
    return [slice(*ends[number : number + 2]) for number in range(len(chains))]


def last_marginals(system: LinearSystem, keys: Sequence[int]) -> dict[int, Array]:
    """Marginal covariances of the variables that are eliminated last: of what all frames share, at no further cost.

    Raises:
        SolveError: if a variable is not determined.
    """
    covariance, places = _last_covariance(system, keys)
    return {key: np.array(covariance[own, own], dtype=float) for key, own in places.items()}


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
        raise SolveError("standard deviations: the data do not determine everything that is looked for")
    places, start = dict[int, slice](), 0
    for index in range(tail.size()):
        block = slice(start, start + len(tail.at(index).R()))
        places[int(tail.at(index).keys()[0])] = block
        start = block.stop
    if set(places) != set(keys):
        raise SolveError("covariance: the variables asked for are not the last ones")
    return _inverse_of_square(R), places


def _inverse_of_square(R: Array) -> Array:
    """Of ``Rᵀ R``; inverting that itself would lose twice the digits."""
    inverse = solve_triangular(R, np.eye(len(R)), check_finite=False) if len(R) else R
    return np.asarray(inverse @ inverse.T, dtype=float)
