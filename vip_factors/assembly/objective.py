"""A whole problem as one objective: every term of the registry, summed over all frames."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from vip_factors.assembly.accumulator import Accumulator
from vip_factors.assembly.charts import Charts
from vip_factors.assembly.compiled_sums import CompiledAccumulator
from vip_factors.assembly.system import Part, SceneSystem, Steps, parts_of
from vip_factors.body.kinematics import BodyState
from vip_factors.compiled import Kernels, kernels
from vip_factors.problem.layout import Layout, Owner, OwnerId
from vip_factors.problem.scene import SceneProblem
from vip_factors.problem.state import SceneState
from vip_factors.problem.variables import camera_owner, scene_layout
from vip_factors.solve.slices import Blocks, Slices
from vip_factors.terms.equations import Equations, Term
from vip_factors.terms.evaluation import CameraEvaluation, ViewEvaluation, WearerEvaluation
from vip_factors.terms.registry import CAMERA_TERMS, VIEW_TERMS, WEARER_TERMS


class SceneEvaluation:
    """A scene at a state: all that its terms look at.

    Args:
        problem, state: the scene's.
        wearers_move: whether terms on the wearers alone are of interest.
    """

    def __init__(self, problem: SceneProblem, state: SceneState, wearers_move: bool = True) -> None:
        self.wearers = [
            WearerEvaluation(number, wearer, own)
            for number, (wearer, own) in enumerate(zip(problem.wearers, state.wearers, strict=True))
        ]
        self.bodies = [wearer.body for wearer in self.wearers]  # once, and before threads ask for them
        self._offsets = state.detector.keypoint_offsets, problem.free_keypoints
        self.cameras = [
            CameraEvaluation(number, camera, own, problem.frames, problem.step, *self._offsets)
            for number, (camera, own) in enumerate(zip(problem.cameras, state.cameras, strict=True))
        ]
        self._viewpoints = problem.viewpoints(state)
        self._wearers_move = wearers_move

    def equations(self) -> Iterator[tuple[str, Equations]]:
        """Of all factors, with their kinds."""
        bodies = (self.of_body(number) for number in range(len(self.wearers)))
        for term, at in itertools.chain(*bodies, self.of_cameras()):
            yield from ((term.kind, one) for one in term.all(at))

    def of_body(self, number: int) -> Iterator[tuple[Term[Any], Any]]:
        """The terms that see one of the wearers, each with what it looks at."""
        at = self.wearers[number].apart()
        if self._wearers_move:
            yield from ((term, at) for term in WEARER_TERMS)
        for camera, one in enumerate(self._viewpoints):
            view = ViewEvaluation(at, camera_owner(camera), one.problem, one.state, one.views[number], *self._offsets)
            yield from ((seen, view) for seen in VIEW_TERMS)

    def of_cameras(self) -> Iterator[tuple[Term[Any], Any]]:
        """Those that see a camera alone."""
        return ((term, camera) for camera in self.cameras for term in CAMERA_TERMS)

    def add_to(self, sums: Accumulator, wearers: Sequence[int], with_cameras: bool) -> None:
        """Sum what sees some wearers, and what sees cameras alone if asked to."""
        if with_cameras:
            for term, at in self.of_cameras():
                sums.add_term(term, at)
        for number in wearers:
            for term, at in self.of_body(number):
                sums.add_term(term, at)
        sums.finish()


class SceneObjective:
    """Cost, linearisation and retraction of a scene's problem.

    Args:
        problem: of the scene.
        wearers_move: False keeps the wearers as they are: the cameras alone follow them.
        kernels: to sum and to eliminate with.
        chunk: frames summed together: enough to amortise calls, few enough to stay in a processor's cache.
    """

    def __init__(
        self, problem: SceneProblem, wearers_move: bool = True, kernels: Kernels = kernels, chunk: int = 32
    ) -> None:
        self.problem, self._wearers_move, self._kernels = problem, wearers_move, kernels
        self.layout = scene_layout(problem, wearers_move=wearers_move)
        self.parts = parts_of(problem, self.layout, chunk)

    def cost(self, state: SceneState) -> Mapping[str, float]:
        """Half the sum of squared whitened residuals, losses applied, by kind of factor."""
        costs: dict[str, float] = {}
        for kind, equations in SceneEvaluation(self.problem, state, self._wearers_move).equations():
            costs[kind] = costs.get(kind, 0.0) + equations.cost
        if self.problem.extra is not None:
            costs["extra"] = self.problem.extra.cost(self.problem, state)
        return costs

    def linearise(self, state: SceneState) -> SceneSystem:
        """The normal equations at a state; those before it are no more, for their memory is taken."""
        evaluation, problem, parts = SceneEvaluation(self.problem, state, self._wearers_move), self.problem, self.parts
        extra = None if problem.extra is None else problem.extra.linearised(problem, self.layout, state)

        def add(blocks: Blocks, part: Part, begin: int) -> None:
            sums = accumulator(part.layout, blocks, begin, evaluation.bodies, kernels=self._kernels)
            evaluation.add_to(sums, part.wearers, part.has_cameras)
            if extra is not None:
                extra.add_to(blocks, begin)

        if extra is not None:  # all is one part then
            width = self.layout.static_width + extra.multipliers
            parts = [replace(part, shape=replace(part.shape, static=width)) for part in parts]
        return SceneSystem(problem, state, self.layout, parts, add, self._kernels)

    def retract(self, state: SceneState, steps: Steps) -> SceneState:
        """The state moved by a solution of the linear system."""
        state = state.retract_frames(self.layout, steps.frames).retract_static(self.layout, steps.static)
        for number, later in steps.later_headings.items():
            own = state.wearers[number]
            moved = replace(own, later_headings=own.later_headings + later)
            state = state.replaced({OwnerId(Owner.WEARER, number): moved})
        return state


def accumulator(
    layout: Layout, blocks: Blocks, begin: int, bodies: Sequence[BodyState], charts: Charts | None = None,
    kernels: Kernels = kernels,
) -> Accumulator:  # fmt: skip
    """Sums of terms, by compiled code where it was built."""
    return (Accumulator if kernels is None else CompiledAccumulator)(layout, blocks, begin, bodies, charts)


def joined_slices(
    layouts: Sequence[Layout], problem: SceneProblem, state: SceneState, slices: Sequence[Slices],
    charts: Charts | None = None, kernels: Kernels = kernels,
) -> list[Slices]:  # fmt: skip
    """The slices of a scene's problem at a state, in the memory of earlier ``slices`` if that is enough.

    They are apart for each wearer, whose layout has the cameras' variables too, and last for the cameras alone. A
    single layout is of all.
    """
    slices = [one.emptied(problem.frames) for one in slices]
    evaluation, wearers = SceneEvaluation(problem, state), range(len(problem.wearers))
    apart = [[number] for number in wearers] + [[]] if len(layouts) > 1 else [list(wearers)]
    for layout, one, own in zip(layouts, slices, apart, strict=True):
        sums = accumulator(layout, one.blocks(problem.frames), 0, evaluation.bodies, charts, kernels)
        evaluation.add_to(sums, own, with_cameras=one is slices[-1])
    return slices
