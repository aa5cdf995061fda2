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

    Links come parents first, and make one tree of all sensors.
    """
    whole = [cost.astype(float) for cost in unary]
    chosen: dict[int, Array] = {}
    told: dict[int, Array] = {}
    for link in reversed(links):
        total = pairs[link.child] + whole[link.child]
        flat = total.reshape(*total.shape[:2], -1)
        chosen[link.child], told[link.child] = flat.argmin(axis=-1), flat.min(axis=-1)
        whole[link.parent] = whole[link.parent] + told[link.child]
    root = links[0].parent if links else 0
    marginals, choice = list(whole), [(0, 0)] * len(whole)
    choice[root] = _index(int(whole[root].argmin()), whole[root])
    for link in links:
        choice[link.child] = _index(int(chosen[link.child][choice[link.parent]]), whole[link.child])
        others = marginals[link.parent] - told[link.child]
        marginals[link.child] = whole[link.child] + (pairs[link.child] + others[..., None, None]).min(axis=(0, 1))
    return TreeMinimum(float(whole[root].min()), tuple(choice), tuple(marginals))


def _index(flat: int, cost: Array) -> tuple[int, int]:
    heading, mounting = divmod(flat, cost.shape[1])
    return heading, mounting
