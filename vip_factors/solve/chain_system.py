"""Normal equations of parallel chains that share static variables, as GTSAM Hessian factors, stretch by stretch.

A chain is what one owner has of its own in every frame: a body, a camera's pose. A group is what all frames share of
one owner. What they are about is not known here.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import gtsam
import numpy as np

from vip_factors.geometry.rotations import Array
from vip_factors.solve.elimination import coupling_factor
from vip_factors.solve.knots import KnotSystem

REACH = 2  # frames that a factor reaches ahead of its first one
STRETCH = 100  # frames handed to GTSAM at once: its factors take more room than the arrays they are made from


def frame_keys(chain: int, frames: int) -> list[int]:
    """GTSAM's names of a chain's vectors, frame by frame."""
    return [gtsam.symbol("x", (chain << 44) + t) for t in range(frames)]


def static_key(group: int) -> int:
    """GTSAM's name of a group's vector."""
    return int(gtsam.symbol("z", group))


def knot_key(group: int, knot: int) -> int:
    """GTSAM's name of a group's vector at a later knot."""
    return int(gtsam.symbol("w", (group << 44) + knot))


@dataclass
class Chain:
    """What one owner has of its own in every frame.

    Attributes:
        keys: ``T`` of GTSAM.
        rows: ``(T, w, m)``: blocks of a frame with itself, with the next and the one after where frames are tied, and
            then with whatever else it meets; its parts are views of them. With itself the upper triangle counts.
        gradient: ``(T, w)``.
        damping: ``(w,)`` what one unit of damping adds to the diagonal.
        tied: whether frames are tied to the next two.
    """

    keys: list[int]
    rows: Array
    gradient: Array
    damping: Array
    tied: bool

    @classmethod
    def empty(cls, number: int, frames: int, damping: Array, tied: bool, others: int = 0) -> "Chain":
        """Zeros, with so many columns of what else it meets."""
        w = len(damping)
        rows = np.zeros((frames, w, (REACH + 1 if tied else 1) * w + others))
        return cls(frame_keys(number, frames), rows, np.zeros((frames, w)), damping, tied)

    @property
    def own(self) -> Array:
        """``(T, w, w)`` of a frame with itself."""
        return self.rows[:, :, : len(self.damping)]

    @property
    def following(self) -> Array | None:
        """``(T, 2, w, w)`` of a frame with the next and the one after, or None if frames are independent."""
        w = len(self.damping)
        if not self.tied:
            return None
        return self.rows[:, :, w : (REACH + 1) * w].reshape(len(self.keys), w, REACH, w).swapaxes(1, 2)


@dataclass
class StaticGroup:
    """What all frames share of one owner.

    Attributes:
        key: of GTSAM.
        columns: in the static vector.
        knots: of its first columns, where these walk.
    """

    key: int
    columns: slice
    knots: KnotSystem | None = None


@dataclass
class ChainSystem:
    """A linearisation: blocks of the Hessian, and the gradient.

    Attributes:
        chains, groups: of a frame, and of what all share.
        between: of two chains ``(T, w, w')`` in the same frame, by their numbers, the smaller first.
        coupling: of a chain and a group ``(T, w, s)``, by their numbers. Where the group's first columns walk, theirs
            are by the values at the frame's own instant.
        static, static_gradient: ``(s, s)`` and ``(s,)`` of the whole static vector.
        static_damping: ``(s,)``.
        extra: further linear factors, each with the first frame that it sees.
    """

    chains: list[Chain]
    groups: list[StaticGroup]
    static: Array
    static_gradient: Array
    static_damping: Array
    between: dict[tuple[int, int], Array] = field(default_factory=dict)
    coupling: dict[tuple[int, int], Array] = field(default_factory=dict)
    extra: list[tuple[int, gtsam.GaussianFactor]] = field(default_factory=list)
    _memory: dict[tuple[int, int], Array] = field(default_factory=dict)

    def memory_of(self, chain: int, first: int, shape: tuple[int, ...]) -> Array:
        """Memory for what eliminating a chain from a frame on keeps: that of the time before, which is no more."""
        found = self._memory.get((chain, first))
        if found is None or found.shape != shape:
            found = self._memory[chain, first] = np.empty(shape)
        return found

    def emptied(self) -> "ChainSystem":
        """The same, all zero but for the frames of chains: :meth:`empty_frames` is for these."""
        for group in self.groups:
            if group.knots is not None:
                group.knots.empty_again()
        self.static[:], self.static_gradient[:] = 0.0, 0.0
        self.extra.clear()
        return self

    def empty_frames(self, begin: int, end: int) -> None:
        """Make zero what chains say of some frames: best just before they are summed, for then they are at hand."""
        for chain in self.chains:
            chain.rows[begin:end], chain.gradient[begin:end] = 0.0, 0.0

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.chains[0].keys) if self.chains else 0

    def stretches(self, damping: float) -> Iterator[tuple[gtsam.GaussianFactorGraph, gtsam.Ordering]]:
        """The factors with ``damping`` units on the diagonal, with the keys to eliminate, stretch by stretch.

        In time order, all static variables last: a camera's pose connects the bodies of its frame.
        """
        T = self.frames
        for start in range(0, max(T, 1), STRETCH):
            graph, ordering = gtsam.GaussianFactorGraph(), gtsam.Ordering()
            stop = min(start + STRETCH, T)
            for chain in self.chains:
                _append_frames(chain, graph, start, stop, damping)
            self._append_between(graph, start, stop)
            self._append_coupling(graph, start, stop)
            for frame, factor in self.extra:
                if start <= frame < stop or stop == T == start:
                    graph.push_back(factor)
            for t in range(start, stop):
                for chain in self.chains:
                    ordering.push_back(chain.keys[t])
            for group in self.groups:
                for key in self._append_passed(group, graph, start, stop, damping):
                    ordering.push_back(key)
            if stop == T:
                self._append_static(graph, damping)
                for group in self.groups:
                    ordering.push_back(group.key)
            yield graph, ordering

    def _append_between(self, graph: gtsam.GaussianFactorGraph, start: int, stop: int) -> None:
        for (p, q), blocks in self.between.items():
            for t in _frames_with(blocks, start, stop):
                graph.push_back(coupling_factor(self.chains[p].keys[t], self.chains[q].keys[t], blocks[t]))

    def _append_coupling(self, graph: gtsam.GaussianFactorGraph, start: int, stop: int) -> None:
        for (p, g), blocks in self.coupling.items():
            keys, group = self.chains[p].keys, self.groups[g]
            if group.knots is not None and p == group.knots.chain:
                for t in range(start, stop):
                    group.knots.append_couplings(graph, t, keys[t], group.key, blocks[t])
                continue
            for t in _frames_with(blocks, start, stop):
                graph.push_back(coupling_factor(keys[t], group.key, blocks[t]))

    def _append_passed(
        self, group: StaticGroup, graph: gtsam.GaussianFactorGraph, start: int, stop: int, damping: float
    ) -> list[int]:
        """Append the factors of the knots that no frame after this stretch sees; returns their keys."""
        if group.knots is None:
            return []
        return list(group.knots.append_passed(graph, start, stop, group.key, damping))

    def _append_static(self, graph: gtsam.GaussianFactorGraph, damping: float) -> None:
        """Append what all frames together say of the static variables."""
        H, g = self.static + np.diag(damping * self.static_damping), self.static_gradient.copy()
        for group in self.groups:
            if group.knots is not None:
                group.knots.add_static(H[group.columns, group.columns], g[group.columns])
        for number, group in enumerate(self.groups):
            own = group.columns
            graph.push_back(gtsam.HessianFactor(group.key, H[own, own], -g[own], 0.0))
            for other in self.groups[number + 1 :]:
                if H[own, other.columns].any():
                    graph.push_back(coupling_factor(group.key, other.key, H[own, other.columns]))


def _frames_with(blocks: Array, start: int, stop: int) -> list[int]:
    """Those of a stretch whose blocks are not all zero."""
    found: list[int] = (start + np.flatnonzero(np.any(blocks[start:stop], axis=(1, 2)))).tolist()
    return found


def _append_frames(chain: Chain, graph: gtsam.GaussianFactorGraph, start: int, stop: int, damping: float) -> None:
    """Append the factors of frames ``start`` to ``stop``."""
    T, w, following = len(chain.keys), len(chain.damping), chain.following
    zero, none, extra = np.zeros((w, w)), np.zeros(w), np.diag(damping * chain.damping)
    for t in range(start, stop):
        key, G, g = chain.keys[t], chain.own[t] + extra, chain.gradient[t]
        if following is None or t == T - 1:
            graph.push_back(gtsam.HessianFactor(key, G, -g, 0.0))
        elif t == T - 2:
            graph.push_back(gtsam.HessianFactor(key, chain.keys[t + 1], G, following[t, 0], -g, zero, none, 0.0))
        else:
            after, last = chain.keys[t + 1], chain.keys[t + 2]
            G12, G13 = following[t]
            graph.push_back(gtsam.HessianFactor(key, after, last, G, G12, G13, -g, zero, zero, none, zero, none, 0.0))
