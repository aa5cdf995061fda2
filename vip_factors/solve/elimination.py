"""Eliminating a chain of variables stretch by stretch, so that only the result grows with its length."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Protocol

import gtsam
import numpy as np
from scipy.linalg import solve_triangular

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


def last_marginals(system: LinearSystem, keys: Sequence[int]) -> dict[int, Array]:
    """Marginal covariances of the variables that are eliminated last: of what all frames share, at no further cost.

    Raises:
        SolveError: if a variable is not determined.
    """
    covariance, places = _last_covariance(system, keys)
    return {key: np.array(covariance[own, own], dtype=float) for key, own in places.items()}


def last_covariance(system: LinearSystem, keys: Sequence[int]) -> Array:
    """Joint covariance ``(n, n)`` of the variables that are eliminated last, side by side in the order of ``keys``.

    Raises:
        SolveError: if a variable is not determined.
    """
    covariance, places = _last_covariance(system, keys)
    columns = np.concatenate([np.zeros(0, int), *(np.arange(places[key].start, places[key].stop) for key in keys)])
    return np.array(covariance[np.ix_(columns, columns)], dtype=float)


def _last_covariance(system: LinearSystem, keys: Sequence[int]) -> tuple[Array, dict[int, slice]]:
    """Of all that are eliminated last, and where in it each is."""
    net, tail = eliminate(system.stretches(0.0)), gtsam.GaussianBayesNet()
    for index in range(net.size()):
        if net.at(index).keys()[0] in set(keys):
            tail.push_back(net.at(index))
    R, _ = tail.matrix()
    if not np.all(np.abs(np.diag(R)) > 0):
        raise SolveError("covariance: the problem does not determine all of its variables")
    places, start = dict[int, slice](), 0
    for index in range(tail.size()):
        block = slice(start, start + len(tail.at(index).R()))
        places[int(tail.at(index).keys()[0])] = block
        start = block.stop
    if set(places) != set(keys):
        raise SolveError("covariance: the variables asked for are not the last ones")
    inverse = solve_triangular(R, np.eye(len(R)), check_finite=False)  # inverting R.T @ R would lose twice the digits
    return np.asarray(inverse @ inverse.T, dtype=float), places


def chain_marginals(system: LinearSystem) -> dict[int, Array]:
    """Marginal covariance of every variable, by key, of the undamped linearisation at a solution.

    Raises:
        SolveError: if a variable is not determined.
    """
    graph, ordering = gtsam.GaussianFactorGraph(), gtsam.Ordering()
    for part, keys in system.stretches(0.0):
        graph.push_back(part)
        for index in range(keys.size()):
            ordering.push_back(keys.at(index))
    try:
        tree = graph.eliminateMultifrontal(ordering)
        return {ordering.at(index): tree.marginalCovariance(ordering.at(index)) for index in range(ordering.size())}
    except RuntimeError as error:
        raise SolveError("covariance: the problem does not determine all of its variables") from error
