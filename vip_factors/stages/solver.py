"""The solves of one recording, and what they report."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

from vip_factors.estimate import SolveReport
from vip_factors.solve.levenberg_marquardt import Objective, SolveSettings, levenberg_marquardt

State = TypeVar("State")
Progress = Callable[[str, float], None]


@dataclass
class Solver:
    """Runs the optimiser and keeps its reports.

    Attributes:
        settings: of the optimiser.
        tell: called with the name of the stage and the fraction of it done.
        reports: one per solve, in order.
    """

    settings: SolveSettings
    tell: Progress
    reports: list[SolveReport] = field(default_factory=list)

    def solve(self, objective: Objective[State], start: State, stage: str) -> State:
        """The minimum near ``start``."""
        state, report = levenberg_marquardt(objective, start, self.settings, stage, lambda done: self.tell(stage, done))
        self.reports.append(report)
        return state

    def telling(self, stage: str) -> Callable[[float], None]:
        """Progress of a stage that is no solve."""
        return lambda done: self.tell(stage, done)
