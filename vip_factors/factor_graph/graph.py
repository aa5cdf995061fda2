"""A problem as a ``gtsam.NonlinearFactorGraph``, with values to start from and back."""

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import gtsam
import numpy as np

from vip_factors.assembly.objective import SceneObjective
from vip_factors.errors import SolveError
from vip_factors.factor_graph.extra import UserTerms
from vip_factors.factor_graph.term_factors import TermFactor, term_factors
from vip_factors.factor_graph.variables import Variable, state_of, values_of, variables_of
from vip_factors.geometry.rotations import Array
from vip_factors.problem.layout import Layout
from vip_factors.problem.scene import SceneProblem
from vip_factors.problem.state import SceneState
from vip_factors.problem.variables import scene_layout
from vip_factors.settings import SolveSettings
from vip_factors.solve.levenberg_marquardt import (
    INITIAL_DAMPING,
    MAX_DAMPING,
    Iteration,
    SolveReport,
    levenberg_marquardt,
)


@dataclass(frozen=True)
class FactorGraph:
    """A factor graph in the open. Keys are those of :mod:`vip_factors.factor_graph.keys`.

    Attributes:
        graph: of GTSAM; factors may be added to it.
        values: to start from.
        time: ``(T,)`` seconds of the frames that keys count.
        factors: of the graph, in its order, with what they stand for.
        variables: of the values.
        problem, state: what the graph was made of; the state holds what does not move.
    """

    graph: gtsam.NonlinearFactorGraph
    values: gtsam.Values
    time: Array
    factors: tuple[TermFactor, ...]
    variables: tuple[Variable, ...]
    problem: SceneProblem
    state: SceneState

    def state_at(self, values: gtsam.Values) -> SceneState:
        """The state that values stand for."""
        return state_of(values, self.state, self.variables)

    def solved(self, settings: SolveSettings | None = None) -> SceneState:
        """Where the package's own solver ends, which sums the terms of all frames at once; it starts at the values.

        Raises:
            SolveError: if the problem is not determined.
        """
        return levenberg_marquardt(SceneObjective(self.problem), self.state, settings or SolveSettings())[0]

    @property
    def factor_counts(self) -> Counter[str]:
        """How many factors there are of each kind."""
        return Counter(one.kind for one in self.factors)

    @property
    def variable_counts(self) -> Counter[str]:
        """How many variables there are of each kind."""
        return Counter(one.kind for one in self.variables)


def factor_graph_of(problem: SceneProblem, state: SceneState, layout: Layout | None = None) -> FactorGraph:
    """The factor graph of a scene's problem, to be started at a state; ``layout`` says which variables move: all that
    the problem frees, if absent.
    """
    layout = layout or scene_layout(problem)
    steps = {number: max(len(one.heading_times) - 1, 0) for number, one in enumerate(problem.wearers)}
    variables = tuple(variables_of(layout, problem.frames, steps))
    factors, graph = tuple(term_factors(problem, state, layout)), gtsam.NonlinearFactorGraph()
    for one in factors:
        graph.push_back(one.factor)
    time = np.asarray(problem.wearers[0].frames.time)
    return FactorGraph(graph, values_of(state, variables), time, factors, variables, problem, state)


def optimise_with_gtsam(
    objective: SceneObjective,
    start: SceneState,
    settings: SolveSettings,
    stage: str = "solve",
    progress: Callable[[float], None] | None = None,
) -> tuple[SceneState, SolveReport]:
    """Minimise an objective with ``gtsam.LevenbergMarquardtOptimizer``.

    The arguments are those of :func:`~vip_factors.solve.levenberg_marquardt.levenberg_marquardt`. Factors that would
    come to exist only elsewhere than at the start are not there: a joint limit always is, a measurement that is missing
    never.

    Raises:
        SolveError: if the problem is not determined.
    """
    begin = time.perf_counter()
    problem = objective.problem
    whole, extra = factor_graph_of(problem, start, objective.layout), problem.extra
    if isinstance(extra, UserTerms):
        whole.graph.push_back(extra.factors(problem))
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setlambdaInitial(INITIAL_DAMPING)
    parameters.setlambdaUpperBound(MAX_DAMPING)
    parameters.setMaxIterations(settings.max_iterations)
    optimiser = gtsam.LevenbergMarquardtOptimizer(whole.graph, whole.values, parameters)
    before, iterations, converged = optimiser.error(), list[Iteration](), False
    while len(iterations) < settings.max_iterations and not converged:
        lap = time.perf_counter()
        try:
            optimiser.iterate()
        except RuntimeError as error:  # gtsam's IndeterminantLinearSystemException arrives as this
            raise SolveError(f"{stage}: GTSAM's optimiser: {str(error).strip().splitlines()[-1]}") from error
        after = optimiser.error()
        seconds = {"iterate": time.perf_counter() - lap}
        iterations.append(Iteration(after, optimiser.lambda_(), after < before, seconds))
        converged = before - after <= settings.relative_decrease * before
        before = after
        if progress is not None:
            progress(1.0 if converged else len(iterations) / settings.max_iterations)
    state = whole.state_at(optimiser.values())
    costs = dict(objective.cost(start)), dict(objective.cost(state))
    return state, SolveReport(stage, tuple(iterations), *costs, converged, time.perf_counter() - begin)
