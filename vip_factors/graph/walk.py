"""Headings that walk, in the normal equations: what a frame says of its heading, spread over the knots around it.

A chain's own blocks stay in terms of each frame's heading, whether it walks or not. The first knot stands in the static
block, where a constant heading stands; each further knot is a GTSAM variable of its own, of all sensors, and is
eliminated as soon as no later frame sees it: a longer recording costs no more by the frame.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import gtsam
import numpy as np

from vip_factors.factors.heading_prior import heading_prior_residual
from vip_factors.factors.heading_walk import heading_walk_residual
from vip_factors.geometry.rotations import Array
from vip_factors.graph.hessian import coupling_factor
from vip_factors.graph.model import InertialModel
from vip_factors.graph.state import GraphState


def walk_costs(model: InertialModel, state: GraphState) -> dict[str, float]:
    """Half the sum of squared whitened residuals of the heading priors and of the walk."""
    prior, walk = _whitened(model, state)
    return {"heading prior": 0.5 * float(np.sum(prior**2)), "heading walk": 0.5 * float(np.sum(walk**2))}


def _whitened(model: InertialModel, state: GraphState) -> tuple[Array, Array]:
    knots = state.heading_knots
    prior = heading_prior_residual(knots[0], model.prior_headings) / model.heading_sigmas
    return prior, heading_walk_residual(knots[:-1], knots[1:]) / model.walk_sigmas[:, None]


@dataclass
class WalkSystem:
    """The part of a :class:`~vip_factors.graph.system.ChainSystem` that is about walking headings.

    Attributes:
        keys: GTSAM's names of the ``K − 1`` later knots, ``S`` headings each.
        weights: ``(T, K)`` of the knots in each frame.
        beside: ``(T, 2, w, S)`` blocks of a frame with the headings of the next frame and of the one before.
        diagonal, following: ``(K, S)``, ``(K − 1, S)`` of the priors' Hessian, which ties no two sensors together.
        gradient: ``(K, S)`` of the priors.
        damping: what one unit of damping adds to the diagonal.
    """

    keys: Sequence[int]
    weights: Array
    beside: Array
    diagonal: Array
    following: Array
    gradient: Array
    damping: float

    @classmethod
    def of(
        cls, model: InertialModel, state: GraphState, keys: Sequence[int], frame_width: int, damping: float
    ) -> "WalkSystem":
        """The priors' normal equations, and room for the frames'."""
        prior, walk = _whitened(model, state)
        weights = model.knot_weights()
        assert weights is not None
        (T, K), S = weights.shape, len(prior)
        diagonal, gradient = np.zeros((K, S)), np.zeros((K, S))
        diagonal[0], gradient[0] = model.heading_sigmas**-2.0, prior / model.heading_sigmas
        root = np.tile(1 / model.walk_sigmas[:, None], (1, S))
        for part, sign in ((slice(0, -1), -1.0), (slice(1, None), 1.0)):
            diagonal[part] += root**2
            gradient[part] += sign * root * walk
        return cls(keys, weights, np.zeros((T, 2, frame_width, S)), diagonal, -(root**2), gradient, damping)

    @property
    def sensors(self) -> int:
        """Number of headings at a knot; the static block begins with those of the first."""
        return self.beside.shape[3]

    def append_couplings(
        self, graph: gtsam.GaussianFactorGraph, t: int, frame_key: int, static_key: int, block: Array
    ) -> None:
        """Append what ties frame ``t`` to knots and static variables; ``block`` ``(w, n)`` is by its own heading."""
        S, T = self.sensors, len(self.weights)
        here, after, before = self.weights[t], self.weights[min(t + 1, T - 1)], self.weights[max(t - 1, 0)]
        static = block.copy()
        static[:, :S] = 0.0
        for k in np.flatnonzero(here + after + before).tolist():
            by_knot = here[k] * block[:, :S] + after[k] * self.beside[t, 0] + before[k] * self.beside[t, 1]
            if k == 0:
                static[:, :S] = by_knot
            else:
                graph.push_back(coupling_factor(frame_key, self.keys[k - 1], by_knot))
        graph.push_back(coupling_factor(frame_key, static_key, static))

    def static_equations(self, own: Array, gradient: Array) -> tuple[Array, Array]:
        """Hessian and gradient of the static block, from those of all frames ``(T, n, n)`` and ``(T, n)``."""
        S, first = self.sensors, self.weights[:, 0]
        H, g = own.sum(axis=0), gradient.sum(axis=0)
        H[:S, :S] = _weighed(first**2, own[:, :S, :S]) + np.diag(self.diagonal[0])
        H[:S, S:] = _weighed(first, own[:, :S, S:])
        H[S:, :S] = H[:S, S:].T
        g[:S] = _weighed(first, gradient[:, :S]) + self.gradient[0]
        return H, g

    def append_passed(
        self, graph: gtsam.GaussianFactorGraph, start: int, stop: int, static_key: int, own: Array, gradient: Array,
        damping: float,
    ) -> Iterator[int]:  # fmt: skip
        """Append all that is left to say of the knots that no frame from ``stop`` on sees; yields their keys."""
        S = self.sensors
        for k, key in enumerate(self.keys, start=1):
            if not self._passed(k, stop) or self._passed(k, start):
                continue
            weight = self.weights[:, k]
            H = _weighed(weight**2, own[:, :S, :S]) + np.diag(self.diagonal[k] + damping * self.damping)
            g = _weighed(weight, gradient[:, :S]) + self.gradient[k]
            graph.push_back(gtsam.HessianFactor(key, H, -g, 0.0))
            static = np.zeros(own.shape[1:])[:S]
            static[:, S:] = _weighed(weight, own[:, :S, S:])
            if k == 1:
                static[:, :S] = self._neighbours(0, own)
            graph.push_back(coupling_factor(key, static_key, static))
            if k < len(self.keys):
                graph.push_back(coupling_factor(key, self.keys[k], self._neighbours(k, own)))
            yield key

    def _neighbours(self, k: int, own: Array) -> Array:
        """Block of a knot with the next one."""
        S = self.sensors
        return _weighed(self.weights[:, k] * self.weights[:, k + 1], own[:, :S, :S]) + np.diag(self.following[k])

    def _passed(self, k: int, frame: int) -> bool:
        """Whether no frame from this one on sees a knot; each sees those around its neighbours too."""
        seen = np.flatnonzero(self.weights[:, k])
        last = int(seen[-1]) + 1 if len(seen) else 0
        return frame == len(self.weights) or last < frame


def _weighed(weight: Array, blocks: Array) -> Array:
    """Weighted sum over frames."""
    inside = np.flatnonzero(weight)
    return np.tensordot(weight[inside], blocks[inside], axes=1)
