"""Linear systems written out, for comparison."""

from collections.abc import Iterator
from typing import Protocol

import gtsam
import numpy as np

from vip_factors.factor_graph.graph import FactorGraph


class System(Protocol):
    def stretches(self, damping: float) -> Iterator[tuple[gtsam.GaussianFactorGraph, gtsam.Ordering]]: ...


def dense(system: System) -> tuple[np.ndarray, np.ndarray]:
    """Hessian and gradient in the order of elimination."""
    whole, order = gtsam.GaussianFactorGraph(), gtsam.Ordering()
    for graph, ordering in system.stretches(0.0):
        whole.push_back(graph)
        for index in range(ordering.size()):
            order.push_back(ordering.at(index))
    return whole.hessian(order)


def dense_of_graph(whole: FactorGraph, order: list[int] | None = None) -> tuple[np.ndarray, np.ndarray]:
    """The same of a GTSAM graph at its values, in the order of its variables or another."""
    ordering = gtsam.Ordering()
    for key in [one.key for one in whole.variables] if order is None else order:
        ordering.push_back(key)
    return whole.graph.linearize(whole.values).hessian(ordering)


def assert_same(ours: tuple[np.ndarray, np.ndarray], theirs: tuple[np.ndarray, np.ndarray]) -> None:
    (H, g), (expected_H, expected_g) = ours, theirs
    scale = np.sqrt(np.outer(np.diag(expected_H), np.diag(expected_H)))
    np.testing.assert_allclose(H / scale, expected_H / scale, atol=1e-9)
    np.testing.assert_allclose(g, expected_g, atol=1e-9 * np.abs(expected_g).max())
