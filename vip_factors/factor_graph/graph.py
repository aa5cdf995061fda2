"""A problem as a ``gtsam.NonlinearFactorGraph``, with values to start from and back."""

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
    """A factor graph in the open. Keys are those of :mod:`vip_factors.factor_graph.keys`, and its methods give those of
    sensors by name.

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

    def solved(self, settings: SolveSettings | None = None) -> gtsam.Values:
        """The values at which the package's own solver ends, which sums the terms of all frames at once.

        It starts where the graph does. Factors that were added to ``graph`` are not in it: give them to ``smooth`` as
        ``extra_factors``.

        Raises:
            SolveError: if the problem is not determined.
        """
        state, _ = levenberg_marquardt(SceneObjective(self.problem), self.state, settings or SolveSettings())
        return values_of(state, self.variables)

    def marginals(self, values: gtsam.Values) -> dict[int, Array]:
        """The covariance ``(w, w)`` of each variable at a solution, by its key and in GTSAM's tangent space.

        One elimination of all frames gives the blocks of ``gtsam.Marginals``. Of a heading that drifts only the first
        step has an entry.

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
        """The number of each sensor in keys, by the names of wearer and sensor."""
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
        """A key in words, such as ``heading of left_shank, Ada``: a formatter for what GTSAM prints."""
        variable = variable_of(key)
        if variable is None:
            return str(gtsam.DefaultKeyFormatter(key))
        items, words = {JOINT: JOINT_NAMES, "keypoint_offsets": OFFSET_KEYPOINTS}.get(variable.block, ()), variable.kind
        wearer = self.problem.wearers[variable.wearer] if variable.owner.kind is Owner.WEARER else None
        if wearer is not None and not variable.is_of_a_frame and ROWS[variable.block].of_sensors:
            items = wearer.frames.sensors
        words += f" of {items[variable.item]}" if items else ""
        words += f", frame {variable.frame}" if variable.is_of_a_frame or variable.is_of_the_camera_path else ""
        words += f", step {variable.step}" if variable.step else ""
        return words if wearer is None else f"{words}, {wearer.name}"

    def summary(self) -> list[str]:
        """How many factors on how many variables in how many frames, and how many of each kind."""
        size = f"{self.graph.size()} factors on {self.values.size()} variables in {len(self.time)} frames"
        counts = {"variables": self.variable_counts, "factors": self.factor_counts}
        kinds = ((label, (f"{n} {kind}" for kind, n in count.most_common())) for label, count in counts.items())
        sensors = (f"{wearer}: {', '.join(names)}" for wearer, names in self.sensors.items())
        return [f"factor graph: {size}", *(f"{label}: {', '.join(words)}" for label, words in kinds), *sensors]

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
