"""The binary linear program that chooses hypotheses (thesis eqs. 4.11–4.12), for HiGHS.

Products of two choices become auxiliary variables. They may be continuous: with binary choices the constraints leave
them only 0 or 1. A wearer is seen once per frame, so all products of one hypothesis with another frame's hypotheses
of a wearer add up to at most 1: constraints summed in this way describe the same program and relax it less.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import coo_array, csr_array

from vip_factors.errors import SolveError
from vip_factors.geometry.rotations import Array

SECONDS_PER_WINDOW = 20.0  # what HiGHS may take for one; the best found until then is used
RELATIVE_GAP = 1e-4
TOLERANCE = 1e-6  # within which HiGHS keeps to constraints


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

    def beside(self, chosen: np.ndarray) -> "AssignmentProblem":
        """The problem of the others, next to those that are chosen ``(H,)`` already."""
        a, b = self.edges.T
        to_chosen = [np.bincount(one, chosen[other] * self.edge_cost, len(chosen)) for one, other in ((a, b), (b, a))]
        return replace(self, cost=self.cost + sum(to_chosen))

    def with_edges(self, which: np.ndarray) -> "AssignmentProblem":
        """The problem with some of its edges, by mask."""
        return replace(self, edges=self.edges[which], edge_cost=self.edge_cost[which])


def solve(problem: AssignmentProblem) -> np.ndarray:
    """The best choice ``(H,)``.

    Raises:
        SolveError: if HiGHS finds no solution (choosing nothing always is one).
    """
    hopeful, chosen = _settled(problem)
    rows = np.flatnonzero(hopeful & ~chosen)
    if len(rows):
        chosen[rows] = _solve_open(problem.beside(chosen).restricted_to(rows))
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
    last = int(problem.frame.max())
    start = int(problem.frame.min())
    while start <= last:
        end = start + window
        if last < end + overlap // 2:
            end = last + 1
        keep_until = end if end > last else end - overlap
        free = (problem.frame >= start) & (problem.frame < end)
        rows = np.flatnonzero(free)
        best = solve(problem.beside(chosen & ~free).restricted_to(rows))
        kept = problem.frame[rows] < keep_until
        chosen[rows[kept]] = best[kept]
        start = keep_until
        if progress is not None:
            progress(min(1.0, (start - int(problem.frame.min())) / max(last + 1 - int(problem.frame.min()), 1)))
    return chosen


def _settled(problem: AssignmentProblem) -> tuple[np.ndarray, np.ndarray]:
    """Which hypotheses ``(H,)`` could be in a best choice, and which of them are in every one.

    Those are that could lower the cost at all; and these, if they have no rival, that do so whatever else is chosen.
    """
    a, b = np.concatenate([problem.edges, problem.edges[:, ::-1]]).T
    edge, H, groups = np.tile(problem.edge_cost, 2), len(problem.cost), _exclusive_groups(problem)
    hopeful, sure = np.ones(H, bool), np.zeros(H, bool)
    while True:
        least, most = (
            problem.cost + np.bincount(a, hopeful[b] * np.where(sure[b], edge, limit), H)
            for limit in (np.minimum(edge, 0.0), np.maximum(edge, 0.0))
        )
        alone = np.all([np.bincount(group, hopeful)[group] == 1 for group in groups], axis=0)
        before = hopeful, sure
        hopeful, sure = hopeful & (least < 0), hopeful & alone & (most < 0)
        if np.array_equal(before, (hopeful, sure)):
            return hopeful, sure


def _exclusive_groups(problem: AssignmentProblem) -> list[np.ndarray]:
    """Group number ``(H,)`` of each hypothesis, twice: one choice per wearer and frame, one per detection."""
    by_wearer = problem.frame * (int(problem.wearer.max(initial=0)) + 1) + problem.wearer
    return [np.unique(key, return_inverse=True)[1] for key in (by_wearer, problem.detection)]


def _solve_open(problem: AssignmentProblem) -> np.ndarray:
    """The best choice ``(H,)``: of the program's relaxation where that chooses nothing by halves, as it nearly always
    does.

    Most edges that cost something join a right hypothesis with a wrong one, and nobody chooses both: such edges are
    taken in where a choice without them breaks their constraints. Then none of those left out would change it.
    """
    H, taken = len(problem.cost), problem.edge_cost <= 0
    while (found := _minimised(problem.with_edges(taken), binary=False)) is not None:
        products = np.zeros(len(taken))
        products[taken] = found[H:]
        broken = _broken(problem, found[:H], products) & ~taken
        if not broken.any():
            break
        taken |= broken
    if found is None or np.any(np.abs(found[:H] - np.round(found[:H])) > TOLERANCE):
        found = _minimised(problem, binary=True)
    if found is None:
        raise SolveError(f"the association's binary program of {H} hypotheses was not solved")
    return found[:H] > 0.5


def _minimised(problem: AssignmentProblem, binary: bool) -> Array | None:
    """Choices and products ``(H + E,)`` of the program, or of its relaxation; None if HiGHS found none in its time."""
    H, E = len(problem.cost), len(problem.edges)
    return milp(
        np.concatenate([problem.cost, problem.edge_cost]),
        constraints=_constraints(problem),
        integrality=np.concatenate([np.full(H, float(binary)), np.zeros(E)]),
        bounds=Bounds(0, 1),
        options={"time_limit": SECONDS_PER_WINDOW, "mip_rel_gap": RELATIVE_GAP},
    ).x


def _broken(problem: AssignmentProblem, x: Array, products: Array) -> np.ndarray:
    """Edges ``(E,)`` of a cost whose constraints a choice ``(H,)`` with products ``(E,)`` breaks."""
    broken, dear = np.zeros(len(products), bool), np.flatnonzero(problem.edge_cost > 0)
    for near, far, key, _ in _with_each_wearer(problem, dear):
        broken[dear] |= x[near] + np.bincount(key, x[far] - products[dear])[key] > 1 + TOLERANCE
    return broken


def _with_each_wearer(
    problem: AssignmentProblem, edges: np.ndarray
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
    """Both ends of some edges, this way and that, numbered by the one and the wearer and frame of the other; and the
    first edge of each number.
    """
    group = _exclusive_groups(problem)[0]
    for near, far in (problem.edges[edges].T, problem.edges[edges].T[::-1]):
        both = near * (int(group.max(initial=0)) + 1) + group[far]
        _, first, key = np.unique(both, return_index=True, return_inverse=True)
        yield near, far, key, first


def _constraints(problem: AssignmentProblem) -> LinearConstraint:
    H, E = len(problem.cost), len(problem.edges)
    rows = _Rows(H + E)
    for group in _exclusive_groups(problem):
        shared = np.flatnonzero(np.bincount(group)[group] > 1)
        rows.add(np.unique(group[shared], return_inverse=True)[1], shared, np.ones(len(shared)), 1.0)
    edge = np.arange(E)
    for near, _, key, first in _with_each_wearer(problem, edge):
        # all products of one choice with a wearer in another frame: at most that choice
        rows.add(
            np.concatenate([key, np.arange(len(first))]), np.concatenate([H + edge, near[first]]),
            np.concatenate([np.ones(E), -np.ones(len(first))]), 0.0,
        )  # fmt: skip
    dear = np.flatnonzero(problem.edge_cost > 0)
    for near, far, key, first in _with_each_wearer(problem, dear):
        # a choice and one of a wearer in another frame: their product, which nobody would choose without
        ones = np.ones(len(dear))
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
