"""Variables that walk, in the normal equations: what a frame says of their value then, spread over the knots around it.

A chain's own blocks stay in terms of each frame's value, whether it walks or not. The first knot stands in the static
group, where a constant value stands; each further knot is a GTSAM variable of its own, and is eliminated as soon as no
later frame sees it: a longer recording costs no more by the frame.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import gtsam
import numpy as np

from vip_factors.geometry.rotations import Array
from vip_factors.solve.elimination import coupling_factor


@dataclass
class KnotSystem:
    """The ``S`` first columns of a static group of ``s``, which walk.

    Attributes:
        chain: whose frames see them.
        keys: GTSAM's names of the ``K − 1`` later knots.
        weights: ``(T, K)`` of the knots in each frame.
        own, gradient: ``(T, S, s)`` and ``(T, S)`` of the values at each frame's instant with the group's columns.
        adjacent: ``(T, 2, w, S)`` blocks of a frame with the values of the next frame and of the one before; they lie
            at the end of the chain's rows.
        diagonal, following, knot_gradient: ``(K, S)``, ``(K − 1, S)`` and ``(K, S)`` of what ties knots to one another.
        damping: what one unit of damping adds to the diagonal.
    """

    chain: int
    keys: Sequence[int]
    weights: Array
    own: Array
    gradient: Array
    adjacent: Array
    diagonal: Array
    following: Array
    knot_gradient: Array
    damping: float

    @classmethod
    def empty(
        cls, chain: int, keys: Sequence[int], weights: Array, rows: Array, columns: int, static_width: int,
        damping: float,
    ) -> "KnotSystem":  # fmt: skip
        """Zeros, of a chain's ``rows`` ``(T, w, m)``."""
        (T, K), S = weights.shape, columns
        adjacent = rows[:, :, -2 * S :].reshape(T, -1, 2, S).swapaxes(1, 2)
        return cls(
            chain, keys, weights, np.zeros((T, S, static_width)), np.zeros((T, S)), adjacent,
            np.zeros((K, S)), np.zeros((K - 1, S)), np.zeros((K, S)), damping,
        )  # fmt: skip

    def empty_again(self) -> None:
        """All zero, but for what lies in the chain's rows."""
        for one in (self.own, self.gradient, self.diagonal, self.following, self.knot_gradient):
            one[:] = 0.0

    def add_between(self, root: Array, residual: Array) -> None:
        """Add factors from each knot to the next: ``root`` and ``residual`` ``(K − 1, S)``, whitened."""
        for part, sign in ((slice(0, -1), -1.0), (slice(1, None), 1.0)):
            self.diagonal[part] += root**2
            self.knot_gradient[part] += sign * root * residual
        self.following -= root**2

    @property
    def columns(self) -> int:
        """Number of headings that drift."""
        return self.own.shape[1]

    def append_couplings(
        self, graph: gtsam.GaussianFactorGraph, t: int, frame_key: int, static_key: int, block: Array
    ) -> None:
        """Append what ties frame ``t`` to knots and static variables; ``block`` ``(w, s)`` is by its own values."""
        S, T = self.columns, len(self.weights)
        here, after, before = self.weights[t], self.weights[min(t + 1, T - 1)], self.weights[max(t - 1, 0)]
        static = block.copy()
        static[:, :S] = 0.0
        for k in np.flatnonzero(here + after + before).tolist():
            by_knot = here[k] * block[:, :S] + after[k] * self.adjacent[t, 0] + before[k] * self.adjacent[t, 1]
            if k == 0:
                static[:, :S] = by_knot
            else:
                graph.push_back(coupling_factor(frame_key, self.keys[k - 1], by_knot))
        graph.push_back(coupling_factor(frame_key, static_key, static))

    def add_static(self, H: Array, g: Array) -> None:
        """Add the first knot's share to the group's own ``(s, s)`` and ``(s,)``, which hold at most its prior."""
        S, first = self.columns, self.weights[:, 0]
        H[:S, :S] += _weighed(first**2, self.own[:, :, :S]) + np.diag(self.diagonal[0])
        H[:S, S:] += _weighed(first, self.own[:, :, S:])
        H[S:, :S] = H[:S, S:].T
        g[:S] += _weighed(first, self.gradient) + self.knot_gradient[0]

    def append_passed(
        self, graph: gtsam.GaussianFactorGraph, start: int, stop: int, static_key: int, damping: float
    ) -> Iterator[int]:
        """Append all that is left to say of the knots that no frame from ``stop`` on sees; yields their keys."""
        for k, key in enumerate(self.keys, start=1):
            if not self._passed(k, stop) or self._passed(k, start):
                continue
            H, g, static, following = self.of_later(k, damping)
            graph.push_back(gtsam.HessianFactor(key, H, -g, 0.0))
            graph.push_back(coupling_factor(key, static_key, static))
            if following is not None:
                graph.push_back(coupling_factor(key, self.keys[k], following))
            yield key

    def of_later(self, k: int, damping: float) -> tuple[Array, Array, Array, Array | None]:
        """Of the ``k``-th knot, a later one: blocks ``(S, S)`` with itself, ``(S, s)`` with the static group and
        ``(S, S)`` with the next knot, if there is one; and the gradient ``(S,)``, as the second."""
        S, weight = self.columns, self.weights[:, k]
        H = _weighed(weight**2, self.own[:, :, :S]) + np.diag(self.diagonal[k] + damping * self.damping)
        static = np.zeros(self.own.shape[1:])
        static[:, S:] = _weighed(weight, self.own[:, :, S:])
        if k == 1:
            static[:, :S] = self._neighbours(0)
        following = self._neighbours(k) if k < len(self.keys) else None
        return H, _weighed(weight, self.gradient) + self.knot_gradient[k], static, following

    def _neighbours(self, k: int) -> Array:
        """Block of a knot with the next one."""
        S = self.columns
        both = self.weights[:, k] * self.weights[:, k + 1]
        return _weighed(both, self.own[:, :, :S]) + np.diag(self.following[k])

    def _passed(self, k: int, frame: int) -> bool:
        """Whether no frame from this one on sees a knot; each sees those around its neighbours too."""
        seen = np.flatnonzero(self.weights[:, k])
        last = int(seen[-1]) + 1 if len(seen) else 0
        return frame == len(self.weights) or last < frame


def _weighed(weight: Array, blocks: Array) -> Array:
    """Weighted sum over frames."""
    inside = np.flatnonzero(weight)
    return np.tensordot(weight[inside], blocks[inside], axes=1)
