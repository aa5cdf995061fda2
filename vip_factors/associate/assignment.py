"""The binary linear program that chooses hypotheses (thesis eqs. 4.11–4.12), by its dual, or by HiGHS.

What is settled whatever else is chosen is left out of it. Of the rest a bound is raised until what it points at proves
to be the best choice; if it is caught before, HiGHS solves the program. There products of two choices become auxiliary
variables. They may be continuous: with binary choices the constraints leave them only 0 or 1. A wearer is seen once per
frame, so all products of one hypothesis with another frame's hypotheses of a wearer add up to at most 1: constraints
summed in this way describe the same program and relax it less.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import coo_array

from vip_factors.errors import SolveError
from vip_factors.geometry.rotations import Array

SWEEPS, LOOKS = 10, 20  # between looks at the bound, and how often, until HiGHS is asked: two to six looks do mostly


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


def solve(problem: AssignmentProblem) -> np.ndarray:
    """The best choice ``(H,)``."""
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
    first, last = int(problem.frame.min()), int(problem.frame.max())
    start = first
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
            progress(min(1.0, (start - first) / (last + 1 - first)))
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
    """The best choice ``(H,)``; HiGHS is asked where no bound proves one."""
    proven = 1e-7  # of its cost is what a choice may be short of the bound: rounding
    relative_gap = 1e-4
    seconds_per_window = 20.0  # what HiGHS may take for one; the best found until then is used
    dual = _Dual(problem)
    for _ in range(LOOKS):
        dual.raise_bound()
        chosen = dual.choice()
        value = problem.value(chosen)
        if value - dual.bound() <= proven * (1 + abs(value)):
            return chosen
    H, E = len(problem.cost), len(problem.edges)
    result = milp(
        np.concatenate([problem.cost, problem.edge_cost]),
        constraints=_constraints(problem),
        integrality=np.concatenate([np.ones(H), np.zeros(E)]),
        bounds=Bounds(0, 1),
        options={"time_limit": seconds_per_window, "mip_rel_gap": relative_gap},
    )
    if result.x is None:
        raise SolveError(f"the association's binary program of {H} hypotheses was not solved: {result.message}")
    return result.x[:H] > 0.5


class _Dual:
    """A lower bound of the program by block-coordinate ascent (Globerson & Jaakkola 2007, Tourani et al. 2018).

    Nodes, each with one label of several, are wearers in frames, which are nobody or a hypothesis, and detections,
    which show nobody or a wearer. Costs move between nodes and pairs of nodes; what each of these costs at least, by
    itself, adds up to the bound.
    """

    def __init__(self, problem: AssignmentProblem) -> None:
        never = 1e4  # log-odds, beyond all others
        self.node, self.detection = _exclusive_groups(problem)
        H, N = len(problem.cost), int(self.node.max()) + 1
        order = np.argsort(self.node, kind="stable")
        self.label = np.empty(H, int)
        self.label[order] = np.arange(H) - np.searchsorted(self.node[order], self.node[order]) + 1
        wearer, frame, shown = problem.wearer, problem.frame, problem.wearer + 1
        L = int(max(self.label.max(), shown.max())) + 1
        self.own = np.full((N + int(self.detection.max()) + 1, L), never)
        self.own[:, 0] = self.own[N + self.detection, shown] = 0.0
        self.own[self.node, self.label] = problem.cost
        rivals = np.argwhere(np.triu(self.detection[:, None] == self.detection, 1))
        a, b = np.concatenate([problem.edges, rivals]).T
        a, b = np.where(self.node[a] < self.node[b], (a, b), (b, a))
        cost = np.concatenate([problem.edge_cost, np.full(len(rivals), never)])
        _, first, pair = np.unique(self.node[a] * N + self.node[b], return_index=True, return_inverse=True)
        at = np.flatnonzero(np.bincount(self.detection)[self.detection] > 1)
        self.pair = np.zeros((len(first) + len(at), L, L))
        np.add.at(self.pair, (pair, self.label[a], self.label[b]), cost)
        beside = np.arange(len(first), len(self.pair))
        self.pair[beside, self.label[at], :] = self.pair[beside, :, shown[at]] = never
        self.pair[beside, self.label[at], shown[at]] = 0.0
        a, b = a[first], b[first]
        self.ends = np.concatenate([[self.node[a], self.node[b]], [self.node[at], N + self.detection[at]]], axis=1)
        # No node is twice in a turn: pairs of hypotheses by how far apart and whose, those with detections by label.
        apart = np.abs(frame[a] - frame[b])
        odd = np.minimum(frame[a], frame[b]) // np.maximum(apart, 1) % 2
        whose = np.where(wearer[a] == wearer[b], -1 - odd, wearer[a] * L + wearer[b])
        turn = np.concatenate([[apart, whose], [np.full(len(at), -1), shown[at] * L + self.label[at]]], axis=1)
        turn = np.unique(turn, axis=1, return_inverse=True)[1].ravel()
        self.turns = np.split(np.argsort(turn, kind="stable"), np.cumsum(np.bincount(turn))[:-1])

    def raise_bound(self) -> None:
        """By some turns of all pairs, forth and back: what a pair costs goes to its nodes, to either as much as can."""
        for turn in (*self.turns, *self.turns[::-1]) * SWEEPS:
            i, j = self.ends[:, turn]
            joint = self.pair[turn] + self.own[i][:, :, None] + self.own[j][:, None]
            first = joint.min(axis=2, keepdims=True) / 2
            joint -= first
            second = joint.min(axis=1, keepdims=True)
            joint -= second
            rest = joint.min(axis=2, keepdims=True)
            self.own[i], self.own[j], self.pair[turn] = (first + rest)[..., 0], second[:, 0], joint - rest

    def bound(self) -> float:
        """No choice costs less."""
        return float(self.own.min(axis=1).sum() + self.pair.min(axis=(1, 2)).sum())

    def choice(self) -> np.ndarray:
        """What each node would choose by itself, ``(H,)``; nobody for a detection that two would have."""
        chosen = self.label == self.own.argmin(axis=1)[self.node]
        return np.asarray(chosen & (np.bincount(self.detection, chosen)[self.detection] == 1))


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
        row, column, value = (np.concatenate(part) for part in zip(*self.parts, strict=True))
        A = coo_array((value, (row, column)), shape=(self.count, self.columns)).tocsr()
        return LinearConstraint(A, -np.inf, np.concatenate(self.bounds))
