"""A whole problem as one objective: every term of the registry, summed over all frames."""

import itertools
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Protocol, TypeVar

import numpy as np

from vip_factors.assembly.accumulator import Accumulator
from vip_factors.assembly.chain import ChainAccumulator
from vip_factors.assembly.charts import Charts
from vip_factors.assembly.compiled_sums import CompiledChainAccumulator, CompiledSliceAccumulator
from vip_factors.assembly.slices import SliceAccumulator
from vip_factors.compiled import Kernels, kernels
from vip_factors.geometry.rotations import Array
from vip_factors.problem.layout import Layout, Owner, OwnerId
from vip_factors.problem.scene import SceneProblem
from vip_factors.problem.state import SceneState
from vip_factors.problem.variables import STEP_ANGLE, scene_layout
from vip_factors.solve.chain_system import REACH, Chain, ChainSystem, StaticGroup, frame_keys, knot_key, static_key
from vip_factors.solve.knots import KnotSystem
from vip_factors.solve.slices import Slices
from vip_factors.terms.equations import Equations, Term
from vip_factors.terms.evaluation import CameraEvaluation, ViewEvaluation, WearerEvaluation
from vip_factors.terms.registry import CAMERA_TERMS, VIEW_TERMS, WEARER_TERMS


class Step(Protocol):
    """A solution of the linear system: vectors by key."""

    def at(self, key: int) -> Array:
        """One of them."""
        ...


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
        self.camera = CameraEvaluation(problem.camera, state.camera, problem.frames, problem.step, *self._offsets)
        self._viewpoints = problem.viewpoints(state.camera)
        self._wearers_move = wearers_move

    def equations(self) -> Iterator[tuple[str, Equations]]:
        """Of all factors, with their kinds."""
        bodies = (self.of_body(number) for number in range(len(self.wearers)))
        for term, at in itertools.chain(*bodies, self.of_camera()):
            yield from ((term.kind, one) for one in term.all(at))

    def of_body(self, number: int) -> Iterator[tuple[Term[Any], Any]]:
        """The terms that see one of the wearers, each with what it looks at."""
        at = self.wearers[number].apart()
        if self._wearers_move:
            yield from ((term, at) for term in WEARER_TERMS)
        for camera, one in enumerate(self._viewpoints):
            owner = OwnerId(Owner.CAMERA, camera)
            view = ViewEvaluation(at, owner, one.problem, one.state, one.views[number], *self._offsets)
            yield from ((seen, view) for seen in VIEW_TERMS)

    def of_camera(self) -> Iterator[tuple[Term[Any], Any]]:
        """Those that see the camera alone."""
        return ((term, self.camera) for term in CAMERA_TERMS)

    def add_bodies_to(self, sums: Accumulator) -> None:
        """Sum what sees a wearer in an accumulator's stretch."""
        for number in range(len(self.wearers)):
            for term, at in self.of_body(number):
                sums.add_term(term, at)
        sums.finish(self.bodies)

    def add_camera_to(self, sums: Accumulator) -> None:
        """Sum what sees the camera alone; it is little, and one stretch of all frames is the fastest."""
        for term, at in self.of_camera():
            sums.add_term(term, at)


