"""Binary linear program that chooses hypotheses (thesis eqs. 4.11–4.12), solved by its dual, or by HiGHS.

Hypotheses whose choice does not depend on others are decided first. For the rest, a lower bound is raised until the
choice that it suggests is proven optimal; otherwise HiGHS solves the program. There products of two choices become
auxiliary variables, which may be continuous: with binary choices the constraints leave them only 0 or 1. A wearer is
seen once per frame, so all products of one hypothesis with another frame's hypotheses of a wearer add up to at most 1;
constraints summed in this way describe the same program with a tighter relaxation.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import coo_array

from vip_factors.errors import SolveError
from vip_factors.geometry.rotations import Array

SWEEPS, LOOKS = 10, 20  # between checks of the bound, and number of checks before HiGHS is called; two to six are usual


@dataclass(frozen=True)
class AssignmentProblem:
    """Choice among ``H`` hypotheses with ``E`` edges between them; costs are minimised.

    Attributes:
        frame, wearer, detection: ``(H,)``: at most one choice per wearer and frame, and per detection.
        cost, edge_cost: cost of each choice ``(H,)``, and of choosing both ends of an edge ``(E,)``.
        edges: ``(E, 2)`` rows of hypotheses that do not exclude each other.
    """

    frame: np.ndarray
    wearer: np.ndarray
    detection: np.ndarray
    cost: Array
    edges: np.ndarray
    edge_cost: Array

    def value(self, chosen: np.ndarray) -> float:
        """The objective of a choice ``(H,)``."""
        is_chosen = chosen[self.edges[:, 0]] & chosen[self.edges[:, 1]]
        return float(self.cost[chosen].sum() + self.edge_cost[is_chosen].sum())

    def restricted_to(self, rows: np.ndarray) -> "AssignmentProblem":
        """The problem of some hypotheses (rows, increasing) and the edges between them."""
        new = np.full(len(self.cost), -1)
        new[rows] = np.arange(len(rows))
        inside = np.all(new[self.edges] >= 0, axis=1)
        return AssignmentProblem(
            self.frame[rows],
            self.wearer[rows],
            self.detection[rows],
            self.cost[rows],
            new[self.edges[inside]],
            self.edge_cost[inside],
        )

    def beside(self, chosen: np.ndarray) -> "AssignmentProblem":
        """The problem of the other hypotheses, given those that are chosen ``(H,)`` already."""
        pairs = (self.edges.T, self.edges.T[::-1])
        cost = [np.bincount(ends, chosen[starts] * self.edge_cost, len(chosen)) for ends, starts in pairs]
        return replace(self, cost=self.cost + sum(cost))


def solve(problem: AssignmentProblem) -> np.ndarray:
    """Choose the hypotheses of least cost: ``(H,)``."""
    hopeful, chosen = _settled(problem)
    rows = np.flatnonzero(hopeful & ~chosen)
    if len(rows):
        chosen[rows] = _solve_open(problem.beside(chosen).restricted_to(rows))
    return chosen


def solve_in_windows(
    problem: AssignmentProblem, window: int, overlap: int, progress: Callable[[float], None] | None = None
) -> np.ndarray:
    """Solve in overlapping windows of video frames, so that the time grows linearly with the recording: ``(H,)``.

    Each window decides all its frames but keeps only those before its overlap with the next, which should be longer
    than any edge; earlier decisions stand, and edges to them count. ``progress`` receives the fraction done.
    """
    chosen = np.zeros(len(problem.cost), bool)
    if len(chosen) == 0:
        return chosen
    first_frame, last_frame = int(problem.frame.min()), int(problem.frame.max())
    start = first_frame
    while start <= last_frame:
        end = start + window
        if last_frame < end + overlap // 2:
            end = last_frame + 1
        keep_until = end if end > last_frame else end - overlap
        free = (problem.frame >= start) & (problem.frame < end)
        rows = np.flatnonzero(free)
        choice = solve(problem.beside(chosen & ~free).restricted_to(rows))
        is_final = problem.frame[rows] < keep_until
        chosen[rows[is_final]] = choice[is_final]
        start = keep_until
        if progress is not None:
            progress(min(1.0, (start - first_frame) / (last_frame + 1 - first_frame)))
    return chosen


def _settled(problem: AssignmentProblem) -> tuple[np.ndarray, np.ndarray]:
    """Hypotheses ``(H,)`` that could be part of the best choice, and those that are in any case.

    The former could lower the cost; the latter lower it whatever else is chosen, and have no rival.
    """
    a, b = np.concatenate([problem.edges, problem.edges[:, ::-1]]).T
    edge, H, groups = np.tile(problem.edge_cost, 2), len(problem.cost), _exclusive_groups(problem)
    hopeful, sure = np.ones(H, bool), np.zeros(H, bool)
    while True:
        least, highest = (
            problem.cost + np.bincount(a, hopeful[b] * np.where(sure[b], edge, limit), H)
            for limit in (np.minimum(edge, 0.0), np.maximum(edge, 0.0))
        )
        has_no_rival = np.all([np.bincount(group, hopeful)[group] == 1 for group in groups], axis=0)
        previous = hopeful, sure
        hopeful, sure = hopeful & (least < 0), hopeful & has_no_rival & (highest < 0)
        if np.array_equal(previous, (hopeful, sure)):
            return hopeful, sure


def _exclusive_groups(problem: AssignmentProblem) -> list[np.ndarray]:
    """Group numbers ``(H,)`` of hypotheses that exclude each other: by wearer and frame, and by detection."""
    by_wearer = problem.frame * (int(problem.wearer.max(initial=0)) + 1) + problem.wearer
    return [np.unique(key, return_inverse=True)[1] for key in (by_wearer, problem.detection)]


def _solve_open(problem: AssignmentProblem) -> np.ndarray:
    """The best choice ``(H,)``, by the bound if it proves one, otherwise by HiGHS."""
    proven = 1e-7  # relative gap to the bound that counts as rounding
    relative_gap = 1e-4
    seconds_per_window = 20.0  # limit for HiGHS, after which its best choice so far is used
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

    Nodes, each with one of several labels, are wearers in frames, labelled with nobody or a hypothesis, and detections,
    labelled with nobody or a wearer. Costs move between nodes and pairs of nodes; the sum of the least cost of each is
    the bound.
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
        _, first_edge, pair = np.unique(self.node[a] * N + self.node[b], return_index=True, return_inverse=True)
        shared = np.flatnonzero(np.bincount(self.detection)[self.detection] > 1)
        self.pair = np.zeros((len(first_edge) + len(shared), L, L))
        np.add.at(self.pair, (pair, self.label[a], self.label[b]), cost)
        pair_index = np.arange(len(first_edge), len(self.pair))
        self.pair[pair_index, self.label[shared], :] = self.pair[pair_index, :, shown[shared]] = never
        self.pair[pair_index, self.label[shared], shown[shared]] = 0.0
        a, b = a[first_edge], b[first_edge]
        to_detections = [self.node[shared], N + self.detection[shared]]
        self.ends = np.concatenate([[self.node[a], self.node[b]], to_detections], axis=1)
        # No node is twice in a turn: pairs of hypotheses by distance and wearers, pairs with detections by label.
        distance = np.abs(frame[a] - frame[b])
        odd = np.minimum(frame[a], frame[b]) // np.maximum(distance, 1) % 2
        whose = np.where(wearer[a] == wearer[b], -1 - odd, wearer[a] * L + wearer[b])
        turn_of_shared = [np.full(len(shared), -1), shown[shared] * L + self.label[shared]]
        turn = np.concatenate([[distance, whose], turn_of_shared], axis=1)
        turn = np.unique(turn, axis=1, return_inverse=True)[1].ravel()
        self.turns = np.split(np.argsort(turn, kind="stable"), np.cumsum(np.bincount(turn))[:-1])

    def raise_bound(self) -> None:
        """Take turns over all pairs, forth and back: the cost of a pair moves to its nodes as far as possible."""
        for turn in (*self.turns, *self.turns[::-1]) * SWEEPS:
            i, j = self.ends[:, turn]
            joint = self.pair[turn] + self.own[i][:, :, None] + self.own[j][:, None]
            first_share = joint.min(axis=2, keepdims=True) / 2
            joint -= first_share
            second = joint.min(axis=1, keepdims=True)
            joint -= second
            remainder = joint.min(axis=2, keepdims=True)
            self.own[i], self.own[j] = (first_share + remainder)[..., 0], second[:, 0]
            self.pair[turn] = joint - remainder

    def bound(self) -> float:
        """Lower bound of the cost."""
        return float(self.own.min(axis=1).sum() + self.pair.min(axis=(1, 2)).sum())

    def choice(self) -> np.ndarray:
        """Best choice of each node by itself, ``(H,)``; nobody for a detection that two wearers choose."""
        chosen = self.label == self.own.argmin(axis=1)[self.node]
        return np.asarray(chosen & (np.bincount(self.detection, chosen)[self.detection] == 1))


def _constraints(problem: AssignmentProblem) -> list[LinearConstraint]:
    """Constraints on the choices ``(H,)`` and the products of edges ``(E,)``."""
    H, E = len(problem.cost), len(problem.edges)
    groups = _exclusive_groups(problem)
    constraints = [_at_most(1.0, H + E, (group, np.arange(H), 1.0)) for group in groups]
    for edges, are_dear in ((np.arange(E), False), (np.flatnonzero(problem.edge_cost > 0), True)):
        for near, far in (problem.edges[edges].T, problem.edges[edges].T[::-1]):
            _, first_rows, row = np.unique(
                near * (int(groups[0].max()) + 1) + groups[0][far], return_index=True, return_inverse=True
            )
            choice, product = (np.arange(len(first_rows)), near[first_rows]), (row, H + edges)
            if are_dear:  # a choice and one of a wearer in another frame: their product, which is expensive, must count
                constraints.append(_at_most(1.0, H + E, (*choice, 1.0), (row, far, 1.0), (*product, -1.0)))
            else:  # all products of one choice with a wearer in another frame: at most that choice
                constraints.append(_at_most(0.0, H + E, (*product, 1.0), (*choice, -1.0)))
    return constraints


def _at_most(bound: float, width: int, *parts: tuple[np.ndarray, np.ndarray, float]) -> LinearConstraint:
    """Inequalities ``A x ≤ bound``; parts of ``A`` are rows, columns and a value."""
    value = np.concatenate([np.full(len(row), value) for row, _, value in parts])
    row, column = (np.concatenate([part[axis] for part in parts]) for axis in (0, 1))
    A = coo_array((value, (row, column)), shape=(int(row.max(initial=-1)) + 1, width)).tocsr()
    return LinearConstraint(A, -np.inf, bound)
