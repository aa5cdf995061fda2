"""The normal equations of chains eliminated frame by frame, each a dense block that LAPACK takes in three calls.

What all frames share stands behind the two frames that a frame sees, and is eliminated last. So only one row of blocks
is made at a time, and what is kept of a frame is how it depends on those after it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from scipy.linalg import solve_triangular
from scipy.linalg.blas import dtrsv
from scipy.linalg.lapack import dpotrf

from vip_factors.errors import SolveError
from vip_factors.geometry.rotations import Array
from vip_factors.solve.chain_system import Chain, ChainSystem, StaticGroup
from vip_factors.solve.elimination import LinearSystem, eliminate
from vip_factors.solve.slices import REACH, eliminated

MOST_KNOTS = 12  # of one group; of more GTSAM eliminates those early that no later frame sees


def is_dense(system: ChainSystem) -> bool:
    """Whether a system is nothing but chains that share few columns."""
    return not system.extra and all(
        group.knots is None or len(group.knots.keys) <= MOST_KNOTS for group in system.groups
    )


@dataclass(frozen=True)
class _Row:
    """``R x + S y = d`` of a frame ``x`` and of ``y``, the two frames after it and what all share; ``S`` transposed."""

    R: Array
    S_transposed: Array
    d: Array


class ChainElimination:
    """The triangular factor of a linearisation with ``damping`` units on the diagonal.

    Raises:
        SolveError: if a variable is not determined.
    """

    def __init__(self, system: ChainSystem, damping: float) -> None:
        self._system = system
        self._border = _Border(system)
        self._rows, H, vector = list[_Row](), *self._border.static(damping)
        w, s = sum(len(one.damping) for one in system.chains), len(vector)
        tied = any(one.following is not None for one in system.chains)
        ahead = REACH * w if tied else 0  # columns of the frames after a frame
        rest, known = np.zeros((ahead + s, ahead + s)), np.zeros(ahead + s)
        for t in range(system.frames):
            own, others, vector_own = self._frame(t, damping, w, ahead)
            after = np.zeros((ahead + s, ahead + s))  # nothing is known yet of the last frame that it sees
            after[ahead:, ahead:] = rest[ahead:, ahead:]
            known_after = np.concatenate([np.zeros(ahead), known[ahead:]])
            if tied:
                own += rest[:w, :w]
                others[:, :w] += rest[:w, w:ahead]
                others[:, ahead:] += rest[:w, ahead:]
                vector_own += known[:w]
                after[:w, :w], after[:w, ahead:] = rest[w:ahead, w:ahead], rest[w:ahead, ahead:]
                known_after[:w] = known[w:ahead]
            R, S_transposed = eliminated(own, others, after)
            d = dtrsv(R, vector_own, trans=1)
            self._rows.append(_Row(R, S_transposed, d))
            rest, known = after, known_after - S_transposed @ d
        shared, failed = dpotrf(H + rest[ahead:, ahead:]) if s else (np.zeros((0, 0)), 0)
        if failed:
            raise SolveError("the linear system is not determined")
        self._static, self._vector, self._ahead = np.asarray(shared), vector + known[ahead:], ahead

    def _frame(self, t: int, damping: float, w: int, ahead: int) -> tuple[Array, Array, Array]:
        """A frame's blocks ``(w, w)`` with itself and ``(w, n)`` with what comes after it, and its vector."""
        system = self._system
        own, others, vector = np.zeros((w, w)), np.zeros((w, ahead + self._border.width)), np.zeros(w)
        places = _places(system.chains)
        for chain, at in zip(system.chains, places, strict=True):
            own[at, at] = chain.own[t] + np.diag(damping * chain.damping)
            vector[at] = -chain.gradient[t]
            if chain.following is not None:
                others[at, at] = chain.following[t, 0]
                others[at, w + at.start : w + at.stop] = chain.following[t, 1]
        for (p, q), blocks in system.between.items():
            own[places[p], places[q]] = blocks[t]
        for (p, g), blocks in system.coupling.items():
            self._border.couple(others[places[p], ahead:], p, g, t, blocks[t])
        return own, others, vector

    def step(self) -> "ChainSteps":
        """The minimum of the quadratic."""
        half = dtrsv(self._static, self._vector, trans=1) if len(self._vector) else self._vector
        shared = dtrsv(self._static, half) if len(half) else half
        w = sum(len(one.damping) for one in self._system.chains)
        steps, later = np.zeros((len(self._rows), w)), np.zeros(self._ahead)
        for t in range(len(self._rows) - 1, -1, -1):
            row = self._rows[t]
            steps[t] = dtrsv(row.R, row.d - np.concatenate([later, shared]) @ row.S_transposed)
            later = np.concatenate([steps[t], later])[: self._ahead]
        return ChainSteps(self._system, steps, self._border.by_key(shared))

    def border_covariance(self) -> tuple[Array, dict[int, slice]]:
        """Joint covariance ``(s, s)`` of what all frames share, and where in it each group and knot is."""
        return _inverse_of_square(self._static), self._border.columns


class _Border:
    """What frames share, side by side: the static vector, then the later knots of groups that walk."""

    def __init__(self, system: ChainSystem) -> None:
        self.system, self.width = system, len(system.static)
        self._knots = dict[int, Array]()  # by group: weights with which a frame sees knots here, ahead and before
        self._first = dict[int, int]()
        self.columns = {group.key: group.columns for group in system.groups}
        for number, group in enumerate(system.groups):
            if group.knots is None:
                continue
            weights, self._first[number] = group.knots.weights, self.width
            after, before = np.vstack([weights[1:], weights[-1:]]), np.vstack([weights[:1], weights[:-1]])
            self._knots[number] = np.stack([weights, after, before], axis=1)  # (T, 3, K)
            for key in group.knots.keys:
                self.columns[key] = slice(self.width, self.width + group.knots.columns)
                self.width += group.knots.columns

    def couple(self, into: Array, chain: int, group: int, t: int, block: Array) -> None:
        """Add what ties a frame of a chain ``(w, …)`` to a group."""
        one: StaticGroup = self.system.groups[group]
        knots, start = one.knots, one.columns.start
        if knots is None or chain != knots.chain:
            into[:, one.columns] += block
            return
        S = knots.columns
        into[:, start + S : one.columns.stop] += block[:, S:]
        blocks = np.stack([block[:, :S], *knots.adjacent[t]])  # (3, w, S)
        for k in np.flatnonzero(self._knots[group][t].any(axis=0)).tolist():
            at = start if k == 0 else self._first[group] + (k - 1) * S
            into[:, at : at + S] += np.tensordot(self._knots[group][t, :, k], blocks, axes=1)

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
    """A solution: steps ``(T, w)`` of all chains side by side, and vectors of what they share by GTSAM's names."""

    system: ChainSystem
    steps: Array
    shared: dict[int, Array]

    def at(self, key: int) -> Array:
        """Of one frame or group."""
        if key in self.shared:
            return self.shared[key]
        for chain, place in zip(self.system.chains, _places(self.system.chains), strict=True):
            if 0 <= key - chain.keys[0] < len(chain.keys):
                return np.asarray(self.steps[key - chain.keys[0], place])
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
