"""The best choice of headings and mountings of all sensors together: exactly, by passing least costs along a tree."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from vip_factors.geometry.rotations import Array
from vip_factors.initialise.sensor_tree import Link

Choice = tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class TreeMinimum:
    """The minimum of a sum of costs over a tree (min-sum, Viterbi 1967).

    Attributes:
        cost: the least.
        choice: candidate ``(heading, mounting)`` of every sensor that has it.
        marginals: by sensor ``(K, M)``, the least cost with each of its candidates, the others at their best.
    """

    cost: float
    choice: Choice
    marginals: tuple[Array, ...]


def least_cost(unary: Sequence[Array], links: Sequence[Link], pairs: Mapping[int, Array]) -> TreeMinimum:
    """The minimum of costs of sensors ``(K, M)`` each, and of links, by the child's number, ``(K, M, K, M)``.

    Links come parents first, and make one tree of all sensors. Where costs of sensors are ``(C, K, M)``, for ``C``
    suppositions, it is the least of them all, and so are the marginals.
    """
    whole = [cost.reshape(-1, *cost.shape[-2:]).astype(float) for cost in unary]
    chosen: dict[int, Array] = {}
    told: dict[int, Array] = {}
    for link in reversed(links):
        total = pairs[link.child] + whole[link.child][:, None, None]
        flat = total.reshape(*total.shape[:3], -1)
        chosen[link.child], told[link.child] = flat.argmin(axis=-1), flat.min(axis=-1)
        whole[link.parent] = whole[link.parent] + told[link.child]
    root = links[0].parent if links else 0
    least = whole[root].min(axis=(1, 2))
    best = int(least.argmin())
    marginals, choice = list(whole), [(0, 0)] * len(whole)
    choice[root] = _index(int(whole[root][best].argmin()), whole[root])
    for link in links:
        choice[link.child] = _index(int(chosen[link.child][(best, *choice[link.parent])]), whole[link.child])
        others = marginals[link.parent] - told[link.child]
        marginals[link.child] = whole[link.child] + (pairs[link.child] + others[..., None, None]).min(axis=(1, 2))
    return TreeMinimum(float(least[best]), tuple(choice), tuple(cost.min(axis=0) for cost in marginals))


def _index(flat: int, cost: Array) -> tuple[int, int]:
    heading, mounting = divmod(flat, cost.shape[-1])
    return heading, mounting
