"""Conversion of a problem to a ``gtsam.NonlinearFactorGraph`` with initial values, and back."""

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import gtsam
import numpy as np

from vip_factors.assembly.objective import SceneObjective
from vip_factors.body.keypoints import OFFSET_KEYPOINTS
from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.display import Summarised
from vip_factors.errors import InputError, SolveError, nearest
from vip_factors.factor_graph import keys
from vip_factors.factor_graph.extra import UserTerms, variable_columns
from vip_factors.factor_graph.term_factors import TermFactor, term_factors
from vip_factors.factor_graph.variables import HEADINGS, JOINT, Variable, state_of, values_of, variable_of, variables_of
from vip_factors.geometry.rotations import Array
from vip_factors.problem.layout import STATIC, Layout, Owner
from vip_factors.problem.scene import SceneProblem
from vip_factors.problem.state import SceneState
from vip_factors.problem.variables import ROWS, scene_layout
from vip_factors.settings import SolveSettings
from vip_factors.solve.levenberg_marquardt import (
    INITIAL_DAMPING,
    MAX_DAMPING,
    Iteration,
    SolveReport,
    levenberg_marquardt,
)


@dataclass(frozen=True, repr=False)
class FactorGraph(Summarised):
    """Factor graph of a scene, with keys of :mod:`vip_factors.factor_graph.keys`.

    Attributes:
        graph: GTSAM's graph; factors may be added to it.
        values: initial values.
        time: ``(T,)`` seconds of the frames.
        factors: factors of the graph in its order, with their kinds and variables.
        variables: variables of the values.
        problem, state: origin of the graph; the state contains the constant variables.
    """

    graph: gtsam.NonlinearFactorGraph
    values: gtsam.Values
    time: Array
    factors: tuple[TermFactor, ...]
    variables: tuple[Variable, ...]
    problem: SceneProblem
    state: SceneState

    def state_at(self, values: gtsam.Values) -> SceneState:
        """Convert values to a state."""
        return state_of(values, self.state, self.variables)

    def solved(self, settings: SolveSettings | None = None) -> gtsam.Values:
        """Solve with the package's solver, which is faster than GTSAM's, from the graph's initial state.

        Factors that were added to ``graph`` are ignored: pass them to ``smooth`` as ``extra_factors``.

        Raises:
            SolveError: if the problem is not determined.
        """
        state, _ = levenberg_marquardt(SceneObjective(self.problem), self.state, settings or SolveSettings())
        return values_of(state, self.variables)

    def marginals(self, values: gtsam.Values) -> dict[int, Array]:
        """Marginal covariances ``(w, w)`` at a solution, by key, in GTSAM's tangent space.

        One elimination of all frames gives the blocks of ``gtsam.Marginals``. A drifting heading has an entry for its
        first step only.

        Raises:
            SolveError: if a variable is not determined.
        """
        objective, covariances = SceneObjective(self.problem), dict[int, Array]()
        marginals = objective.linearise(self.state_at(values)).marginals()
        for variable in self.variables:
            place = variable_columns(objective.layout, variable)
            if place is not None and not variable.step:
                chain, columns = place[0], slice(place[1], place[1] + variable.width)
                covariance = marginals.static if chain == STATIC else marginals.chains[chain][variable.frame]
                covariances[variable.key] = covariance[columns, columns]
        return covariances

    @property
    def sensors(self) -> dict[str, dict[str, int]]:
        """Number of each sensor in keys, by the names of wearer and sensor."""
        wearers = ((wearer.name, wearer.frames.sensors) for wearer in self.problem.wearers)
        return {wearer: {sensor: number for number, sensor in enumerate(sensors)} for wearer, sensors in wearers}

    def heading_key(self, wearer: str, sensor: str) -> int:
        """Key of a sensor's heading, by names; an :class:`InputError` for an unknown name."""
        return self._sensor_key(HEADINGS, wearer, sensor)

    def mounting_key(self, wearer: str, sensor: str) -> int:
        """Key of a sensor's mounting R_bone_sensor, by names; an :class:`InputError` for an unknown name."""
        return self._sensor_key("R_bone_sensor", wearer, sensor)

    def _sensor_key(self, block: str, wearer: str, sensor: str) -> int:
        for name, names in ((wearer, self.sensors), (sensor, self.sensors.get(wearer, {}))):
            if name not in names:
                raise InputError(f"no '{name}' in the factor graph{nearest(name, names)}")
        return keys.variable_key(block, self.sensors[wearer][sensor], list(self.sensors).index(wearer))

    def key_words(self, key: int) -> str:
        """Describe a key, such as ``heading of left_shank, Ada``; usable as GTSAM's key formatter."""
        variable = variable_of(key)
        if variable is None:
            return str(gtsam.DefaultKeyFormatter(key))
        names, words = {JOINT: JOINT_NAMES, "keypoint_offsets": OFFSET_KEYPOINTS}.get(variable.block, ()), variable.kind
        wearer = self.problem.wearers[variable.wearer] if variable.owner.kind is Owner.WEARER else None
        if wearer is not None and not variable.is_of_a_frame and ROWS[variable.block].of_sensors:
            names = wearer.frames.sensors
        words += f" of {names[variable.item]}" if names else ""
        words += f", frame {variable.frame}" if variable.is_of_a_frame or variable.is_of_the_camera_path else ""
        words += f", step {variable.step}" if variable.step else ""
        return words if wearer is None else f"{words}, {wearer.name}"

    def summary(self) -> list[str]:
        """Describe numbers of factors, variables and frames, and of each kind."""
        size = f"{self.graph.size()} factors on {self.values.size()} variables in {len(self.time)} frames"
        counts = {"variables": self.variable_counts, "factors": self.factor_counts}
        kinds = ((label, (f"{n} {kind}" for kind, n in count.most_common())) for label, count in counts.items())
        sensors = (f"{wearer}: {', '.join(names)}" for wearer, names in self.sensors.items())
        return [f"factor graph: {size}", *(f"{label}: {', '.join(words)}" for label, words in kinds), *sensors]

    @property
    def factor_counts(self) -> Counter[str]:
        """Number of factors of each kind."""
        return Counter(factor.kind for factor in self.factors)

    @property
    def variable_counts(self) -> Counter[str]:
        """Number of variables of each kind."""
        return Counter(variable.kind for variable in self.variables)


