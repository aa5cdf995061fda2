"""Normal equations of a chain of frames that all touch the same static variables, as GTSAM Hessian factors."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import gtsam
import numpy as np

from vip_factors.geometry.rotations import Array
from vip_factors.graph.evaluated import MotionTerm
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

    def add_motion(
        self, frames: slice, jacobian: Array, terms: Sequence[MotionTerm], hessian: Array, gradient: Array
    ) -> None:
        """Add the factors over three frames to a stretch.

        Each such factor sees one point at three frames, with fixed coefficients ``c``: between frames ``i`` and ``j``
        its Hessian is ``J_iᵀ (Σ w c_i c_j) J_j``, summed over the centres that see both.

        Args:
            frames: the stretch.
            jacobian: ``(t + 2, 3 m, w)`` of the terms' points in the stretch and the two frames after it.
            terms: the ``m`` terms of the whole recording.
            hessian, gradient: of the stretch, over all columns; added to in place.
        """
        assert self.following is not None
        T, w, count = len(self.frame_keys), self.frame_width, frames.stop - frames.start
        weights = _padded(terms, [term.weight for term in terms], T)
        residuals = _padded(terms, [term.residual for term in terms], T)
        c = np.stack([term.coefficients for term in terms], axis=1)  # (3, m)
        rows = np.arange(frames.start, frames.stop)

        def centres(offset: int) -> Array:
            """Weights ``(t, m)`` of the factors centred ``offset`` frames after each."""
            inside = (rows + offset >= 0) & (rows + offset < T)
            return weights[np.clip(rows + offset, 0, T - 1)] * inside[:, None]

        now = jacobian[:count]
        before, here, after = centres(1), centres(0), centres(-1)  # this frame is first, middle, last of three
        transposed = now.swapaxes(1, 2)
        same = before * c[0] ** 2 + here * c[1] ** 2 + after * c[2] ** 2
        hessian[:, :w, :w] += (transposed * _rows(same)) @ now
        pairs = (before * c[0] * c[1] + here * c[1] * c[2], before * c[0] * c[2])
        for ahead, scale in enumerate(pairs, start=1):
            there = jacobian[ahead : ahead + count]
            n = len(there)
            self.following[frames.start : frames.start + n, ahead - 1] = (transposed[:n] * _rows(scale)[:n]) @ there
        self._add_motion_gradient(rows, transposed, (before, here, after), c, residuals, terms, hessian, gradient)

    def _add_motion_gradient(
        self, rows: Array, transposed: Array, weights: tuple[Array, ...], c: Array, residuals: Array,
        terms: Sequence[MotionTerm], hessian: Array, gradient: Array,
    ) -> None:  # fmt: skip
        """The right-hand side of the motion factors, and their coupling with the headings."""
        T, w = len(self.frame_keys), self.frame_width
        force = np.zeros((len(rows), 3 * len(terms)))
        by_heading = _padded(terms, [_heading_rows(term) for term in terms], T)
        coupling = np.zeros((len(rows), len(terms), 3))
        for k, (weight, offset) in enumerate(zip(weights, (1, 0, -1), strict=True)):
            centre = np.clip(rows + offset, 0, T - 1)
            force += ((weight * c[k])[:, :, None] * residuals[centre]).reshape(len(rows), -1)
            turned = (weight * c[k])[:, :, None] * by_heading[centre]
            if self.walk is None or offset == 0:
                coupling += turned
            else:
                self._add_beside(self.walk, 0 if offset > 0 else 1, rows, transposed, turned, terms)
        gradient[:, :w] += (transposed @ force[:, :, None])[:, :, 0]
        here = weights[1]
        for index, term in enumerate(terms):
            if term.by_heading is None or hessian.shape[2] == w:
                continue
            column, own = w + term.point, by_heading[rows, index]
            block = (transposed[:, :, 3 * index : 3 * index + 3] @ coupling[:, index, :, None])[:, :, 0]
            hessian[:, :w, column] += block
            hessian[:, column, :w] += block
            hessian[:, column, column] += here[:, index] * np.sum(own**2, axis=1)
            gradient[:, column] += here[:, index] * np.sum(own * residuals[rows, index], axis=1)

    def _add_beside(
        self, walk: WalkSystem, side: int, rows: Array, transposed: Array, turned: Array, terms: Sequence[MotionTerm]
    ) -> None:
        """The coupling of frames with the headings of the frame beside them, on which a motion factor is centred."""
        for index, term in enumerate(terms):
            if term.by_heading is not None:
                block = transposed[:, :, 3 * index : 3 * index + 3] @ turned[:, index, :, None]
                walk.beside[rows, side, :, term.point] += block[:, :, 0]

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


def _rows(scale: Array) -> Array:
    """Scales ``(t, m)`` of terms as scales ``(t, 1, 3 m)`` of their rows."""
    return np.repeat(scale, 3, axis=1)[:, None, :]


def _padded(terms: Sequence[MotionTerm], parts: list[Array], T: int) -> Array:
    """Values of the frames that terms have, ``(t, …)`` each, as ``(T, m, …)`` with zeros elsewhere."""
    stacked = np.zeros((T, len(parts), *parts[0].shape[1:]))
    for index, (term, part) in enumerate(zip(terms, parts, strict=True)):
        stacked[term.start : term.start + len(part), index] = part
    return stacked


def _heading_rows(term: MotionTerm) -> Array:
    return np.zeros_like(term.residual) if term.by_heading is None else term.by_heading
