"""How sure: marginal covariances of all variables of a chain.

The covariance recursion of a smoother, run backwards over the Bayes net, is what one would write first; along an
accelerometer's double integration it loses all digits within a few dozen frames. GTSAM's Bayes tree eliminates its way
to each marginal instead, and stays exact.
"""

import gtsam

from vip_factors.errors import SolveError
from vip_factors.geometry.rotations import Array
from vip_factors.solve.chain import LinearSystem


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
