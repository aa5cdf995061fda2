"""Normal equations of a chain of frames that all touch the same static variables, as GTSAM Hessian factors."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import gtsam
import numpy as np

from vip_factors.geometry.rotations import Array
from vip_factors.graph.hessian import coupling_factor
from vip_factors.graph.walk import WalkSystem

STRETCH = 100  # frames handed to GTSAM at once: its factors take more room than the arrays they are made from


@dataclass
class ChainSystem:
    """A linearisation: blocks of the Hessian, and the gradient.

    Attributes:
        frame_keys, static_key: GTSAM's names of the blocks.
        frame_width: ``w``, of a frame's tangent; 0 if all variables are static.
        columns: which of all columns are free; the first ``w`` are the frame's.
        damping: ``(n,)`` what one unit of damping adds to the diagonal.
        own: ``(T, n, n)`` of a frame with itself and with the static variables (and what the frame adds to those).
        gradient: ``(T, n)``.
        following: ``(T, 2, w, w)`` of a frame with the next and the one after, or None if frames are independent.
        walk: of headings that walk; the heading columns are then each frame's own.
    """

    frame_keys: Sequence[int]
    static_key: int
    frame_width: int
    columns: np.ndarray
    damping: Array
    own: Array
    gradient: Array
    following: Array | None
    walk: WalkSystem | None = None

    @classmethod
    def empty(
        cls,
        frame_keys: Sequence[int],
        static_key: int,
        frame_width: int,
        columns: np.ndarray,
        damping: Array,
        tied: bool,
    ) -> "ChainSystem":
        """Zeros, for as many frames as there are keys."""
        T, n, w = len(frame_keys), len(columns), frame_width
        following = np.zeros((T, 2, w, w)) if tied and w else None
        return cls(frame_keys, static_key, w, columns, damping, np.zeros((T, n, n)), np.zeros((T, n)), following)

    @property
    def static_width(self) -> int:
        """Number of free static columns."""
        return len(self.columns) - self.frame_width

    # Filling

    def add_frames(self, frames: slice, hessian: Array, gradient: Array) -> None:
        """Add ``(t, width, width)`` and ``(t, width)`` over all columns to a stretch of frames."""
        if len(self.columns) == hessian.shape[1]:
            self.own[frames] += hessian
        elif self.static_width == 0:
            self.own[frames] += hessian[:, : self.frame_width, : self.frame_width]
        else:
            self.own[frames] += hessian[:, self.columns[:, None], self.columns]
        self.gradient[frames] += gradient[:, self.columns]

    def add_first(self, columns: np.ndarray, hessian: Array, gradient: Array) -> None:
        """Add to the first frame's block; ``columns`` are of all, and those that are not free are passed over."""
        place = np.searchsorted(self.columns, columns)
        self.own[0][np.ix_(place, place)] += hessian
        self.gradient[0][place] += gradient

    # Handing over

    def stretches(self, damping: float) -> Iterator[tuple[gtsam.GaussianFactorGraph, gtsam.Ordering]]:
        """The factors with ``damping`` units on the diagonal, with the keys to eliminate, stretch by stretch."""
        T = len(self.frame_keys)
        for start in range(0, T, STRETCH):
            graph, ordering = gtsam.GaussianFactorGraph(), gtsam.Ordering()
            stop = min(start + STRETCH, T)
            self.append_frames(graph, start, stop, damping)
            for key in [*self.frame_keys[start:stop], *self.append_passed(graph, start, stop, damping)]:
                ordering.push_back(key)
            if stop == T and self.static_width:
                self.append_static(graph, damping)
                ordering.push_back(self.static_key)
            yield graph, ordering

    def append_frames(self, graph: gtsam.GaussianFactorGraph, start: int, stop: int, damping: float) -> None:
        """Append the factors of frames ``start`` to ``stop``, and of those with the static variables."""
        T, w = len(self.frame_keys), self.frame_width
        if w == 0:
            return
        zero, none, extra = np.zeros((w, w)), np.zeros(w), np.diag(damping * self.damping[:w])
        for t in range(start, stop):
            key, G, g = self.frame_keys[t], self.own[t, :w, :w] + extra, self.gradient[t, :w]
            if self.following is None or t == T - 1:
                graph.push_back(gtsam.HessianFactor(key, G, -g, 0.0))
            elif t == T - 2:
                next_key, G12 = self.frame_keys[t + 1], self.following[t, 0]
                graph.push_back(gtsam.HessianFactor(key, next_key, G, G12, -g, zero, none, 0.0))
            else:
                next_key, last_key = self.frame_keys[t + 1], self.frame_keys[t + 2]
                G12, G13 = self.following[t]
                graph.push_back(
                    gtsam.HessianFactor(key, next_key, last_key, G, G12, G13, -g, zero, zero, none, zero, none, 0.0)
                )
        if self.static_width:
            for t in range(start, stop):
                key, block = self.frame_keys[t], self.own[t, :w, w:]
                if self.walk is None:
                    graph.push_back(coupling_factor(key, self.static_key, block))
                else:
                    self.walk.append_couplings(graph, t, key, self.static_key, block)

    def append_passed(self, graph: gtsam.GaussianFactorGraph, start: int, stop: int, damping: float) -> Sequence[int]:
        """Append the factors of the headings that no frame after this stretch sees; returns their keys."""
        if self.walk is None:
            return ()
        own, gradient, w = self.own, self.gradient, self.frame_width
        static = own[:, w:, w:], gradient[:, w:]
        return list(self.walk.append_passed(graph, start, stop, self.static_key, *static, damping))

    def append_static(self, graph: gtsam.GaussianFactorGraph, damping: float) -> None:
        """Append what all frames together say of the static variables."""
        w = self.frame_width
        own, gradient = self.own[:, w:, w:], self.gradient[:, w:]
        if self.walk is None:
            total, g = own.sum(axis=0), gradient.sum(axis=0)
        else:
            total, g = self.walk.static_equations(own, gradient)
        total = total + np.diag(damping * self.damping[w:])
        graph.push_back(gtsam.HessianFactor(self.static_key, total, -g, 0.0))
