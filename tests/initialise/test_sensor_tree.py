"""The search over a tree of sensors against every choice tried in turn."""

from itertools import product

import numpy as np

from vip_factors.initialise.sensor_tree import Link, least_cost


def link(parent: int, child: int) -> Link:
    none = np.zeros(3)
    return Link(parent, child, none, none, none, np.eye(3), 1, None, None)


def test_the_minimum_is_that_of_all_choices() -> None:
    rng = np.random.default_rng(3)
    links = (link(0, 1), link(0, 2), link(2, 3))
    mountings = (1, 2, 1, 3)
    unary = [rng.random((4, count)) for count in mountings]
    pairs = {link.child: rng.random((*unary[link.parent].shape, *unary[link.child].shape)) for link in links}
    states = [list(np.ndindex(cost.shape)) for cost in unary]
    every = {
        choice: sum(cost[own] for cost, own in zip(unary, choice, strict=True))
        + sum(pairs[link.child][choice[link.parent] + choice[link.child]] for link in links)
        for choice in product(*states)
    }
    found = least_cost(unary, links, pairs)
    assert np.isclose(found.cost, min(every.values()))
    assert found.choice == min(every, key=lambda choice: every[choice])
    for s, marginals in enumerate(found.marginals):
        for own in states[s]:
            assert np.isclose(marginals[own], min(cost for choice, cost in every.items() if choice[s] == own))


def test_one_sensor_has_no_links() -> None:
    found = least_cost([np.array([[2.0], [1.0]])], (), {})
    assert found.cost == 1.0
    assert found.choice == ((1, 0),)
