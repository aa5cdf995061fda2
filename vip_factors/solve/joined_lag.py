"""A fixed lag of chains that meet in a few columns: people who have nothing in common but the camera that films them.

Eliminated as one, what is left behind a frame ties everything to everything: whoever is seen in it, by the camera's
pose there. Here each chain keeps to itself. With each frame it hears what the others say of the columns that all have
in common, and goes on with the marginal over these and its own. That the own columns of two chains depend on each other
beyond what they have in common is dropped at each frame: the projection of Boyen and Koller (1998, Tractable inference
for complex stochastic processes), onto a junction tree as thin as Paskin's (2003). Marginals stay those of one
distribution, so nothing is counted twice; the cost is linear in chains. Nothing is dropped, and the answer is exact,
where frames have no columns in common, and of a single chain.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from vip_factors.geometry.rotations import Array
from vip_factors.solve.elimination import eliminate, reordered
from vip_factors.solve.fixed_lag import FixedLagChain, LagSolution

Quadratic = tuple[Array, Array]  # information and vector of ½ xᵀ H x − vᵀ x; of H what lies on and above the diagonal
BARELY = 1e-4  # information, in 1/rad² or 1/m²: frames ahead are not determined by what is known so far


@dataclass(frozen=True)
class Columns:
    """Of one chain: its columns ``(w,)`` in the vector of a frame, and ``(s,)`` in that of what all frames share.

    Of the former the frame two before sees those at ``far``; None for all. It sees the same common ones of all chains.
    """

    frame: np.ndarray
    static: np.ndarray
    far: np.ndarray | None = None


class JoinedChains:
    """Chains that are eliminated frame by frame, each by itself.

    Args:
        columns: of each chain, those that all have in common being their last ones; and, behind them, the common ones
            alone. Of a single chain only its own.
    """

    def __init__(self, columns: Sequence[Columns]) -> None:
        self._columns = columns[:-1] or columns
        self._chains = [FixedLagChain(len(one.frame), len(one.static), one.far) for one in self._columns]
        self._common = columns[-1] if len(columns) > 1 else Columns(np.zeros(0, int), np.zeros(0, int))
        self._orders = dict[tuple[int, int], tuple[np.ndarray, int]]()  # by chain and width of a slice
        self._meeting = FixedLagChain(len(self._common.frame), len(self._common.static), self._common.far)

    def eliminate(self, number: int, slices: Sequence[Quadratic], sigmas: Array | None = None) -> None:
        """Put in a frame, as :meth:`FixedLagChain.eliminate` does.

        Args:
            number: of the frame.
            slices: of each chain, and of what is known of common columns alone; all are changed.
            sigmas: ``(s,)`` by which what all frames share wanders behind the frame.

        Raises:
            SolveError: if a variable is not determined, or for a number that does not follow.
        """
        steps = [None if sigmas is None else sigmas[one.static] for one in (*self._columns, self._common)]
        if not len(self._common.frame) + len(self._common.static):
            for chain, one, step in zip(self._chains, slices, steps, strict=False):
                chain.eliminate(number, *one, step)
            return
        *own, (information, vector) = slices
        upper = _upper(len(vector))
        heard = [self._heard(at, number, *one) for at, one in enumerate(own)]
        news = np.concatenate([information[upper], vector])  # not known before
        self._meeting.begin(number, information, vector)
        known = np.concatenate([information[upper], vector])
        total = known + sum(said for said, _ in heard) - len(heard) * (known - news)
        for chain, (H, v), (said, common), step in zip(self._chains, own, heard, steps, strict=False):
            of_others = total - said
            H[common[upper[0]], common[upper[1]]] += of_others[: -len(common)]
            v[common] += of_others[-len(common) :]
            chain.end(number, H, v, chain.width - len(self._common.frame), step)
        information[upper], vector[:] = total[: -len(vector)], total[-len(vector) :]
        self._meeting.end(number, information, vector, 0, steps[-1])

    def _heard(self, at: int, number: int, information: Array, vector: Array) -> tuple[Array, np.ndarray]:
        """What a chain says of the common columns, and where these are; its own of the frame are eliminated.

        It is said as what lies on and above the diagonal, and the vector behind that.
        """
        chain, common = self._chains[at], self._common
        chain.begin(number, information, vector)
        own = chain.width - len(common.frame)
        eliminate(information, vector, 0, own)
        key = at, len(vector)
        if key not in self._orders:
            self._orders[key] = _own_first(chain, len(vector), len(common.frame), len(common.static))
        order, count = self._orders[key]
        H, v = reordered(information, vector, order)
        H[np.arange(count), np.arange(count)] += BARELY
        eliminate(H, v, 0, count)
        common_columns = order[count:]
        return np.concatenate([H[count:, count:][_upper(len(common_columns))], v[count:]]), common_columns

    def marginalise_before(self, number: int) -> None:
        """Marginalise the frames with a smaller number: what is known from them stays."""
        for chain in (*self._chains, self._meeting):
            chain.marginalise_before(number)

    def solution(self) -> "JoinedSolution":
        """All variables of the lag.

        Raises:
            SolveError: if what the newest frame shares with those to come is not determined.
        """
        return JoinedSolution(self._columns, [chain.solution() for chain in self._chains])


class JoinedSolution:
    """The minimum over the lag, and how sure it is.

    Common columns of frames before the newest one are the mean of what the chains say. Between own columns of two
    chains no covariances are known: they are zero.

    Attributes:
        values: ``(T, w)`` of the frames.
        shared: ``(s,)``, what the newest frame shares with those to come.
    """

    def __init__(self, columns: Sequence[Columns], solutions: Sequence[LagSolution]) -> None:
        self._columns, self._solutions = columns, solutions
        self.shared = _mean([one.static for one in columns], [one.shared for one in solutions])
        self.values = _mean([one.frame for one in columns], [one.values for one in solutions])

    @property
    def frames(self) -> dict[int, Array]:
        """The values by a frame's number."""
        return dict(zip(self._solutions[0].frames, self.values, strict=True))

    def shared_covariance(self) -> Array:
        """Marginal covariance ``(s, s)`` of what the newest frame shares with those to come."""
        blocks = [one.shared_covariance() for one in self._solutions]
        return _placed([one.static for one in self._columns], blocks)

    def covariance(self, number: int) -> Array:
        """Marginal covariance ``(w, w)`` of a frame; the later it is, the less it costs."""
        blocks = [one.covariance(number) for one in self._solutions]
        return _placed([one.frame for one in self._columns], blocks)

    def covariance_in_steps(self, number: int) -> Iterator[Array | None]:
        """The same in as many steps as there are frames from there on, and one; None until the last one."""
        for steps in zip(*(one.covariance_in_steps(number) for one in self._solutions), strict=True):
            blocks = [one for one in steps if one is not None]
            yield _placed([one.frame for one in self._columns], blocks) if blocks else None


