"""What a problem can be given besides the terms that this package knows."""

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Protocol

from vip_factors.problem.layout import Layout

if TYPE_CHECKING:
    from vip_factors.problem.scene import SceneProblem
    from vip_factors.problem.state import SceneState


class ExtraTerms(Protocol):
    """Terms of a user's own, on the variables of a scene."""

    def cost(self, problem: "SceneProblem", state: "SceneState") -> float:
        """Half the sum of their squared whitened residuals, losses applied."""
        ...

    def linearised(self, problem: "SceneProblem", layout: Layout, state: "SceneState") -> Iterable[tuple[int, Any]]:
        """Their linear factors, on the vectors of the chain, each with the first frame that it sees."""
        ...
