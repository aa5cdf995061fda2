"""The solver of a recording and its reports."""

from collections.abc import Callable
from dataclasses import dataclass, field

from vip_factors.assembly.objective import SceneObjective
from vip_factors.display import ProgressCallback
from vip_factors.factor_graph.graph import optimise_with_gtsam
from vip_factors.problem.scene import ExtraTerms
from vip_factors.problem.state import SceneState, WearerState
from vip_factors.problem.wearer import WearerProblem
from vip_factors.settings import SolverName, SolveSettings
from vip_factors.solve.levenberg_marquardt import SolveReport, levenberg_marquardt
from vip_factors.terms.registry import unfilmed_problem


@dataclass
class Solver:
    """Runs the optimiser and keeps its reports.

    Attributes:
        settings: settings of the optimiser.
        on_progress: called with the name of the stage and the fraction done.
        reports: one per solve, in order.
        name: name of the optimiser.
        extra: terms of the user.
    """

    settings: SolveSettings
    on_progress: ProgressCallback
    reports: list[SolveReport] = field(default_factory=list)
    name: SolverName = SolverName.OWN
    extra: ExtraTerms | None = None

    def solve(self, objective: SceneObjective, start: SceneState, stage: str) -> SceneState:
        """Minimise the objective from ``start`` and keep the report."""
        optimise = optimise_with_gtsam if self.name is SolverName.GTSAM else levenberg_marquardt
        state, report = optimise(objective, start, self.settings, stage, lambda done: self.on_progress(stage, done))
        self.reports.append(report)
        return state

    def solve_wearer(
        self, model: WearerProblem, start: WearerState, stage: str, extra: ExtraTerms | None = None
    ) -> WearerState:
        """Solve one wearer without cameras."""
        objective = SceneObjective(unfilmed_problem([model], extra))
        return self.solve(objective, SceneState.unfilmed([start]), stage).wearers[0]

    def progress_of(self, stage: str) -> Callable[[float], None]:
        """Return a progress callback for a stage that is no solve."""
        return lambda done: self.on_progress(stage, done)
