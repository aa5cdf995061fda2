"""Chains that meet another in every frame, as people before a moving camera have its pose, each eliminated by itself.

Side by side they would be cubic in their number. Nested dissection (George 1973, doi:10.1137/0710032) of two levels: in
a segment each chain goes by itself, and sees what it meets there and the two frames on either side; then goes what they
met; and last, as one chain, the frames between segments.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from vip_factors.geometry.rotations import Array
from vip_factors.solve.chain_system import REACH, Chain, ChainSystem
from vip_factors.solve.strands import Border, Piece, Run, add, far_columns, placed, runs_of, tied

SEGMENT = 28  # frames: shorter ones leave more frames between them, longer ones see more of what is met


@dataclass(frozen=True)
class _Part:
    """A chain, and where its columns ``(w,)`` are.

    Attributes:
        place: in a frame: first ``far`` columns that see or are seen two frames on.
        between: in the first and in the second of the two frames between segments.
        shared: columns of the border that it sees.
        coupling: blocks, the first of their columns among these, and the first frame.
    """

    number: int
    chain: Chain
    place: np.ndarray
    far: int
    between: tuple[np.ndarray, np.ndarray]
    shared: np.ndarray
    coupling: list[tuple[Array, int, int]]

    @property
    def behind(self) -> np.ndarray:
        """Columns between segments that the frames before them see, in a run's order."""
        order = np.argsort(self.place)
        return np.concatenate([self.between[0][order], self.between[1][order[: self.far]]])

    @property
    def before(self) -> np.ndarray:
        """Columns between segments that the frames behind them see."""
        order = np.argsort(self.place)
        return np.concatenate([self.between[0][order[: self.far]], self.between[1][order]])


