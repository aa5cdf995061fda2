"""How sure: marginal covariances of a chain of variables, in one backward sweep over its Bayes net.

GTSAM's own ``marginalCovariance`` walks from a clique to the root of the tree each time; along a chain of thousands
of frames that is quadratic. The sweep below visits every conditional once.
"""

import numpy as np

from vip_factors.errors import SolveError
from vip_factors.geometry.rotations import Array
from vip_factors.solve.chain import LinearSystem, eliminate


def chain_marginals(system: LinearSystem) -> dict[int, Array]:
    """Marginal covariance of every variable, by key.

    Args:
        system: the linearisation at the solution, eliminated along the chain, what is shared by all last: the
            parents of each conditional must be among the next conditional's variables.

    A conditional says ``R x = d − S y`` with unit noise, so ``cov(x, y) = −R⁻¹ S cov(y)`` and
    ``cov(x) = R⁻¹ (I + S cov(y) Sᵀ) R⁻ᵀ``.

    Raises:
        SolveError: if a variable is not determined, or the ordering is not along a chain.
    """
    net = eliminate(system.stretches(0.0))
    marginals: dict[int, Array] = {}
    active: dict[int, slice] = {}
    joint = np.zeros((0, 0))
    for index in reversed(range(net.size())):
        conditional = net.at(index)
        key, *parents = conditional.keys()
        if not set(parents) <= set(active):
            raise SolveError("covariance: the ordering does not follow a chain")
        chosen = np.concatenate([np.arange(active[p].start, active[p].stop) for p in parents] or [np.zeros(0, int)])
        above = joint[np.ix_(chosen, chosen)]
        gain = -np.linalg.solve(conditional.R(), np.hstack([conditional.S(), np.eye(len(conditional.R()))]))
        by_parents, root = gain[:, : len(chosen)], gain[:, len(chosen) :]
        cross = by_parents @ above
        own = root @ root.T + cross @ by_parents.T
        joint = np.block([[own, cross], [cross.T, above]])
        marginals[key] = own
        active, start = {}, 0
        for one, width in [(key, len(own)), *((p, _width(p, marginals)) for p in parents)]:
            active[one] = slice(start, start + width)
            start += width
    return marginals


def _width(key: int, marginals: dict[int, Array]) -> int:
    return len(marginals[key])
