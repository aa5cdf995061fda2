"""Fixed-lag smoother of several chains with common columns: people who share only the camera that films them.

Joint elimination would couple all people through the camera's pose. Here each chain is eliminated separately. At each
frame it receives the other chains' marginals on the common columns and keeps the marginal over these and its private
columns. Correlations between private columns of two chains are dropped at each frame: the projection of Boyen and
Koller (1998, Tractable inference for complex stochastic processes) onto a thin junction tree (Paskin 2003). No
information is counted twice, and the cost is linear in the number of chains. The result is exact for a single chain
and for chains without common columns.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from vip_factors.geometry.rotations import Array
from vip_factors.solve.elimination import eliminate, reordered
from vip_factors.solve.fixed_lag import FixedLagChain, LagSolution

Quadratic = tuple[Array, Array]  # H (upper triangle) and v of ½ xᵀ H x − vᵀ x
WEAK_INFORMATION = 1e-4  # 1/rad² or 1/m²: makes later frames, which have no measurements yet, solvable


@dataclass(frozen=True)
class Columns:
    """Columns of one chain: ``(w,)`` in the vector of a frame and ``(s,)`` in the vector of shared variables.

    ``far`` are the indices in ``frame`` that factors connect with the frame two before it; None for all.
    """

    frame: np.ndarray
    static: np.ndarray
    far: np.ndarray | None = None


class JoinedChains:
    """Chains that are eliminated frame by frame, each separately.

    Args:
        columns: of each chain, its common columns last; then the common columns alone. A single chain has one entry.
    """

    def __init__(self, columns: Sequence[Columns]) -> None:
        self._columns = columns[:-1] or columns
        self._chains = [
            FixedLagChain(len(chain_columns.frame), len(chain_columns.static), chain_columns.far)
            for chain_columns in self._columns
        ]
        self._common = columns[-1] if len(columns) > 1 else Columns(np.zeros(0, int), np.zeros(0, int))
        self._orders = dict[tuple[int, int], tuple[np.ndarray, int]]()  # by chain and width of a slice
        self._common_chain = FixedLagChain(len(self._common.frame), len(self._common.static), self._common.far)

    def eliminate(self, number: int, slices: Sequence[Quadratic], sigmas: Array | None = None) -> None:
        """Eliminate a frame; see :meth:`FixedLagChain.eliminate`.

        Args:
            number: of the frame.
            slices: quadratics of each chain, then that of the common columns alone; all are overwritten.
            sigmas: ``(s,)`` of the shared columns' process noise after the frame.

        Raises:
            SolveError: if a variable is not determined, or if the number does not follow the lag.
        """
        steps = [None if sigmas is None else sigmas[c.static] for c in (*self._columns, self._common)]
        if not len(self._common.frame) + len(self._common.static):
            for chain, quadratic, step in zip(self._chains, slices, steps, strict=False):
                chain.eliminate(number, *quadratic, step)
            return
        *chain_slices, (information, vector) = slices
        upper = _upper(len(vector))
        messages = [self._message(k, number, *quadratic) for k, quadratic in enumerate(chain_slices)]
        news = np.concatenate([information[upper], vector])  # this frame's own information
        self._common_chain.begin(number, information, vector)
        common_marginal = np.concatenate([information[upper], vector])
        total = common_marginal + sum(message for message, _ in messages) - len(messages) * (common_marginal - news)
        for chain, (H, v), (message, common), step in zip(self._chains, chain_slices, messages, steps, strict=False):
            others_message = total - message
            H[common[upper[0]], common[upper[1]]] += others_message[: -len(common)]
            v[common] += others_message[-len(common) :]
            chain.end(number, H, v, chain.width - len(self._common.frame), step)
        information[upper], vector[:] = total[: -len(vector)], total[-len(vector) :]
        self._common_chain.end(number, information, vector, 0, steps[-1])

    def _message(self, k: int, number: int, information: Array, vector: Array) -> tuple[Array, np.ndarray]:
        """Eliminate a chain's private columns of a frame; returns its marginal on the common columns, and their places.

        The marginal is packed: upper triangle of the information, then the vector.
        """
        chain, common = self._chains[k], self._common
        chain.begin(number, information, vector)
        private_width = chain.width - len(common.frame)
        eliminate(information, vector, 0, private_width)
        key = k, len(vector)
        if key not in self._orders:
            self._orders[key] = _private_first(chain, len(vector), len(common.frame), len(common.static))
        order, count = self._orders[key]
        H, v = reordered(information, vector, order)
        H[np.arange(count), np.arange(count)] += WEAK_INFORMATION
        eliminate(H, v, 0, count)
        common_columns = order[count:]
        return np.concatenate([H[count:, count:][_upper(len(common_columns))], v[count:]]), common_columns

    def marginalise_before(self, number: int) -> None:
        """Marginalise the frames with a smaller number."""
        for chain in (*self._chains, self._common_chain):
            chain.marginalise_before(number)

    def solution(self) -> "JoinedSolution":
        """Solve for all variables of the lag.

        Raises:
            SolveError: if the shared columns are not determined.
        """
        return JoinedSolution(self._columns, [chain.solution() for chain in self._chains])


class JoinedSolution:
    """Values and covariances of the lag.

    Common columns of earlier frames are the mean over the chains. Covariances between private columns of two chains are
    set to zero.

    Attributes:
        values: ``(T, w)`` of the frames.
        shared: ``(s,)``, shared columns after the newest frame.
    """

    def __init__(self, columns: Sequence[Columns], solutions: Sequence[LagSolution]) -> None:
        self._columns, self._solutions = columns, solutions
        self.shared = _mean([c.static for c in columns], [solution.shared for solution in solutions])
        self.values = _mean([solution.frame for solution in columns], [solution.values for solution in solutions])

    @property
    def frames(self) -> dict[int, Array]:
        """Values ``(w,)`` by frame number."""
        return dict(zip(self._solutions[0].frames, self.values, strict=True))

    def shared_covariance(self) -> Array:
        """Marginal covariance ``(s, s)`` of the shared columns after the newest frame."""
        blocks = [solution.shared_covariance() for solution in self._solutions]
        return _joint_covariance([chain_columns.static for chain_columns in self._columns], blocks)

    def covariance(self, number: int) -> Array:
        """Marginal covariance ``(w, w)`` of a frame; the cost grows with the number of later frames."""
        blocks = [solution.covariance(number) for solution in self._solutions]
        return _joint_covariance([chain_columns.frame for chain_columns in self._columns], blocks)

    def covariance_in_steps(self, number: int) -> Iterator[Array | None]:
        """Compute :meth:`covariance` in steps, one for each frame from there on; yields None until the last one."""
        for steps in zip(*(solution.covariance_in_steps(number) for solution in self._solutions), strict=True):
            blocks = [block for block in steps if block is not None]
            yield (
                _joint_covariance([chain_columns.frame for chain_columns in self._columns], blocks) if blocks else None
            )


def _private_first(chain: FixedLagChain, n: int, common: int, common_static: int) -> tuple[np.ndarray, int]:
    """Order a slice's ``n`` columns: remaining private ones, then common ones; also returns the former's number."""
    frames, every = n - chain.static, np.arange(chain.width)
    is_common = np.concatenate([every, every, chain.far])[:frames] >= chain.width - common
    is_common = np.concatenate([is_common, np.arange(chain.static) >= chain.static - common_static])
    private = np.flatnonzero(~is_common)[chain.width - common :]
    return np.concatenate([private, np.flatnonzero(is_common)]), len(private)


_upper = cache(np.triu_indices)


def _mean(columns: Sequence[np.ndarray], values: Sequence[Array]) -> Array:
    if len(columns) == 1:
        return values[0]
    count = np.bincount(np.concatenate(columns))
    total = np.zeros((*values[0].shape[:-1], len(count)))
    for indices, value in zip(columns, values, strict=True):
        total[..., indices] += value
    return total / count


def _joint_covariance(columns: Sequence[np.ndarray], blocks: Sequence[Array]) -> Array:
    if len(columns) == 1:
        return blocks[0]
    size = 1 + max((int(indices.max()) for indices in columns if len(indices)), default=-1)
    joint = np.zeros((size, size))
    for indices, block in zip(columns, blocks, strict=True):
        joint[np.ix_(indices, indices)] = block
    return joint


def marginal(information: Array, columns: np.ndarray) -> Array:
    """Marginal information of some columns of ``(n, n)``; other columns may have none at all."""
    rest_columns = np.setdiff1d(np.flatnonzero(np.diag(information)), columns)
    coupling = information[np.ix_(columns, rest_columns)]
    between = np.linalg.solve(information[np.ix_(rest_columns, rest_columns)], coupling.T)
    return information[np.ix_(columns, columns)] - coupling @ between