class SegmentedStrand:
    """Chains whose frames are tied and which all meet a last one, and nothing else.

    Args:
        system, border: of all chains.
        last: number of the chain that all others meet.
    """

    def __init__(self, system: ChainSystem, border: Border, last: int) -> None:
        self._system, self._parts, start = system, list[_Part](), 0
        for number in [*(one for one in range(len(system.chains)) if one != last), last]:
            chain, columns, coupling = system.chains[number], [np.zeros(0, int)], list[tuple[Array, int, int]]()
            for group in sorted(group for p, group in system.coupling if p == number):
                at = sum(map(len, columns))
                blocks = border.coupling(number, group, system.coupling[number, group])
                coupling += [(block, at + column, first) for block, column, first in blocks]
                columns.append(border.of_group[group])
            reaching = far_columns(chain)
            place, far, w = np.argsort(np.argsort(~reaching, kind="stable")), int(reaching.sum()), len(reaching)
            between = start + np.where(place < far, place, w + place), start + far + place
            self._parts.append(_Part(number, chain, place, far, between, np.concatenate(columns), coupling))
            start += REACH * w
        self._met = [system.between[part.number, last] for part in self._parts[:-1]]
        count = max(1, round((system.frames + REACH) / (SEGMENT + REACH)))
        ends = np.linspace(0, system.frames + REACH, count + 1).astype(int).tolist()
        self._segments = [(begin, end - REACH) for begin, end in pairwise(ends)]
        # a frame of what is eliminated last: between two segments, then what is met in the second; and what it sees
        self._between, longest = start, max(end - begin for begin, end in self._segments)
        self._width = start + len(self._parts[-1].place) * longest

    def eliminate(self, damping: float, H: Array, vector: Array) -> None:
        """As :meth:`~vip_factors.solve.strands.Strand.eliminate`."""
        last, V, width, count = self._parts[-1], self._between, self._width, len(self._segments)
        gradient, damped, c = np.zeros((count, width)), np.zeros(width), len(last.place)
        damped[V:] = damping * np.tile(last.chain.damping, (width - V) // c)
        for part in self._parts:
            for columns in part.between:
                damped[columns] = damping * part.chain.damping
        self._runs, pieces = list[list[Run]](), [(np.eye(V)[None], 0, 0, 0)]  # there is nothing before the first
        for k, (begin, end) in enumerate(self._segments):
            runs, filled = list[Run](), V + c * (end - begin)
            gradient[k, V:filled] += last.chain.gradient[begin:end].ravel()
            pieces += [(np.eye(width - filled)[None], filled, filled, k), *self._of_last(k)]
            for part, met in zip(self._parts[:-1], self._met, strict=True):
                order, sizes = np.argsort(part.place), [len(part.behind), len(part.before), len(part.shared)]
                rows = (end - begin, len(order), len(order) + sum(sizes) + filled - V)
                run = Run(
                    list(_pieces(part, met, begin, end)), part.chain.gradient[begin:end, order],
                    damping * part.chain.damping[order], sizes[0], self._system.memory_of(part.number, begin, rows),
                )  # fmt: skip
                places = [width + part.behind, part.before, width + V + part.shared, np.arange(V, filled)]
                pieces += self._said(k, run.information[None], np.concatenate(places))
                behind, before, shared, there = np.split(run.vector, np.cumsum(sizes))
                gradient[k, part.before] -= before
                gradient[k, V:filled] -= there
                gradient[k + 1 : k + 2, part.behind] -= behind
                vector[part.shared] += shared
                own = slice(sizes[0] + sizes[1], sum(sizes))
                add(H, part.shared, run.information[own, own])
                runs.append(run)
            self._runs.append(runs)
        for k, (begin, _) in enumerate(self._segments[1:], start=1):
            pieces += self._of_between(k)
            for part in self._parts:
                for j, columns in enumerate(part.between):
                    gradient[k, columns] += part.chain.gradient[begin - REACH + j]
        kept = self._system.memory_of(last.number, 0, (count, width, width + V + len(vector)))
        self._last = Run(pieces, gradient, damped, V, kept)
        for run in (run for runs in self._runs for run in runs):
            run.information = run.information[:0]  # it is not asked for again
        H += self._last.information[V:, V:]
        vector += self._last.vector[V:]

    def _said(self, k: int, blocks: Array, places: np.ndarray) -> Iterator[Piece]:
        """What is known in a segment of columns at these places: of the frames before it, or before the next one."""
        width, end = self._width, self._width + self._between
        for block, row, column, _ in placed(blocks, places, places):
            if row < width:
                yield block, row, column, k
            elif row < end and k + 1 < len(self._segments):
                yield block, row - width, column - width if column < end else column, k + 1

    def _of_last(self, k: int) -> Iterator[Piece]:
        """Of the last chain what its frames in a segment say, and the two before it of these."""
        part, (begin, end), c = self._parts[-1], self._segments[k], len(self._parts[-1].place)
        places = {t: self._between + np.arange(c * (t - begin), c * (t - begin + 1)) for t in range(begin, end)}
        for j in range(REACH):
            places[begin - REACH + j], places[end + j] = part.between[j], self._width + part.between[j]
        for t in range(begin, end):
            yield from placed(part.chain.own[t : t + 1], places[t], places[t], k)
            yield from self._of_shared(part, t, places[t], k)
        assert part.chain.following is not None
        for t in range(max(begin - REACH, 0), end):
            for ahead, there in enumerate(range(t + 1, t + 1 + REACH)):
                if begin <= there < self._system.frames:
                    yield from placed(part.chain.following[t : t + 1, ahead], places[t], places[there], k)

    def _of_shared(self, part: _Part, t: int, place: np.ndarray, k: int) -> Iterator[Piece]:
        for blocks, column, first in part.coupling:
            if first <= t < first + len(blocks):
                seen = self._width + self._between + part.shared[column : column + blocks.shape[2]]
                yield from placed(blocks[t - first : t - first + 1], place, seen, k)

    def _of_between(self, k: int) -> Iterator[Piece]:
        """What the two frames before a segment say of themselves."""
        first = self._segments[k][0] - REACH
        for part, met in zip(self._parts, [*self._met, None], strict=True):
            assert part.chain.following is not None
            yield from placed(part.chain.following[first : first + 1, 0], *part.between, k)
            for j, t in enumerate(range(first, first + REACH)):
                yield from placed(part.chain.own[t : t + 1], part.between[j], part.between[j], k)
                yield from self._of_shared(part, t, part.between[j], k)
                if met is not None:
                    yield from placed(met[t : t + 1], part.between[j], self._parts[-1].between[j], k)

    def given(self, border: Array) -> dict[int, Array]:
        """As :meth:`~vip_factors.solve.strands.Strand.given`."""
        V, last = self._between, self._parts[-1]
        found = self._last.given(np.concatenate([np.zeros(V), border]))
        around, steps = np.vstack([found[:, :V], np.zeros((1, V))]), dict[int, Array]()
        for number, part in enumerate(self._parts):
            own = steps[part.number] = np.empty(part.chain.gradient.shape)
            for k, (begin, end) in enumerate(self._segments):
                met = found[k, V : V + len(last.place) * (end - begin)]
                if part is last:
                    own[begin:end] = met.reshape(end - begin, -1)
                else:
                    known = [around[k + 1, part.behind], around[k, part.before], border[part.shared], met]
                    own[begin:end] = self._runs[k][number].given(np.concatenate(known))[:, part.place]
                for j, columns in enumerate(part.between if k else ()):
                    own[begin - REACH + j] = around[k, columns]
        return steps


def _pieces(part: _Part, met: Array, begin: int, end: int) -> Iterator[Piece]:
    """Of one chain in a segment: its frames, two behind it, two before it, what is shared, and what is met in it."""
    chain, place, w, far = part.chain, part.place, len(part.place), part.far
    following = chain.following
    assert following is not None
    yield from tied(chain.own[begin:end], following[begin:end], place, w, far)
    start = w + len(part.behind)
    if begin:
        for some in runs_of(np.flatnonzero(place < far)):
            yield from placed(following[begin - 2, 1, some].T[None], place, start + place[some])
        for ahead in range(REACH):
            yield from placed(following[begin - 1, ahead].T[None], place, start + far + place, ahead)
    start += len(part.before)
    for blocks, column, first in part.coupling:
        within = blocks[max(begin - first, 0) : max(end - first, 0)]
        if len(within):
            yield from placed(within, place, start + column + np.arange(within.shape[2]), max(first - begin, 0))
    start += len(part.shared)
    in_order, c = met[begin:end, np.argsort(place)], met.shape[2]
    for t in range(end - begin):
        yield in_order[t : t + 1], 0, start + c * t, t
