"""Objective of a scene: every term of the registry, summed over all frames."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from vip_factors.assembly.accumulator import Accumulator
from vip_factors.assembly.charts import Charts
from vip_factors.assembly.compiled_sums import CompiledAccumulator
from vip_factors.assembly.system import SceneSystem, Steps, VariableGroup, variable_groups
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
    """Evaluation of a scene at a state: the arguments of its terms.

    Args:
        problem, state: of the scene.
        wearers_move: False leaves out the terms on wearers alone.
    """

    def __init__(self, problem: SceneProblem, state: SceneState, wearers_move: bool = True) -> None:
        self.wearers = [
            WearerEvaluation(number, wearer, wearer_state)
            for number, (wearer, wearer_state) in enumerate(zip(problem.wearers, state.wearers, strict=True))
        ]
        self.bodies = [wearer.body for wearer in self.wearers]  # computed once, before threads use them
        self._offsets = state.detector.keypoint_offsets, problem.free_keypoints
        self.cameras = [
            CameraEvaluation(number, camera, camera_state, problem.frames, problem.step, *self._offsets)
            for number, (camera, camera_state) in enumerate(zip(problem.cameras, state.cameras, strict=True))
        ]
        self._viewpoints = problem.viewpoints(state)
        self._wearers_move = wearers_move

    def equations(self) -> Iterator[tuple[str, Equations]]:
        """Yield the equations of all factors with their kinds."""
        bodies = (self.wearer_terms(number) for number in range(len(self.wearers)))
        for term, evaluation in itertools.chain(*bodies, self.camera_terms()):
            yield from ((term.kind, equations) for equations in term.all_equations(evaluation))

    def wearer_terms(self, number: int) -> Iterator[tuple[Term[Any], Any]]:
        """Yield the terms on a wearer, each with its evaluation."""
        wearer = self.wearers[number].copy_for_thread()
        if self._wearers_move:
            yield from ((term, wearer) for term in WEARER_TERMS)
        for camera, viewpoint in enumerate(self._viewpoints):
            arguments = viewpoint.problem, viewpoint.state, viewpoint.views[number]
            view = ViewEvaluation(wearer, camera_owner(camera), *arguments, *self._offsets)
            yield from ((term, view) for term in VIEW_TERMS)

    def camera_terms(self) -> Iterator[tuple[Term[Any], Any]]:
        """Yield the terms on cameras alone, each with its evaluation."""
        return ((term, camera) for camera in self.cameras for term in CAMERA_TERMS)

    def add_to(self, sums: Accumulator, wearers: Sequence[int], with_cameras: bool) -> None:
        """Sum the terms on some wearers, and those on cameras alone if ``with_cameras``."""
        if with_cameras:
            for term, evaluation in self.camera_terms():
                sums.add_term(term, evaluation)
        for number in wearers:
            for term, evaluation in self.wearer_terms(number):
                sums.add_term(term, evaluation)
        sums.finish()


class SceneObjective:
    """Cost, linearisation and retraction of a scene's problem.

    Args:
        problem: of the scene.
        wearers_move: False holds the wearers constant; only cameras are variables.
        kernels: compiled kernels, or None for NumPy.
        chunk: frames summed together: enough to amortise calls, few enough for a processor's cache.
    """

    def __init__(
        self, problem: SceneProblem, wearers_move: bool = True, kernels: Kernels = kernels, chunk: int = 32
    ) -> None:
        self.problem, self._wearers_move, self._kernels = problem, wearers_move, kernels
        self.layout = scene_layout(problem, wearers_move=wearers_move)
        self.groups = variable_groups(problem, self.layout, chunk)

    def cost(self, state: SceneState) -> Mapping[str, float]:
        """Half the sum of squared whitened residuals, with robust losses, by kind of factor."""
        costs: dict[str, float] = {}
        for kind, equations in SceneEvaluation(self.problem, state, self._wearers_move).equations():
            costs[kind] = costs.get(kind, 0.0) + equations.cost
        if self.problem.extra is not None:
            costs["extra"] = self.problem.extra.cost(self.problem, state)
        return costs

    def linearise(self, state: SceneState) -> SceneSystem:
        """Build the normal equations at a state; they reuse the memory of earlier ones, which become invalid."""
        evaluation, problem = SceneEvaluation(self.problem, state, self._wearers_move), self.problem
        groups = self.groups
        extra = None if problem.extra is None else problem.extra.linearised(problem, self.layout, state)

        def add(blocks: Blocks, group: VariableGroup, begin: int) -> None:
            sums = accumulator(group.layout, blocks, begin, evaluation.bodies, kernels=self._kernels)
            evaluation.add_to(sums, group.wearers, group.has_cameras)
            if extra is not None:
                extra.add_to(blocks, begin)

        if extra is not None:  # there is only one group then
            width = self.layout.static_width + extra.multipliers
            groups = [replace(group, shape=replace(group.shape, static=width)) for group in groups]
        return SceneSystem(problem, state, self.layout, groups, add, self._kernels)

    def retract(self, state: SceneState, steps: Steps) -> SceneState:
        """Move a state by a solution of the linear system."""
        state = state.retract_frames(self.layout, steps.frames).retract_static(self.layout, steps.static)
        for number, headings in steps.later_headings.items():
            wearer = state.wearers[number]
            moved = replace(wearer, later_headings=wearer.later_headings + headings)
            state = state.replaced({OwnerId(Owner.WEARER, number): moved})
        return state


def accumulator(
    layout: Layout,
    blocks: Blocks,
    begin: int,
    bodies: Sequence[BodyState],
    charts: Charts | None = None,
    kernels: Kernels = kernels,
) -> Accumulator:
    """Make an accumulator, a compiled one if there are kernels."""
    return (Accumulator if kernels is None else CompiledAccumulator)(layout, blocks, begin, bodies, charts)


def joined_slices(
    layouts: Sequence[Layout],
    problem: SceneProblem,
    state: SceneState,
    slices: Sequence[Slices],
    charts: Charts | None = None,
    kernels: Kernels = kernels,
) -> list[Slices]:
    """Sum a scene's problem at a state into slices, in the memory of ``slices`` if it suffices.

    There is one layout for each wearer with the cameras, then one for the cameras alone; or a single one for all.
    """
    slices = [target.emptied(problem.frames) for target in slices]
    evaluation, wearers = SceneEvaluation(problem, state), range(len(problem.wearers))
    wearer_groups = [[number] for number in wearers] + [[]] if len(layouts) > 1 else [list(wearers)]
    for layout, target, numbers in zip(layouts, slices, wearer_groups, strict=True):
        sums = accumulator(layout, target.blocks(problem.frames), 0, evaluation.bodies, charts, kernels)
        evaluation.add_to(sums, numbers, with_cameras=target is slices[-1])
    return slices
