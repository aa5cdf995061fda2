"""The same problem solved by GTSAM's own optimiser: slow, and the judge of the fast one."""

import time
from collections.abc import Callable

import gtsam

from vip_factors.assembly.objective import SceneObjective
from vip_factors.errors import SolveError
from vip_factors.estimate import Iteration, SolveReport
from vip_factors.factor_graph.extra import UserTerms
from vip_factors.factor_graph.graph import factor_graph_of
from vip_factors.problem.state import SceneState
from vip_factors.solve.levenberg_marquardt import SolveSettings


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
    parameters.setlambdaInitial(settings.initial_damping)
    parameters.setlambdaUpperBound(settings.max_damping)
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
