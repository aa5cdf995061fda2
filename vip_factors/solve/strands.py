"""Chains eliminated frame by frame: of each frame ``R x + S y = d`` is kept, ``y`` being what is eliminated later.

Chains that meet in every frame go side by side, as one. Last, behind all chains, goes what all frames share.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from scipy.linalg.blas import dtrsm, dtrsv

from vip_factors.compiled import kernels
from vip_factors.errors import SolveError
from vip_factors.geometry.rotations import Array
from vip_factors.solve.chain_system import Chain, ChainSystem
from vip_factors.solve.slices import eliminated

Piece = tuple[Array, int, int, int]  # blocks (t, r, c) of some frames' rows, the first row, column and frame


class Border:
    """What is eliminated last, side by side: what all frames share, then the later knots of groups that walk.

    Attributes:
        of_group: all columns of each group, its later knots behind its own.
        columns: of each group and knot.
    """

    def __init__(self, system: ChainSystem) -> None:
        self.system, self.width = system, len(system.static)
        self.of_group = list[np.ndarray]()
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

    def information(self, damping: float) -> tuple[Array, Array]:
        """What is known of it but for what chains say: ``(s, s)``, its upper triangle, and ``(s,)``."""
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


class Run:
    """Frames one after the other: the columns of each, those ``ahead`` in the frames after it, and others.

    ``rows`` ``(T, w, n)`` is the memory that is taken for it.

    Attributes:
        information, vector: what all say of what is behind the frames' own columns; of the first the upper triangle.

    Raises:
        SolveError: if a variable is not determined.
    """

    def __init__(self, pieces: list[Piece], gradient: Array, damped: Array, ahead: int, rows: Array) -> None:
        self._rows, self._d, self._ahead = rows, np.zeros((len(gradient), len(damped))), ahead
        rest = rows.shape[2] - rows.shape[1]
        self.information, self.vector = np.zeros((rest, rest)), np.zeros(rest)
        if kernels is None:
            self._eliminate_purely(pieces, gradient, damped)
        elif not kernels.eliminate_chain(
            pieces, gradient, damped, ahead, self.information, self.vector, self._rows, self._d
        ):
            raise SolveError("the linear system is not determined")

    def _eliminate_purely(self, pieces: list[Piece], gradient: Array, damped: Array) -> None:
        w, ahead, n = len(damped), self._ahead, self._rows.shape[2]
        seen, M, v = w + ahead, np.zeros((n, n)), np.zeros(n)
        for t, g in enumerate(gradient):
            M[:ahead, :ahead], M[:ahead, seen:], v[:ahead] = M[w:seen, w:seen], M[w:seen, seen:], v[w:seen]
            M[:seen, ahead:seen], M[ahead:seen], v[ahead:seen] = 0.0, 0.0, 0.0
            for blocks, row, column, first in pieces:
                if first <= t < first + len(blocks):
                    M[row : row + blocks.shape[1], column : column + blocks.shape[2]] += blocks[t - first]
            M[range(w), range(w)] += damped
            rest = np.array(M[w:, w:])
            R, S_transposed = eliminated(M[:w, :w], np.array(M[:w, w:]), rest)
            self._rows[t, :, :w], self._rows[t, :, w:], self._d[t] = R, S_transposed.T, dtrsv(R, v[:w] - g, trans=1)
            M[w:, w:], v[w:] = rest, v[w:] - S_transposed @ self._d[t]
        self.information[:], self.vector[:] = M[w:, w:], v[w:]

    def given(self, later: Array) -> Array:
        """Steps ``(T, w)``, of those of the frames behind the last one and of the others."""
        steps = self._d.copy()
        if kernels is not None:
            kernels.substitute_chain(self._rows, later, self._ahead, steps)
            return steps
        (ahead, others), w = np.split(later, [self._ahead]), steps.shape[1]
        for t in range(len(steps) - 1, -1, -1):
            steps[t] = dtrsv(self._rows[t, :, :w], steps[t] - self._rows[t, :, w:] @ np.concatenate([ahead, others]))
            ahead = np.concatenate([steps[t], ahead])[: self._ahead]
        return steps

    def marginals(self, others: Array) -> Iterator[Array]:
        """Covariances ``(w, w)`` of the frames, the last one first, of the others' joint one. No frame is behind them.

        With ``K = −R⁻¹S``, ``Σ_xy = K Σ_yy`` and ``Σ_xx = R⁻¹R⁻ᵀ + Σ_xy Kᵀ``: all that a later frame asks for stands in
        the rows of this one (Takahashi, Fagan and Chen 1973).
        """
        n, w = self._rows.shape[2], self._d.shape[1]
        seen, joint, right = w + self._ahead, np.zeros((n, n)), np.zeros((w, n))
        joint[seen:, seen:] = others
        for rows in self._rows[::-1]:
            right[:, :w], right[:, w:] = np.eye(w), -rows[:, w:]
            solved = dtrsm(1.0, rows[:, :w], right)
            inverse, K = solved[:, :w], solved[:, w:]
            joint[:w, w:] = K @ joint[w:, w:]
            joint[w:, :w] = joint[:w, w:].T
            own = inverse @ inverse.T + joint[:w, w:] @ K.T
            joint[:w, :w] = (own + own.T) / 2  # what is not symmetric would grow from frame to frame
            yield joint[:w, :w].copy()
            ahead = slice(w, seen)  # of the frame before
            joint[ahead, ahead], joint[ahead, seen:] = joint[: self._ahead, : self._ahead], joint[: self._ahead, seen:]
            joint[seen:, ahead] = joint[ahead, seen:].T


class Strand:
    """Chains that meet in a frame, side by side: first the columns that the frame two before sees, then all others.

    Args:
        system, border: of all chains.
        numbers: of the chains.
    """

    def __init__(self, system: ChainSystem, border: Border, numbers: Sequence[int]) -> None:
        self._chains, self._numbers = [system.chains[number] for number in numbers], numbers
        reaching = [far_columns(chain) for chain in self._chains]
        far = np.concatenate(reaching)
        self._order = np.argsort(~far, kind="stable")
        ends = np.cumsum([len(one) for one in reaching])
        self._places = np.split(np.argsort(self._order), ends[:-1])
        self._ahead = len(far) + int(far.sum()) if any(one.tied for one in self._chains) else 0
        seen = sorted({group for chain, group in system.coupling if chain in numbers})
        self._columns = np.concatenate([np.zeros(0, int), *(border.of_group[group] for group in seen)])
        self._pieces = list(self._in_frames(system))
        start = len(far) + self._ahead
        for group in seen:
            for place, number in zip(self._places, numbers, strict=True):
                if (number, group) in system.coupling:
                    for block, column, first in border.coupling(number, group, system.coupling[number, group]):
                        self._pieces += placed(block, place, start + column + np.arange(block.shape[2]), first)
            start += len(border.of_group[group])
        self._rows = system.memory_of(numbers[0], 0, (system.frames, len(far), start))

    def _in_frames(self, system: ChainSystem) -> Iterator[Piece]:
        width = len(self._order)
        for place, chain in zip(self._places, self._chains, strict=True):
            yield from tied(chain.own, chain.following, place, width, self._ahead - width)
        for (p, q), blocks in system.between.items():
            if p in self._numbers:
                rows, columns = (self._places[self._numbers.index(number)] for number in (p, q))
                yield from placed(blocks, rows, columns)

    def eliminate(self, damping: float, H: Array, vector: Array) -> None:
        """Eliminate all frames; what they say of the border is added to ``H`` and ``vector``.

        Raises:
            SolveError: if a variable is not determined.
        """
        gradient = np.concatenate([one.gradient for one in self._chains], axis=1)[:, self._order]
        damped = damping * np.concatenate([one.damping for one in self._chains])[self._order]
        self._run = Run(self._pieces, gradient, damped, self._ahead, self._rows)
        add(H, self._columns, self._run.information[self._ahead :, self._ahead :])
        vector[self._columns] += self._run.vector[self._ahead :]

    def given(self, border: Array) -> dict[int, Array]:
        """Steps ``(T, w)`` of each chain, by its number, of the border's ``(s,)``."""
        steps = self._run.given(np.concatenate([np.zeros(self._ahead), border[self._columns]]))
        return {number: steps[:, place] for number, place in zip(self._numbers, self._places, strict=True)}

    def marginals(self, border: Array) -> Iterator[dict[int, Array]]:
        """Covariances by key, a frame at a time, of the border's joint one ``(s, s)``."""
        found = self._run.marginals(border[np.ix_(self._columns, self._columns)])
        places = [np.ix_(place, place) for place in self._places]
        for t, one in zip(reversed(range(len(self._chains[0].keys))), found, strict=True):
            yield {chain.keys[t]: one[place] for chain, place in zip(self._chains, places, strict=True)}


