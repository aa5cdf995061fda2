"""Who is who in some successive video frames, decided jointly: one path for each wearer, no person taken twice."""

from itertools import islice, permutations

import numpy as np

from vip_factors.geometry.rotations import Array

IMPOSSIBLE = 1e6
MOST_ORDERS = 6  # of wearers to be tried where two want the same person: all of three


def best_paths(gain: Array, jump: Array, blink: float) -> np.ndarray:
    """The person ``(F, W)`` who is each wearer, −1 for nobody.

    Every wearer's best path is found on its own (Viterbi). Where two want the same person, they choose in turn, in the
    order that costs least.

    Args:
        gain: ``(F, W, N)`` of taking a person over taking nobody; very negative where that is not allowed.
        jump: ``(F − 1, N, N)`` lost with a step from one person to one of the next frame.
        blink: lost with a step from a person to nobody or back.
    """
    F, W, N = gain.shape
    cost = np.concatenate([-gain, np.zeros((F, W, 1))], axis=2)
    step = _steps(jump, blink)
    path, _ = _viterbi(cost, step)
    if not _conflicts(path, N):
        return np.where(path < N, path, -1)
    best, least = path, np.inf
    for order in islice(permutations(range(W)), MOST_ORDERS):
        tried, total = _in_turn(cost, step, order)
        if total < least:
            best, least = tried, total
    return np.where(best < N, best, -1)


def _steps(jump: Array, blink: float) -> Array:
    """Cost ``(F − 1, N + 1, N + 1)`` of the step from a state to one of the next frame; the last is nobody."""
    steps, N, _ = jump.shape
    step = np.full((steps, N + 1, N + 1), blink)
    step[:, :N, :N] = jump
    step[:, N, N] = 0.0
    return step


def _viterbi(cost: Array, step: Array) -> tuple[np.ndarray, Array]:
    """Cheapest paths ``(F, W)`` through states of cost ``(F, W, S)``, and what each costs ``(W,)``."""
    F, W, _ = cost.shape
    total, back = cost[0], []
    for f in range(1, F):
        way = total[:, :, None] + step[f - 1]
        back.append(way.argmin(axis=1))
        total = way.min(axis=1) + cost[f]
    path, rows = np.empty((F, W), int), np.arange(W)
    path[-1] = total.argmin(axis=1)
    for f in range(F - 1, 0, -1):
        path[f - 1] = back[f - 1][rows, path[f]]
    return path, total.min(axis=1)


def _conflicts(path: np.ndarray, nobody: int) -> bool:
    ordered = np.sort(path, axis=1)
    return bool(np.any((ordered[:, 1:] == ordered[:, :-1]) & (ordered[:, 1:] < nobody)))


def _in_turn(cost: Array, step: Array, order: tuple[int, ...]) -> tuple[np.ndarray, float]:
    free, total = cost.copy(), 0.0
    path = np.empty(cost.shape[:2], int)
    frames = np.arange(len(cost))
    for w in order:
        one, price = _viterbi(free[:, w : w + 1], step)
        path[:, w], total = one[:, 0], total + float(price[0])
        taken = path[:, w] < cost.shape[2] - 1
        free[frames[taken], :, path[taken, w]] = IMPOSSIBLE
    return path, total