def _own_first(chain: FixedLagChain, n: int, common: int, common_static: int) -> tuple[np.ndarray, int]:
    """Columns of a slice of ``n`` whose first own ones are eliminated: the own ones that are left, then the common
    ones; and how many are own."""
    frames, every = n - chain.static, np.arange(chain.width)
    is_common = np.concatenate([every, every, chain.far])[:frames] >= chain.width - common
    is_common = np.concatenate([is_common, np.arange(chain.static) >= chain.static - common_static])
    own = np.flatnonzero(~is_common)[chain.width - common :]
    return np.concatenate([own, np.flatnonzero(is_common)]), len(own)


_upper = cache(np.triu_indices)


def _mean(columns: Sequence[np.ndarray], values: Sequence[Array]) -> Array:
    if len(columns) == 1:
        return values[0]
    count = np.bincount(np.concatenate(columns))
    total = np.zeros((*values[0].shape[:-1], len(count)))
    for own, value in zip(columns, values, strict=True):
        total[..., own] += value
    return total / count


def _placed(columns: Sequence[np.ndarray], blocks: Sequence[Array]) -> Array:
    if len(columns) == 1:
        return blocks[0]
    size = 1 + max((int(one.max()) for one in columns if len(one)), default=-1)
    whole = np.zeros((size, size))
    for own, block in zip(columns, blocks, strict=True):
        whole[np.ix_(own, own)] = block
    return whole


def marginal(information: Array, columns: np.ndarray) -> Array:
    """What information ``(n, n)``, of which some may be none at all, says of some columns once all others are gone."""
    others = np.setdiff1d(np.flatnonzero(np.diag(information)), columns)
    coupling = information[np.ix_(columns, others)]
    between = np.linalg.solve(information[np.ix_(others, others)], coupling.T)
    return information[np.ix_(columns, columns)] - coupling @ between
