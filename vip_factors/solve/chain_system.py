"""Normal equations of parallel chains that share static variables, as GTSAM Hessian factors, stretch by stretch.

A chain is what one owner has of its own in every frame: a body, a camera's pose. A group is what all frames share of
one owner. What they are about is not known here.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import gtsam
import numpy as np
from scipy.linalg.lapack import dpbtrf, dpbtrs

from vip_factors.geometry.rotations import Array
from vip_factors.solve.elimination import coupling_factor
from vip_factors.solve.knots import KnotSystem

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
        own: ``(T, w, w)`` of a frame with itself.
        following: ``(T, 2, w, w)`` of a frame with the next and the one after, or None if frames are independent.
        gradient: ``(T, w)``.
        damping: ``(w,)`` what one unit of damping adds to the diagonal.
    """

    keys: list[int]
    own: Array
    following: Array | None
    gradient: Array
    damping: Array

    @classmethod
    def empty(cls, number: int, frames: int, damping: Array, tied: bool) -> "Chain":
        """Zeros."""
        w = len(damping)
        following = np.zeros((frames, 2, w, w)) if tied else None
        keys = frame_keys(number, frames)
        return cls(keys, np.zeros((frames, w, w)), following, np.zeros((frames, w)), damping)


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
    T, w = len(chain.keys), chain.own.shape[1]
    zero, none, extra = np.zeros((w, w)), np.zeros(w), np.diag(damping * chain.damping)
    for t in range(start, stop):
        key, G, g = chain.keys[t], chain.own[t] + extra, chain.gradient[t]
        if chain.following is None or t == T - 1:
            graph.push_back(gtsam.HessianFactor(key, G, -g, 0.0))
        elif t == T - 2:
            graph.push_back(gtsam.HessianFactor(key, chain.keys[t + 1], G, chain.following[t, 0], -g, zero, none, 0.0))
        else:
            after, last = chain.keys[t + 1], chain.keys[t + 2]
            G12, G13 = chain.following[t]
            graph.push_back(gtsam.HessianFactor(key, after, last, G, G12, G13, -g, zero, zero, none, zero, none, 0.0))


@dataclass(frozen=True)
class ChainStep:
    """A step ``(T, w)`` of every frame of a chain, by GTSAM's names."""

    rows: dict[int, int]
    steps: Array

    def at(self, key: int) -> Array:
        """Of one frame."""
        return np.asarray(self.steps[self.rows[key]])


def is_one_chain(system: object) -> bool:
    """Whether a system is a single chain, without anything that its frames share and without further factors."""
    return (
        isinstance(system, ChainSystem)
        and len(system.chains) == 1
        and not (system.groups or system.between or system.coupling or system.extra)
    )


def chain_step(chain: Chain, damping: float) -> ChainStep | None:
    """The minimum of the damped quadratic; None where it is not determined."""
    extra = damping * chain.damping
    if chain.following is None:
        steps = _independent(chain.own + np.diag(extra), chain.gradient)
    else:
        steps = _tied(chain.own, extra, chain.following, chain.gradient)
    return None if steps is None else ChainStep({key: t for t, key in enumerate(chain.keys)}, steps)


def _independent(own: Array, gradient: Array) -> Array | None:
    try:
        factor = np.linalg.cholesky(own)  # it alone says whether the matrix is positive
    except np.linalg.LinAlgError:
        return None
    half = np.linalg.solve(factor, -gradient[..., None])
    return np.asarray(np.linalg.solve(factor.swapaxes(1, 2), half)[..., 0])


def _tied(own: Array, extra: Array, following: Array, gradient: Array) -> Array | None:
    """Of frames tied to the next two: the columns of the lower band, one below the other."""
    T, w = gradient.shape
    band = np.zeros((T, w, 3 * w))
    for a in range(w):
        band[:, a, : w - a] = own[:, a, a:]
        band[:, a, w - a : 3 * w - a] = following[:, :, a].reshape(T, 2 * w)
    band[:, :, 0] += extra
    factor, failed = dpbtrf(band.reshape(T * w, 3 * w).T, lower=1, overwrite_ab=1)
    if failed:
        return None
    steps, _ = dpbtrs(factor, -gradient.reshape(T * w, 1), lower=1)
    return np.asarray(steps.reshape(T, w))
