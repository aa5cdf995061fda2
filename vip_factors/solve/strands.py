"""Chains eliminated frame by frame: of each frame ``R x + S y = d`` is kept, ``y`` being what is eliminated later.

Chains that meet in every frame go side by side, as one: cubic in their number. Where a few narrow columns are all that
they have in common, as people before a moving camera have its pose, these can go last instead, of all frames, and each
chain is eliminated by itself. It would then drag along the poses of all frames behind it. So it is cut into segments,
nested dissection (George 1973, doi:10.1137/0710032) of two levels: what is inside a segment sees that segment's poses,
and only the frames between segments see more.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Protocol

import numpy as np
from scipy.linalg.blas import dtrsm, dtrsv
from scipy.linalg.lapack import dpotrf

from vip_factors.compiled import kernels
from vip_factors.errors import SolveError
from vip_factors.geometry.rotations import Array
from vip_factors.solve.chain_system import REACH, Chain, ChainSystem
from vip_factors.solve.slices import eliminated

SEGMENT = 24  # frames: shorter ones leave more frames between them, longer ones see more poses; 16 to 40 are alike
Piece = tuple[Array, int, int, int]  # blocks (t, r, c) of some frames' rows, the first row, column and frame


class Border(Protocol):
    """The columns that are eliminated last: those of whole chains ``(T, c)``, frame by frame; then what frames share.

    Attributes:
        of_group: columns of each group, its later knots behind its own.
        late: the columns ``(T, c)`` of chains that are eliminated last, side by side.
    """

    of_group: list[np.ndarray]
    late: np.ndarray

    def coupling(self, chain: int, group: int, blocks: Array) -> Iterator[tuple[Array, int, int]]:
        """What ties frames of a chain to a group ``(t, w, c)``, with the first of its columns and the first frame."""
        ...


class _Run:
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
        reaching = [_reaching(chain) for chain in self._chains]
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
                        self._pieces += _placed(block, place, start + column + np.arange(block.shape[2]), first)
            start += len(border.of_group[group])
        self._rows = system.kept(numbers[0], 0, (system.frames, len(far), start))

    def _in_frames(self, system: ChainSystem) -> Iterator[Piece]:
        width = len(self._order)
        for place, chain in zip(self._places, self._chains, strict=True):
            yield from _placed(chain.own, place, place)
            following = chain.following
            if following is not None:
                yield from _placed(following[:, 0], place, width + place)
                far = np.flatnonzero(width + place < self._ahead)
                for run in _runs(far):
                    some = slice(far[run.start], far[run.stop - 1] + 1)
                    yield from _placed(following[:, 1, :, some], place, 2 * width + place[some])
        for (p, q), blocks in system.between.items():
            if p in self._numbers:
                rows, columns = (self._places[self._numbers.index(number)] for number in (p, q))
                yield from _placed(blocks, rows, columns)

    def eliminate(self, damping: float, H: Array, vector: Array) -> None:
        """Eliminate all frames; what they say of the border is added to ``H`` and ``vector``.

        Raises:
            SolveError: if a variable is not determined.
        """
        gradient = np.concatenate([one.gradient for one in self._chains], axis=1)[:, self._order]
        damped = damping * np.concatenate([one.damping for one in self._chains])[self._order]
        self._run = _Run(self._pieces, gradient, damped, self._ahead, self._rows)
        _add(H, self._columns, self._run.information[self._ahead :, self._ahead :])
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


class SegmentedStrand:
    """One chain whose frames are tied, and which meets others that are eliminated last.

    Args:
        system, border: of all chains.
        number: of the chain.
    """

    def __init__(self, system: ChainSystem, border: Border, number: int) -> None:
        self._kept, self._chain, self._number, T = system.kept, system.chains[number], number, system.frames
        met = [blocks for (p, _), blocks in sorted(system.between.items()) if p == number]
        self._met, self._late = np.concatenate(met, axis=2), border.late
        columns, self._coupling = [np.zeros(0, int)], list[tuple[Array, int, int]]()
        for p, group in sorted(system.coupling):
            if p == number:
                start = sum(map(len, columns))
                blocks = border.coupling(number, group, system.coupling[number, group])
                self._coupling += [(block, start + column, first) for block, column, first in blocks]
                columns.append(border.of_group[group])
        self._shared = np.concatenate(columns)
        count = max(1, round((T + REACH) / (SEGMENT + REACH)))
        ends = np.linspace(0, T + REACH, count + 1).astype(int).tolist()
        self._segments = [(begin, end - REACH) for begin, end in pairwise(ends)]

    def eliminate(self, damping: float, H: Array, vector: Array) -> None:
        """As :meth:`Strand.eliminate`, first within segments and then of what is between them."""
        w, s, c, S = len(self._chain.damping), len(self._shared), self._met.shape[2], self._late.size
        n, nodes, damped = REACH * w, len(self._segments) - 1, damping * self._chain.damping
        # of the frames between segments: with themselves, with the next such, and with the border
        self._own, self._next = np.zeros((nodes, n, n)), np.zeros((nodes, n, n))
        self._border, self._d = np.zeros((nodes, n, s + S)), np.zeros((nodes, n))
        for node, (_, first) in enumerate(self._segments[:-1]):
            self._put_between(node, first, damped)
        self._runs = list[_Run]()
        for k, (begin, end) in enumerate(self._segments):
            gradient = self._chain.gradient[begin:end]
            rows = self._kept(self._number, begin, (end - begin, w, w + 2 * n + s + c * (end - begin)))
            run = _Run(list(self._pieces(begin, end)), gradient, damped, n, rows)
            self._runs.append(run)
            M, v = run.information, run.vector
            seen = np.concatenate([np.arange(s), s + np.arange(c * begin, c * end)])
            if k < nodes:
                self._own[k] += M[:n, :n]
                self._border[k][:, seen] += M[:n, 2 * n :]
                self._d[k] += v[:n]
            if k:
                self._own[k - 1] += M[n : 2 * n, n : 2 * n]
                self._border[k - 1][:, seen] += M[n : 2 * n, 2 * n :]
                self._d[k - 1] += v[n : 2 * n]
            if 0 < k < nodes:
                self._next[k - 1] = M[:n, n : 2 * n].T
            columns = np.concatenate([self._shared, self._late[begin:end].ravel()])
            _add(H, columns, M[2 * n :, 2 * n :])
            vector[columns] += v[2 * n :]
            run.information = M[:0]  # it is not asked for again
        self._eliminate_between(H, vector)

    def _pieces(self, begin: int, end: int) -> Iterator[Piece]:
        """Of a segment: its frames, two behind it, two before it, what all share, and what is met in it."""
        chain, w, c = self._chain, len(self._chain.damping), self._met.shape[2]
        following = chain.following
        assert following is not None
        yield chain.own[begin:end], 0, 0, 0
        for ahead in range(REACH):
            yield following[begin:end, ahead], 0, (ahead + 1) * w, 0
        before = (REACH + 1) * w
        for j in range(REACH if begin else 0):
            for ahead in range(REACH):
                if 0 <= (seen := j + ahead + 1 - REACH) < end - begin:
                    yield following[begin - REACH + j, ahead].T[None], 0, before + j * w, seen
        shared = before + REACH * w
        for blocks, column, first in self._coupling:
            some = blocks[max(begin - first, 0) : max(end - first, 0)]
            if len(some):
                yield some, 0, shared + column, max(first - begin, 0)
        for t in range(begin, end):
            yield self._met[t : t + 1], 0, shared + len(self._shared) + c * (t - begin), t - begin

    def _put_between(self, node: int, first: int, damped: Array) -> None:
        """What the two frames behind a segment say by themselves."""
        w, c, following = len(damped), self._met.shape[2], self._chain.following
        assert following is not None
        for j, t in enumerate(range(first, first + REACH)):
            rows = slice(j * w, (j + 1) * w)
            self._own[node, rows, rows] = self._chain.own[t] + np.diag(damped)
            for ahead in range(REACH - 1 - j):
                self._own[node, rows, (j + ahead + 1) * w : (j + ahead + 2) * w] = following[t, ahead]
            for blocks, column, start in self._coupling:
                if start <= t < start + len(blocks):
                    self._border[node, rows, column : column + blocks.shape[2]] += blocks[t - start]
            at = len(self._shared) + c * t
            self._border[node, rows, at : at + c] = self._met[t]
            self._d[node, rows] = -self._chain.gradient[t]

    def _eliminate_between(self, H: Array, vector: Array) -> None:
        s, c, nodes = len(self._shared), self._met.shape[2], len(self._own)
        seen = [c * end for _, end in self._segments[1:]]  # of what is met, from each on
        for k in range(nodes):
            R, failed = dpotrf(self._own[k])
            if failed:
                raise SolveError("the linear system is not determined")
            own, ahead, border = R, self._next[k], self._border[k, :, : s + seen[k]]
            ahead[:] = dtrsm(1.0, own, ahead.T, side=1).T
            border[:] = dtrsm(1.0, own, border.T, side=1).T
            self._own[k], self._d[k] = own, dtrsv(own, self._d[k], trans=1)
            if k + 1 < nodes:
                self._own[k + 1] -= ahead.T @ ahead
                self._border[k + 1, :, : s + seen[k]] -= ahead.T @ border
                self._d[k + 1] -= ahead.T @ self._d[k]
        late = self._late.ravel()
        for k, end in enumerate(seen):
            begin = seen[k - 1] if k else 0
            rows = self._border[k:].reshape(-1, s + len(late))  # those before do not see these columns yet
            H[late[0] : late[0] + end, late[begin:end]] -= rows[:, s : s + end].T @ rows[:, s + begin : s + end]
        rows = self._border.reshape(-1, s + len(late))
        said = rows[:, :s].T @ rows
        H[np.ix_(late, self._shared)] -= said[:, s:].T
        H[np.ix_(self._shared, self._shared)] -= said[:, :s]
        vector[np.concatenate([self._shared, late])] -= self._d.ravel() @ rows

    def given(self, border: Array) -> dict[int, Array]:
        """As :meth:`Strand.given`."""
        shared, late, w = border[self._shared], border[self._late], len(self._chain.damping)
        known, between = np.concatenate([shared, late.ravel()]), np.zeros((len(self._own) + 1, REACH * w))
        for k in range(len(self._own) - 1, -1, -1):
            right = self._d[k] - self._next[k] @ between[k + 1] - self._border[k] @ known
            between[k] = dtrsv(self._own[k], right)
        steps = np.empty(self._chain.gradient.shape)
        for k, ((begin, end), run) in enumerate(zip(self._segments, self._runs, strict=True)):
            if k:
                steps[begin - REACH : begin] = between[k - 1].reshape(REACH, w)
            later = [between[k], between[k - 1] if k else np.zeros(REACH * w), shared, late[begin:end].ravel()]
            steps[begin:end] = run.given(np.concatenate(later))
        return {self._number: steps}


def _add(H: Array, columns: np.ndarray, said: Array) -> None:
    """Add what is said of some columns, of which the upper triangle counts; ``H`` may have them in another order."""
    said = np.triu(said)
    H[np.ix_(columns, columns)] += said + np.triu(said, 1).T


def _reaching(chain: Chain) -> np.ndarray:
    """Of which columns ``(w,)`` the frame two before sees anything."""
    if chain.following is None:
        return np.zeros(len(chain.damping), bool)
    blocks = chain.following[:, 1]
    found: np.ndarray = np.any(blocks[:: len(blocks) // 8 + 1], axis=(0, 1))  # most of them, and quickly
    found[~found] = np.any(blocks[:, :, ~found], axis=(0, 1))
    return found


def _runs(places: np.ndarray) -> Iterator[slice]:
    """Where places that follow one another are."""
    ends = [0, *(np.flatnonzero(np.diff(places) != 1) + 1).tolist(), len(places)]
    return (slice(*one) for one in pairwise(ends) if one[0] < one[1])


def _placed(blocks: Array, rows: np.ndarray, columns: np.ndarray, first: int = 0) -> Iterator[Piece]:
    """Blocks ``(t, r, c)`` from a frame on whose rows and columns are at these places, in pieces above the diagonal."""
    for r in _runs(rows):
        for c in _runs(columns):
            row, column, block = int(rows[r.start]), int(columns[c.start]), blocks[:, r, c]
            if rows is columns and r.start > c.start:  # of these blocks the other triangle counts
                continue
            yield (block, row, column, first) if row <= column else (block.swapaxes(1, 2), column, row, first)
