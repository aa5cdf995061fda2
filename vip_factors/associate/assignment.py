"""The binary linear program that chooses hypotheses (thesis eqs. 4.11–4.12), for HiGHS.

Products of two choices become auxiliary variables. They may be continuous: with binary choices the constraints leave
them only 0 or 1. A wearer is seen once per frame, so all products of one hypothesis with another frame's hypotheses
of a wearer add up to at most 1: constraints summed in this way describe the same program and relax it less.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

from vip_factors.errors import SolveError
from vip_factors.geometry.rotations import Array

SECONDS_PER_WINDOW = 20.0  # what HiGHS may take for one; the best found until then is used
RELATIVE_GAP = 1e-4


@dataclass(frozen=True)
class AssignmentProblem:
    """Choices among ``H`` hypotheses with ``E`` edges between them; costs are minimised.

    Attributes:
        frame, wearer, detection: ``(H,)``: at most one choice per wearer and frame, and per detection.
        cost, edge_cost: ``(H,)`` of choosing each, ``(E,)`` of choosing both.
        edges: ``(E, 2)`` rows of hypotheses, none of which exclude each other.
    """

    frame: np.ndarray
    wearer: np.ndarray
    detection: np.ndarray
    cost: Array
    edges: np.ndarray
    edge_cost: Array

    def value(self, chosen: np.ndarray) -> float:
        """The objective of a choice ``(H,)``."""
        both = chosen[self.edges[:, 0]] & chosen[self.edges[:, 1]]
        return float(self.cost[chosen].sum() + self.edge_cost[both].sum())

    def restricted_to(self, rows: np.ndarray) -> "AssignmentProblem":
        """The problem of some hypotheses (rows, increasing) and the edges within them."""
        new = np.full(len(self.cost), -1)
        new[rows] = np.arange(len(rows))
        inside = np.all(new[self.edges] >= 0, axis=1)
        return AssignmentProblem(
            self.frame[rows], self.wearer[rows], self.detection[rows], self.cost[rows], new[self.edges[inside]],
            self.edge_cost[inside],
        )  # fmt: skip


def solve(problem: AssignmentProblem) -> np.ndarray:
    """The best choice ``(H,)``, of every connected part on its own.

    Raises:
        SolveError: if HiGHS finds no solution (choosing nothing always is one).
    """
    chosen = np.zeros(len(problem.cost), bool)
    hopeful = np.flatnonzero(_may_pay(problem))
    rest = problem.restricted_to(hopeful)
    for rows in _components(rest):
        chosen[hopeful[rows]] = _solve_connected(rest.restricted_to(rows))
    return chosen


def solve_in_windows(
    problem: AssignmentProblem, window: int, overlap: int, progress: Callable[[float], None] | None = None
) -> np.ndarray:
    """The choice ``(H,)`` from overlapping windows of video frames, so that a recording's length does not matter.

    Each window decides all its frames but keeps only those before its overlap with the next, into which the longest
    edge should fit; earlier decisions stand, and edges to them count. ``progress`` is told the fraction done.
    """
    chosen = np.zeros(len(problem.cost), bool)
    if len(chosen) == 0:
        return chosen
    order_frame, last = problem.frame, int(problem.frame.max())
    a, b = problem.edges.T
    start = int(problem.frame.min())
    while start <= last:
        end = start + window
        if last < end + overlap // 2:
            end = last + 1
        keep_until = end if end > last else end - overlap
        free = (order_frame >= start) & (order_frame < end)
        cost = problem.cost.copy()
        np.add.at(cost, a, np.where(chosen[b] & ~free[b], problem.edge_cost, 0.0))
        np.add.at(cost, b, np.where(chosen[a] & ~free[a], problem.edge_cost, 0.0))
        rows = np.flatnonzero(free)
        of_window = AssignmentProblem(
            problem.frame, problem.wearer, problem.detection, cost, problem.edges, problem.edge_cost
        ).restricted_to(rows)
        best = solve(of_window)
        kept = problem.frame[rows] < keep_until
        chosen[rows[kept]] = best[kept]
        start = keep_until
        if progress is not None:
            progress(min(1.0, (start - int(problem.frame.min())) / max(last + 1 - int(problem.frame.min()), 1)))
    return chosen


def _may_pay(problem: AssignmentProblem) -> np.ndarray:
    """Which hypotheses ``(H,)`` could be chosen in a best solution: those that could lower the cost at all."""
    alive = np.ones(len(problem.cost), bool)
    a, b = problem.edges.T
    helpful = np.minimum(problem.edge_cost, 0.0)
    while True:
        there = alive[a] & alive[b]
        gain = np.bincount(a[there], helpful[there], len(alive)) + np.bincount(b[there], helpful[there], len(alive))
        now = alive & (problem.cost + gain < 0)
        if np.array_equal(now, alive):
            return alive
        alive = now


def _exclusive_groups(problem: AssignmentProblem) -> list[np.ndarray]:
    """Group number ``(H,)`` of each hypothesis, twice: one choice per wearer and frame, one per detection."""
    by_wearer = problem.frame * (int(problem.wearer.max(initial=0)) + 1) + problem.wearer
    return [np.unique(key, return_inverse=True)[1] for key in (by_wearer, problem.detection)]


def _components(problem: AssignmentProblem) -> list[np.ndarray]:
    """Rows of the hypotheses of each connected part."""
    H = len(problem.cost)
    if H == 0:
        return []
    links = [problem.edges]
    offset, groups = H, _exclusive_groups(problem)
    for group in groups:  # a node for every group joins its members
        links.append(np.stack([np.arange(H), group + offset], axis=1))
        offset += int(group.max()) + 1
    i, j = np.concatenate(links).T
    _, label = connected_components(csr_array((np.ones(len(i)), (i, j)), shape=(offset, offset)), directed=False)
    order = np.argsort(label[:H], kind="stable")
    return [rows for rows in np.split(order, np.flatnonzero(np.diff(label[:H][order])) + 1) if len(rows)]


def _solve_connected(problem: AssignmentProblem) -> np.ndarray:
    H, E = len(problem.cost), len(problem.edges)
    if H == 1:
        return problem.cost < 0
    result = milp(
        np.concatenate([problem.cost, problem.edge_cost]),
        constraints=_constraints(problem),
        integrality=np.concatenate([np.ones(H), np.zeros(E)]),
        bounds=Bounds(0, 1),
        options={"time_limit": SECONDS_PER_WINDOW, "mip_rel_gap": RELATIVE_GAP},
    )
    if result.x is None:
        raise SolveError(f"the association's binary program of {H} hypotheses was not solved: {result.message}")
    return result.x[:H] > 0.5


def _constraints(problem: AssignmentProblem) -> LinearConstraint:
    H, E = len(problem.cost), len(problem.edges)
    rows = _Rows(H + E)
    wearer_frame, detection = _exclusive_groups(problem)
    for group in (wearer_frame, detection):
        shared = np.bincount(group)[group] > 1
        rows.add(group[shared], np.flatnonzero(shared), np.ones(int(shared.sum())), 1.0)
    edge = np.arange(E)
    for near, far in (problem.edges.T, problem.edges.T[::-1]):
        # all products of one choice with a wearer in another frame: at most that choice
        key = np.unique(near * (int(wearer_frame.max(initial=0)) + 1) + wearer_frame[far], return_inverse=True)[1]
        first = np.unique(key, return_index=True)[1]
        rows.add(
            np.concatenate([key, np.arange(len(first))]), np.concatenate([H + edge, near[first]]),
            np.concatenate([np.ones(E), -np.ones(len(first))]), 0.0,
        )  # fmt: skip
    dear = np.flatnonzero(problem.edge_cost > 0)
    for near, far in (problem.edges[dear].T, problem.edges[dear].T[::-1]):
        # a choice and one of a wearer in another frame: their product, which nobody would choose without
        key = np.unique(near * (int(wearer_frame.max(initial=0)) + 1) + wearer_frame[far], return_inverse=True)[1]
        first, ones = np.unique(key, return_index=True)[1], np.ones(len(dear))
        rows.add(
            np.concatenate([np.arange(len(first)), key, key]), np.concatenate([near[first], far, H + dear]),
            np.concatenate([np.ones(len(first)), ones, -ones]), 1.0,
        )  # fmt: skip
    return rows.constraint()


class _Rows:
    """Inequalities ``A x ≤ b``, gathered in blocks."""

    def __init__(self, columns: int) -> None:
        self.columns, self.count = columns, 0
        self.parts: list[tuple[np.ndarray, np.ndarray, Array]] = []
        self.bounds: list[Array] = []

    def add(self, row: np.ndarray, column: np.ndarray, value: Array, bound: float) -> None:
        if len(row) == 0:
            return
        row = np.unique(row, return_inverse=True)[1]
        self.parts.append((row + self.count, column, value))
        added = int(row.max()) + 1
        self.bounds.append(np.full(added, bound))
        self.count += added

    def constraint(self) -> LinearConstraint:
        if not self.parts:
            return LinearConstraint(csr_array((1, self.columns)), -np.inf, 1.0)
        row, column, value = (np.concatenate(part) for part in zip(*self.parts, strict=True))
        A = coo_array((value, (row, column)), shape=(self.count, self.columns)).tocsr()
        return LinearConstraint(A, -np.inf, np.concatenate(self.bounds))