def factor_graph_of(problem: SceneProblem, state: SceneState, layout: Layout | None = None) -> FactorGraph:
    """Build the factor graph of a scene's problem with initial values from a state.

    ``layout`` defines the free variables; by default those of the problem.
    """
    layout = layout or scene_layout(problem)
    steps = {number: max(len(wearer.heading_times) - 1, 0) for number, wearer in enumerate(problem.wearers)}
    variables = tuple(variables_of(layout, problem.frames, steps))
    factors, graph = tuple(term_factors(problem, state, layout)), gtsam.NonlinearFactorGraph()
    for factor in factors:
        graph.push_back(factor.factor)
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

    The arguments are those of :func:`~vip_factors.solve.levenberg_marquardt.levenberg_marquardt`. The factors are those
    that exist at the start.

    Raises:
        SolveError: if the problem is not determined.
    """
    begin = time.perf_counter()
    problem = objective.problem
    scene_graph, extra = factor_graph_of(problem, start, objective.layout), problem.extra
    if isinstance(extra, UserTerms):
        scene_graph.graph.push_back(extra.factors(problem))
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setlambdaInitial(INITIAL_DAMPING)
    parameters.setlambdaUpperBound(MAX_DAMPING)
    parameters.setMaxIterations(settings.max_iterations)
    optimiser = gtsam.LevenbergMarquardtOptimizer(scene_graph.graph, scene_graph.values, parameters)
    cost, iterations, converged = optimiser.error(), list[Iteration](), False
    while len(iterations) < settings.max_iterations and not converged:
        lap = time.perf_counter()
        try:
            optimiser.iterate()
        except RuntimeError as error:  # gtsam's IndeterminantLinearSystemException
            raise SolveError(f"{stage}: GTSAM's optimiser: {str(error).strip().splitlines()[-1]}") from error
        next_cost = optimiser.error()
        seconds = {"iterate": time.perf_counter() - lap}
        iterations.append(Iteration(next_cost, optimiser.lambda_(), next_cost < cost, seconds))
        converged = cost - next_cost <= settings.relative_decrease * cost
        cost = next_cost
        if progress is not None:
            progress(1.0 if converged else len(iterations) / settings.max_iterations)
    state = scene_graph.state_at(optimiser.values())
    costs = dict(objective.cost(start)), dict(objective.cost(state))
    return state, SolveReport(stage, tuple(iterations), *costs, converged, time.perf_counter() - begin)
