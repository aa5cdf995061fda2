"""Levenberg–Marquardt: linearise, damp, eliminate, retract, for any objective that can linearise itself.

GTSAM's own optimisers pass a copy of all values to every Python callback; this loop does not.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar

import numpy as np

from vip_factors.display import Summarised
from vip_factors.errors import SolveError
from vip_factors.settings import SolveSettings

State = TypeVar("State")


@dataclass(frozen=True)
class Iteration:
    """One step of the optimiser: total cost after it, damping, acceptance, and seconds by part."""

    cost: float
    damping: float
    accepted: bool
    seconds: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, repr=False)
class SolveReport(Summarised):
    """Convergence of a solve.

    Attributes:
        stage: name of the solve in the pipeline.
        iterations: in time order.
        initial_cost, final_cost: half the sum of squared whitened residuals (robust losses applied) by factor kind.
        converged: True if the cost stopped falling before the iteration limit.
        seconds: wall time of the whole solve.
    """

    stage: str
    iterations: tuple[Iteration, ...]
    initial_cost: Mapping[str, float]
    final_cost: Mapping[str, float]
    converged: bool
    seconds: float


class LinearSystem(Protocol):
    """Normal equations at a linearisation point."""

    def step(self, damping: float) -> Any:
        """Minimise the quadratic with ``damping`` added to the diagonal; :class:`SolveError` if it is singular."""
        ...


class Objective(Protocol[State]):
    """Nonlinear least-squares problem over a state."""

    def cost(self, state: State) -> Mapping[str, float]:
        """Half the sum of squares (robust losses applied), by factor kind."""
        ...

    def linearise(self, state: State) -> LinearSystem:
        """Build the normal equations at a state."""
        ...

    def retract(self, state: State, step: Any) -> State:
        """Move a state by a step in its tangent space."""
        ...


INITIAL_DAMPING = 1e-3  # added to the diagonal: near Gauss–Newton, since starts are good
MAX_DAMPING = 1e6  # steps beyond it are negligibly short


def levenberg_marquardt(
    objective: Objective[State],
    start: State,
    settings: SolveSettings,
    stage: str = "solve",
    progress: Callable[[float], None] | None = None,
) -> tuple[State, SolveReport]:
    """Minimise an objective.

    Args:
        objective: problem to minimise.
        start: initial state; it is not changed.
        settings: stopping rules.
        stage: name of this solve for the report.
        progress: called with the approximate fraction done, 0 to 1.

    Raises:
        SolveError: if the cost at the start is not finite, or no damping makes the system solvable.
    """
    begin = time.perf_counter()
    state, damping = start, INITIAL_DAMPING
    damping_factor = 5.0  # multiplies on a rejected step, divides on an accepted one
    min_damping = 1e-4  # small against every measurement
    costs = initial = dict(objective.cost(state))
    if not np.isfinite(sum(costs.values())):
        raise SolveError(f"{stage}: the cost at the start is not finite: {costs}")
    iterations: list[Iteration] = []
    converged = False
    rejected = False
    while len(iterations) < settings.max_iterations and not converged:
        clock, bold = _Clock(), not rejected
        rejected = False
        system = objective.linearise(state)
        clock.lap("linearise")
        while True:
            delta = _step(system, damping)
            clock.lap("eliminate")
            candidate, trial = state, costs
            if delta is not None:
                candidate = objective.retract(state, delta)
                trial = dict(objective.cost(candidate))
            clock.lap("evaluate")
            cost, trial_cost = sum(costs.values()), sum(trial.values())
            accepted = delta is not None and np.isfinite(trial_cost) and trial_cost <= cost
            used = damping
            if accepted:
                break
            rejected = True
            damping *= damping_factor
            if damping > MAX_DAMPING:
                break
        undetermined = delta is None
        del system, delta  # frees the memory before the next linearisation
        if bold and not rejected:  # damping rests for one step after a rejection: no oscillation
            damping = max(damping / damping_factor, min_damping)
        iterations.append(Iteration(trial_cost if accepted else cost, used, accepted, clock.seconds))
        if not accepted:
            if undetermined:
                raise SolveError(f"{stage}: the data do not determine all variables")
            converged = True
        else:
            converged = cost - trial_cost <= settings.relative_decrease * cost
            state, costs = candidate, trial
        if progress is not None:
            progress(1.0 if converged else _share(sum(initial.values()), iterations, settings))
    report = SolveReport(stage, tuple(iterations), initial, costs, converged, time.perf_counter() - begin)
    return state, report


def _share(initial: float, iterations: Sequence[Iteration], settings: SolveSettings) -> float:
    """Approximate progress: by iteration count, or by the cost decrease between its first and its final value."""
    costs, least = np.array([initial, *(iteration.cost for iteration in iterations)]), settings.relative_decrease
    decreases, by_number = -np.diff(costs) / costs[:-1], len(iterations) / settings.max_iterations
    if not decreases[0] > decreases[-1] > least > 0:
        return by_number
    return float(max(np.log(decreases[0] / decreases[-1]) / np.log(decreases[0] / least), by_number))


def _step(system: LinearSystem, damping: float) -> Any:
    """Minimise the damped linear problem; None if it is singular."""
    try:
        return system.step(damping)
    except SolveError:
        return None


class _Clock:
    """Stopwatch for the parts of one iteration, in seconds."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        seconds = time.perf_counter()
        self.seconds[name] = self.seconds.get(name, 0.0) + seconds - self._last
        self._last = seconds
