"""The one Levenberg–Marquardt loop: linearise, damp, eliminate, retract. It knows nothing of bodies.

GTSAM's own optimisers hand every Python callback a fresh copy of all values; this loop does not, and it takes any
objective that can linearise itself.
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
    """One step of the optimiser: total cost after it, its damping, whether it was taken, and seconds by part."""

    cost: float
    damping: float
    accepted: bool
    seconds: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, repr=False)
class SolveReport(Summarised):
    """How a solve went.

    Attributes:
        stage: which solve of the pipeline this was.
        iterations: in order.
        initial_cost, final_cost: half the sum of squared whitened residuals (robust losses applied) by factor kind.
        converged: whether the cost stopped falling before the iteration limit.
        seconds: wall time of the whole solve.
    """

    stage: str
    iterations: tuple[Iteration, ...]
    initial_cost: Mapping[str, float]
    final_cost: Mapping[str, float]
    converged: bool
    seconds: float


class LinearSystem(Protocol):
    """A linearisation."""

    def step(self, damping: float) -> Any:
        """The minimum of the quadratic with so many units on the diagonal; :class:`SolveError` if there is none."""
        ...


class Objective(Protocol[State]):
    """A least-squares problem over some state."""

    def cost(self, state: State) -> Mapping[str, float]:
        """Half the sum of squares (robust losses applied), by factor kind."""
        ...

    def linearise(self, state: State) -> LinearSystem:
        """The normal equations at a state."""
        ...

    def retract(self, state: State, step: Any) -> State:
        """The state moved by a step."""
        ...


INITIAL_DAMPING = 1e-3  # of the diagonal: near Gauss–Newton, for starts are good
MAX_DAMPING = 1e6  # beyond it steps have no length left


def levenberg_marquardt(
    objective: Objective[State],
    start: State,
    settings: SolveSettings,
    stage: str = "solve",
    progress: Callable[[float], None] | None = None,
) -> tuple[State, SolveReport]:
    """Minimise an objective.

    Args:
        objective: what to minimise.
        start: where to begin; it is not changed.
        settings: stopping rules.
        stage: name of this solve for the report.
        progress: called with about what fraction is done.

    Raises:
        SolveError: if the cost at the start is not finite, or no damping makes the system solvable.
    """
    begin = time.perf_counter()
    state, damping = start, INITIAL_DAMPING
    damping_factor = 5.0  # up on a rejected step, down on a good one
    min_damping = 1e-4  # small against every measurement, and quick to climb back from
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
            before, after = sum(costs.values()), sum(trial.values())
            accepted = delta is not None and np.isfinite(after) and after <= before
            used = damping
            if accepted:
                break
            rejected = True
            damping *= damping_factor
            if damping > MAX_DAMPING:
                break
        undetermined = delta is None
        del system, delta  # before the next one is made, to which a step refers: there is room for one
        if bold and not rejected:  # after a rejection the damping rests for one step: no up and down in turn
            damping = max(damping / damping_factor, min_damping)
        iterations.append(Iteration(after if accepted else before, used, accepted, clock.seconds))
        if not accepted:
            if undetermined:
                raise SolveError(f"{stage}: the data do not determine everything that is looked for")
            converged = True
        else:
            converged = before - after <= settings.relative_decrease * before
            state, costs = candidate, trial
        if progress is not None:
            progress(1.0 if converged else _share(sum(initial.values()), iterations, settings))
    report = SolveReport(stage, tuple(iterations), initial, costs, converged, time.perf_counter() - begin)
    return state, report


def _share(initial: float, iterations: Sequence[Iteration], settings: SolveSettings) -> float:
    """About what is done: of the iterations allowed, or of the way from the first decrease to the one that ends it."""
    costs, least = np.array([initial, *(one.cost for one in iterations)]), settings.relative_decrease
    decreases, by_number = -np.diff(costs) / costs[:-1], len(iterations) / settings.max_iterations
    if not decreases[0] > decreases[-1] > least > 0:
        return by_number
    return float(max(np.log(decreases[0] / decreases[-1]) / np.log(decreases[0] / least), by_number))


def _step(system: LinearSystem, damping: float) -> Any:
    """The minimum of the damped linear problem, or None where it is not determined."""
    try:
        return system.step(damping)
    except SolveError:
        return None


class _Clock:
    """Seconds spent by part of one iteration."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        now = time.perf_counter()
        self.seconds[name] = self.seconds.get(name, 0.0) + now - self._last
        self._last = now