def add(H: Array, columns: np.ndarray, said: Array) -> None:
    """Add what is said of some columns, of which the upper triangle counts; ``H`` may have them in another order."""
    for block, row, column, _ in placed(said[None], columns, columns):
        H[row : row + block.shape[1], column : column + block.shape[2]] += block[0]


def far_columns(chain: Chain) -> np.ndarray:
    """Which columns ``(w,)`` have anything to do with the frame two on or two before."""
    if chain.following is None:
        return np.zeros(len(chain.damping), bool)
    blocks = chain.following[:, 1]
    some = blocks[:: len(blocks) // 8 + 1]  # which show most of them, and quickly
    found: np.ndarray = np.any(some, axis=(0, 1)) | np.any(some, axis=(0, 2))
    found[~found] = np.any(blocks[:, :, ~found], axis=(0, 1)) | np.any(blocks[:, ~found], axis=(0, 2))
    return found


def tied(own: Array, following: Array | None, place: np.ndarray, width: int, far: int) -> Iterator[Piece]:
    """A chain's blocks ``(t, w, w)`` in frames of ``width`` columns, at these places, and those with the next two
    frames, of the second of which ``far`` columns are seen."""
    yield from placed(own, place, place)
    if following is not None:
        yield from placed(following[:, 0], place, width + place)
        for some in runs_of(np.flatnonzero(place < far)):
            yield from placed(following[:, 1, :, some], place, 2 * width + place[some])


def runs_of(places: np.ndarray) -> Iterator[slice]:
    """Places that follow one another, as slices of what has them."""
    for run in _consecutive(places):
        yield slice(int(places[run.start]), int(places[run.stop - 1]) + 1)


def _consecutive(places: np.ndarray) -> list[slice]:
    values = places.tolist()
    ends = [k for k in range(1, len(values)) if values[k] != values[k - 1] + 1]
    return [slice(*one) for one in pairwise([0, *ends, len(values)])] if values else []


def placed(blocks: Array, rows: np.ndarray, columns: np.ndarray, first: int = 0) -> Iterator[Piece]:
    """Blocks ``(t, r, c)`` from a frame on whose rows and columns are at these places, in pieces above the diagonal."""
    column_runs = _consecutive(columns)
    for r in _consecutive(rows):
        for c in column_runs:
            row, column, block = int(rows[r.start]), int(columns[c.start]), blocks[:, r, c]
            if rows is columns and r.start > c.start:  # of these blocks the other triangle counts
                continue
            yield (block, row, column, first) if row <= column else (block.swapaxes(1, 2), column, row, first)