class SceneObjective:
    """Cost, linearisation and retraction of a scene's problem.

    Args:
        problem: of the scene.
        wearers_move: False keeps the wearers as they are: the camera alone follows them.
        kernels: to sum the terms with.
        chunk: frames evaluated together: enough to amortise calls, few enough to stay in a processor's cache. At
            least REACH, for a stretch writes into so many frames behind it, while the one after the next is summed.
    """

    def __init__(
        self, problem: SceneProblem, wearers_move: bool = True, kernels: Kernels = kernels, chunk: int = 32
    ) -> None:
        self.problem, self._wearers_move, self._chunk = problem, wearers_move, chunk
        is_pure = kernels is None or problem.extra is not None
        self._accumulator = ChainAccumulator if is_pure else CompiledChainAccumulator
        self.layout = scene_layout(problem, wearers_move=wearers_move)
        self.static_keys = [static_key(group) for group in range(len(self.layout.owners))]
        self._system: ChainSystem | None = None

    def frame_keys(self, owner: OwnerId) -> list[int] | None:
        """GTSAM's names of an owner's frames in the linear system; None where it has none."""
        chain = self.layout.chain_of(owner)
        return None if chain is None else frame_keys(chain, self.problem.frames)

    def static_columns(self, owner: OwnerId) -> tuple[int, slice] | None:
        """GTSAM's name of an owner's static variables, and their columns in the static vector; None without any."""
        for key, (one, columns) in zip(self.static_keys, self.layout.owners, strict=True):
            if one == owner:
                return key, columns
        return None

    def cost(self, state: SceneState) -> Mapping[str, float]:
        """Half the sum of squared whitened residuals, losses applied, by kind of factor."""
        costs: dict[str, float] = {}
        for kind, equations in SceneEvaluation(self.problem, state, self._wearers_move).equations():
            costs[kind] = costs.get(kind, 0.0) + equations.cost
        if self.problem.extra is not None:
            costs["extra"] = self.problem.extra.cost(self.problem, state)
        return costs

    def linearise(self, state: SceneState) -> ChainSystem:
        """The normal equations at a state, in the memory of those before, which are no more."""
        evaluation, T = SceneEvaluation(self.problem, state, self._wearers_move), self.problem.frames
        system = self._system.emptied() if self._system is not None else self._empty_system()
        self._system = system
        sums = [self._accumulator(self.layout, system, t, min(self._chunk, T - t)) for t in range(0, T, self._chunk)]

        def add(stretch: ChainAccumulator, first: int, behind: int) -> None:
            system.empty_frames(stretch.begin + first, stretch.begin + stretch.count + behind)
            evaluation.add_bodies_to(stretch)

        # Each may write into the first frames of the next.
        parallel_map(lambda stretch: add(stretch, 0, REACH), sums[::2])
        parallel_map(lambda stretch: add(stretch, REACH, 0), sums[1::2])
        camera = ChainAccumulator(self.layout, system, 0, T)
        evaluation.add_camera_to(camera)
        for one in (*sums, camera):
            system.static += one.static
            system.static_gradient += one.static_gradient
        if self.problem.extra is not None:
            system.extra = list(self.problem.extra.linearised(self.problem, self.layout, state))
        return system

    def _empty_system(self) -> ChainSystem:
        layout, T, s = self.layout, self.problem.frames, self.layout.static_width
        groups = [StaticGroup(key, columns) for key, (_, columns) in zip(self.static_keys, layout.owners, strict=True)]
        system = ChainSystem([], groups, np.zeros((s, s)), np.zeros(s), layout.per_column("step") ** -2.0)
        for p, chain in enumerate(layout.chains):
            met = [
                (system.between, q, other.width)
                for q, other in enumerate(layout.chains)
                if q > p and other.owner.kind is not Owner.WEARER
            ] + [
                (system.coupling, g, columns.stop - columns.start)
                for g, (owner, columns) in enumerate(layout.owners)
                if owner == chain.owner or owner.kind is not Owner.WEARER or chain.owner.kind is not Owner.WEARER
            ]
            others = sum(width for *_, width in met)
            walk = 2 * len(self.problem.wearers[chain.owner.number].sensors) * self._headings_walk(chain.owner)
            own = Chain.empty(p, T, chain.step**-2.0, self._is_tied(chain.owner), others + walk)
            start = own.rows.shape[2] - others - walk
            for blocks, number, width in met:
                blocks[p, number] = own.rows[:, :, start : start + width]
                start += width
            system.chains.append(own)
        for number, (group, (owner, _)) in enumerate(zip(groups, layout.owners, strict=True)):
            group.knots = self._knots(number, owner, group.columns, system.chains)
        return system

    def _is_tied(self, owner: OwnerId) -> bool:
        """Whether frames are tied to their neighbours; those of the inertial tracker are not."""
        return owner.kind is Owner.CAMERA or self.problem.wearers[owner.number].use_acceleration

    def _headings_walk(self, owner: OwnerId) -> bool:
        if owner.kind is not Owner.WEARER:
            return False
        wearer = self.problem.wearers[owner.number]
        return wearer.free_headings and wearer.headings_walk

    def _knot_keys(self, group: int, owner: OwnerId) -> list[int]:
        knots = len(self.problem.wearers[owner.number].heading_knots)
        return [knot_key(group, knot) for knot in range(1, knots)]

    def _knots(self, group: int, owner: OwnerId, columns: slice, chains: Sequence[Chain]) -> KnotSystem | None:
        chain = self.layout.chain_of(owner)
        if chain is None or not self._headings_walk(owner):
            return None
        wearer = self.problem.wearers[owner.number]
        weights = wearer.knot_weights()
        assert weights is not None
        return KnotSystem.empty(
            chain, self._knot_keys(group, owner), weights, chains[chain].rows, len(wearer.sensors),
            columns.stop - columns.start, STEP_ANGLE**-2.0,
        )  # fmt: skip

    def retract(self, state: SceneState, delta: Step) -> SceneState:
        """The state moved by a solution of the linear system."""
        layout = self.layout
        if layout.chains:
            keys = [frame_keys(number, self.problem.frames) for number in range(len(layout.chains))]
            steps = np.concatenate([np.array([delta.at(key) for key in own]) for own in keys], axis=1)
            state = state.retract_frames(layout, steps)
        static = np.concatenate([np.zeros(0), *(delta.at(key) for key in self.static_keys)])
        state = state.retract_static(layout, static)
        for group, (owner, _) in enumerate(layout.owners):
            if self._headings_walk(owner):
                walk = np.array([delta.at(key) for key in self._knot_keys(group, owner)])
                state = state.replaced({owner: state.wearers[owner.number].with_walk(walk)})
        return state


def joined_slices(
    layouts: Sequence[Layout], problem: SceneProblem, state: SceneState, slices: Sequence[Slices],
    charts: Charts | None = None, kernels: Kernels = kernels,
) -> list[Slices]:  # fmt: skip
    """The slices of a scene's problem at a state, in the memory of earlier ``slices`` if that is enough.

    They are apart for each wearer, whose layout has the camera's variables too, and last for the camera alone. A single
    layout is of all.
    """
    slices = [one.emptied(problem.frames) for one in slices]
    kind = SliceAccumulator if kernels is None else CompiledSliceAccumulator
    sums = [kind(layout, one, problem.frames, charts) for layout, one in zip(layouts, slices, strict=True)]
    evaluation = SceneEvaluation(problem, state)
    evaluation.add_camera_to(sums[-1])
    for number in range(len(problem.wearers)):
        own = sums[number if len(sums) > 1 else 0]
        for term, at in evaluation.of_body(number):
            own.add_term(term, at)
    for own in sums:
        own.finish(evaluation.bodies)
    return slices


THREADS = min(4, os.cpu_count() or 1)  # beyond four the interpreter's own share is what takes the time


Stretch = TypeVar("Stretch")


def parallel_map(work: Callable[[Stretch], None], stretches: Sequence[Stretch]) -> None:
    """Do the work for each stretch of frames, in threads; stretches write to places of their own."""
    if len(stretches) < 2 or THREADS < 2:
        for stretch in stretches:
            work(stretch)
        return
    with ThreadPoolExecutor(min(THREADS, len(stretches))) as pool:
        list(pool.map(work, stretches))  # the list raises what a stretch raised
