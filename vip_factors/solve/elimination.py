"""Eliminating a chain of variables stretch by stretch, so that only the result grows with its length."""

from collections.abc import Iterable, Iterator
from typing import Protocol

import gtsam
import numpy as np

from vip_factors.errors import SolveError
from vip_factors.geometry.rotations import Array


class LinearSystem(Protocol):
    """A linearisation that can be damped again and again without being made again."""

    def stretches(self, damping: float) -> Iterator[tuple[gtsam.GaussianFactorGraph, gtsam.Ordering]]:
        """Graphs and the keys to eliminate from each; a key appears in no stretch after its own."""
        ...


def eliminate(stretches: Iterable[tuple[gtsam.GaussianFactorGraph, gtsam.Ordering]]) -> gtsam.GaussianBayesNet:
    """Eliminate the stretches in order.

    Raises:
        SolveError: if a variable is not determined.
    """
    net, rest = gtsam.GaussianBayesNet(), gtsam.GaussianFactorGraph()
    for graph, ordering in stretches:
        rest.push_back(graph)
        part, rest = eliminate_part(rest, ordering)
        for index in range(part.size()):
            net.push_back(part.at(index))
    return net


def eliminate_part(
    graph: gtsam.GaussianFactorGraph, ordering: gtsam.Ordering
) -> tuple[gtsam.GaussianBayesNet, gtsam.GaussianFactorGraph]:
    """Conditionals of some variables, and what is left of the graph for all others.

    Raises:
        SolveError: if a variable is not determined.
    """
    try:
        net, rest = graph.eliminatePartialSequential(ordering)
    except RuntimeError as error:  # gtsam's IndeterminateSystemException arrives as this
        if "ndeterminate" not in str(error):
            raise
        raise SolveError("the linear system is not determined") from error
    return net, rest


def coupling_factor(first_key: int, second_key: int, block: Array) -> gtsam.HessianFactor:
    """A block off the diagonal: a factor without a diagonal, which only the sum with others makes definite."""
    rows, columns = block.shape
    zero, none = np.zeros((rows, rows)), np.zeros(rows)
    return gtsam.HessianFactor(
        first_key, second_key, zero, block, none, np.zeros((columns, columns)), np.zeros(columns), 0.0
    )
