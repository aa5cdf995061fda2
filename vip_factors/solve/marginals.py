"""How sure: marginal covariances of all variables of a chain.

The covariance recursion of a smoother, run backwards over the Bayes net, is what one would write first; along an
accelerometer's double integration it loses all digits within a few dozen frames. GTSAM's Bayes tree eliminates its way
to each marginal instead, and stays exact.
"""

from collections.abc import Sequence

import gtsam
import numpy as np
from scipy.linalg import solve_triangular

from vip_factors.errors import SolveError
from vip_factors.geometry.rotations import Array
from vip_factors.solve.chain import LinearSystem, eliminate


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
