"""Normal equations of a scene, summed and eliminated a stretch of frames at a time.

Groups of variables without common factors in a frame (wearers before a static camera) are eliminated one after the
other, at a cost that is linear in their number.
"""

import itertools
import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg.blas import dtrsv
from scipy.linalg.lapack import dpotrf

from vip_factors.body.kinematics import MOVES
from vip_factors.body.skeleton import JOINT_COUNT
from vip_factors.compiled import Kernels, kernels
from vip_factors.errors import SolveError
from vip_factors.geometry.rotations import Array
from vip_factors.problem.layout import ROOT, Layout, Owner, OwnerId
from vip_factors.problem.scene import SceneProblem
from vip_factors.problem.state import SceneState
from vip_factors.problem.wearer import WearerProblem
from vip_factors.solve.band import Band, BandElimination, Multipliers, Shape, inverse_of_square
from vip_factors.solve.nested_dissection import Chain, NestedElimination
from vip_factors.solve.slices import Blocks
from vip_factors.terms.heading_walk import step_sigmas

THREADS = min(4, os.cpu_count() or 1)  # sum ahead of the elimination; more would compete for the interpreter
UNKNOWN = 1e8  # rad² or m²: variance above which a variable counts as undetermined


@dataclass
class VariableGroup:
    """Variables that are eliminated together.

    Attributes:
        layout: of the group.
        frame, static: columns of the group in the vector of a frame and in the static vector.
        wearers: numbers of the wearers whose terms belong to the group.
        has_cameras: True if the terms of cameras alone belong to the group.
        shape: dimensions of the chain.
        drifting: numbers of the wearers whose headings drift.
        stretches: stretches of frames with constant headings.
        wearer_groups: for several wearers before moving cameras, a group for each wearer with the cameras; its columns
            refer to this group. Nested dissection eliminates them faster.
        memory: the previous elimination, whose arrays are reused.
    """

    layout: Layout
    frame: np.ndarray
    static: np.ndarray
    wearers: list[int]
    has_cameras: bool
    shape: Shape
    drifting: list[int]
    stretches: list[slice]
    wearer_groups: list["VariableGroup"] = field(default_factory=list)
    memory: BandElimination | None = field(default=None, repr=False)


def owners_together(layout: Layout, together: bool) -> list[set[OwnerId]]:
    """Group the owners of variables: all together, or each wearer with the cameras."""
    owners = {chain.owner for chain in layout.chains} | {owner for owner, _ in layout.blocks}
    wearers = sorted(owner for owner in owners if owner.kind is Owner.WEARER)
    if together or len(wearers) < 2:
        return [owners]
    return [{wearer} | owners.difference(wearers) for wearer in wearers]


def far_columns(layout: Layout, wearers: Sequence[WearerProblem]) -> np.ndarray:
    """Columns of a frame that move a sensor or camera: accelerations connect these with the frame two before it."""
    is_far = np.ones(layout.frame_width, bool)
    for chain, columns in zip(layout.chains, layout.chain_columns, strict=True):
        if chain.owner.kind is Owner.WEARER:
            bones = [sensor.bone for sensor in wearers[chain.owner.number].sensors]
            is_far[columns][:ROOT] = np.repeat(MOVES[:JOINT_COUNT, bones].any(axis=1), 3)
    return np.flatnonzero(is_far)


def variable_groups(problem: SceneProblem, layout: Layout, chunk: int) -> list[VariableGroup]:
    """Divide a problem into groups, and its frames into stretches of at most ``chunk`` frames."""
    moving = any(chain.owner.kind is Owner.CAMERA for chain in layout.chains)
    groups = list[VariableGroup]()
    for owners in owners_together(layout, moving or problem.extra is not None):
        group = _group_of(problem, layout, owners, moving, not groups)
        cuts = {0, problem.frames}.union(*(_cuts(problem.wearers[number]) for number in group.drifting))
        group.stretches = [
            slice(begin, min(begin + chunk, end))
            for begin, end in itertools.pairwise(sorted(cuts))
            for begin in range(begin, end, chunk)
        ]
        wearers = [chain for chain in group.layout.chains if chain.owner.kind is Owner.WEARER]
        if moving and problem.extra is None and len(wearers) > 1:
            for members in owners_together(group.layout, together=False):
                is_first = not group.wearer_groups
                group.wearer_groups.append(_group_of(problem, group.layout, members, moving, is_first))
        groups.append(group)
    return groups


def _group_of(
    problem: SceneProblem, layout: Layout, owners: set[OwnerId], moving: bool, has_cameras: bool
) -> VariableGroup:
    """Make the group of some owners, without stretches; its columns refer to ``layout``."""
    group_layout = layout.of_owners(owners)
    wearers = [chain.owner.number for chain in group_layout.chains if chain.owner.kind is Owner.WEARER]
    tied = moving or any(problem.wearers[number].use_acceleration for number in wearers)
    far = (
        np.arange(group_layout.frame_width) if problem.extra is not None else far_columns(group_layout, problem.wearers)
    )
    drift = [wearer.free_headings and wearer.headings_drift for wearer in problem.wearers]
    return VariableGroup(
        layout=group_layout,
        frame=layout.frame_columns(owners),
        static=layout.static_columns(owners),
        wearers=wearers or list(range(len(problem.wearers))),
        has_cameras=has_cameras,
        shape=Shape(group_layout.frame_width, group_layout.static_width, far, tied),
        drifting=[number for number in wearers if drift[number]],
        stretches=[],
    )


def _cuts(wearer: WearerProblem) -> set[int]:
    """Frames at which headings change."""
    return set((np.flatnonzero(np.diff(wearer.heading_numbers())) + 1).tolist())


@dataclass(frozen=True)
class Steps:
    """Solution of the linear system.

    Attributes:
        frames: steps ``(T, w)`` of frames.
        static: steps ``(s,)`` of static variables.
        later_headings: steps ``(K − 1, S)`` of drifting headings after the first ones, by wearer.
    """

    frames: Array
    static: Array
    later_headings: dict[int, Array]


@dataclass(frozen=True)
class Marginals:
    """Marginal covariances: ``(T, w, w)`` of each chain of the layout, ``(s, s)`` of the static variables."""

    chains: list[Array]
    static: Array


class SceneSystem:
    """Linearisation of a scene. Normal equations are summed again for every elimination, to save memory.

    Args:
        problem, state, layout, groups: of the scene.
        add: adds to blocks the factors of a group whose first frame is in the stretch that begins at a given frame.
        kernels: compiled kernels, or None for NumPy.
    """

    def __init__(
        self,
        problem: SceneProblem,
        state: SceneState,
        layout: Layout,
        groups: Sequence[VariableGroup],
        add: Callable[[Blocks, VariableGroup, int], None],
        kernels: Kernels = kernels,
    ) -> None:
        self._kernels = kernels
        self._problem, self._state, self._layout, self._groups, self._add = problem, state, layout, groups, add

    def bands(self, groups: Sequence[VariableGroup], stretches: Sequence[slice]) -> Iterator[list[Band]]:
        """Yield the normal equations of groups, stretch by stretch; later stretches overwrite earlier ones."""
        longest = max(stretch.stop - stretch.start for stretch in stretches)
        free = [[Band(group.shape, longest, self._kernels) for group in groups] for _ in range(THREADS)]
        summed = deque[tuple[list[Band], Future[list[Band]]]]()

        def work(memory: list[Band], stretch: slice) -> list[Band]:
            bands = [band.first(stretch.stop - stretch.start) for band in memory]
            for band, group in zip(bands, groups, strict=True):
                band.empty()
                self._add(band.blocks, group, stretch.start)
            return bands

        with ThreadPoolExecutor(max(THREADS - 1, 1)) as pool:
            for stretch in stretches:
                if not free:
                    memory, done = summed.popleft()
                    yield done.result()
                    free.append(memory)
                memory = free.pop()
                summed.append((memory, pool.submit(work, memory, stretch)))
            for _, done in summed:
                yield done.result()

    def _elimination(self, group: VariableGroup, damping: Array, groups: Sequence[VariableGroup]) -> BandElimination:
        """Make the elimination of a group that takes one band for each of ``groups``."""
        if len(groups) == 1:
            group.memory = BandElimination(group.shape, damping, group.memory, self._kernels)
        else:
            chains = [Chain(member.frame, member.static) for member in groups]
            common = sum(chain.width for chain in groups[0].layout.chains if chain.owner.kind is Owner.CAMERA)
            group.memory = NestedElimination(group.shape, damping, group.memory, chains, common, self._kernels)
        return group.memory

    def _eliminated(self, damping: float) -> tuple[list[tuple[BandElimination, Multipliers]], Array, Array]:
        """Eliminate all frames; also returns the triangular factor and the vector of the static variables."""
        layout = self._layout
        H, v = np.diag(damping * layout.per_column("step") ** -2.0), np.zeros(layout.static_width)
        steps = np.concatenate([np.zeros(0), *(chain.step for chain in layout.chains)])
        eliminations = list[tuple[BandElimination, Multipliers]]()
        for group in self._groups:
            groups = group.wearer_groups or [group]
            elimination = self._elimination(group, damping * steps[group.frame] ** -2.0, groups)
            for stretch, bands in zip(group.stretches, self.bands(groups, group.stretches), strict=True):
                elimination.eliminate(*bands)
                if stretch.stop < self._problem.frames:
                    elimination.step(*self._heading_steps(group, stretch.stop))
            multipliers, information, vector = Multipliers.eliminated(*elimination.border, len(group.static))
            H[np.ix_(group.static, group.static)] += information
            v[group.static] += vector
            eliminations.append((elimination, multipliers))
        R, failed = dpotrf(H) if len(v) else (H, 0)
        if failed:
            raise SolveError("the linear system is not determined")
        return eliminations, R, v

    def _heading_steps(self, group: VariableGroup, frame: int) -> tuple[np.ndarray, Array, Array]:
        """Headings that step before a frame: columns, standard deviations, and differences at the state."""
        columns, sigmas, differences = [np.zeros(0, int)], [np.zeros(0)], [np.zeros(0)]
        for number in group.drifting:
            wearer, path = self._problem.wearers[number], self._state.wearers[number].heading_path
            previous, current = wearer.heading_numbers(slice(frame - 1, frame + 1))
            if previous != current:
                columns.append(group.layout.columns(OwnerId(Owner.WEARER, number), "headings"))
                sigmas.append(step_sigmas(wearer)[previous])
                differences.append(path[current] - path[previous])
        return np.concatenate(columns), np.concatenate(sigmas), np.concatenate(differences)

    def step(self, damping: float) -> Steps:
        """Minimise the quadratic with ``damping`` added to the diagonal, in units of each variable's scale.

        Raises:
            SolveError: if a variable is not determined.
        """
        eliminations, R, v = self._eliminated(damping)
        shared = dtrsv(R, dtrsv(R, v, trans=1)) if len(v) else v
        frames, static, later_headings = np.zeros((self._problem.frames, self._layout.frame_width)), shared.copy(), {}
        for group, (elimination, multipliers) in zip(self._groups, eliminations, strict=True):
            frames[:, group.frame], borders = elimination.given(multipliers.given(shared[group.static]))
            static[group.static] = borders[0, : len(group.static)]
            for number in group.drifting:
                columns = group.layout.columns(OwnerId(Owner.WEARER, number), "headings")
                later_headings[number] = self._later_headings(group, number, borders[:, columns])
        return Steps(frames, static, later_headings)

    def _later_headings(self, group: VariableGroup, number: int, headings: Array) -> Array:
        """Select a wearer's ``(K − 1, S)`` later headings from those ``(n, S)`` between all steps of a group."""
        changes = sorted(set().union(*(_cuts(self._problem.wearers[other_number]) for other_number in group.drifting)))
        indices = np.searchsorted(changes, sorted(_cuts(self._problem.wearers[number])), side="right")
        return headings[indices]

    def static_covariance(self) -> Array:
        """Joint covariance ``(s, s)`` of static variables, including the first values of drifting headings.

        Covariances between groups with drifting headings refer to the last values.

        Raises:
            SolveError: if a variable is not determined.
        """
        eliminations, R, _ = self._eliminated(0.0)
        covariance = inverse_of_square(R)
        for group, (elimination, multipliers) in zip(self._groups, eliminations, strict=True):
            if group.drifting:
                places, n = np.ix_(group.static, group.static), len(group.static)
                *_, (_, first_border) = elimination.marginals(multipliers.covariance(covariance[places]))
                covariance[places] = first_border[:n, :n]
        return covariance

    def marginals(self, progress: Callable[[float], None] = lambda done: None) -> Marginals:
        """Marginal covariances of all variables; ``progress`` is called with the fraction done.

        Raises:
            SolveError: if a variable is not determined.
        """
        progress(0.0)
        undetermined = SolveError("standard deviations: the data do not determine all variables")
        try:
            eliminations, R, _ = self._eliminated(0.0)
        except SolveError as error:
            raise undetermined from error
        covariance, T, done, first_border = inverse_of_square(R), self._problem.frames, 0, np.zeros((0, 0))
        chains = [np.empty((T, chain.width, chain.width)) for chain in self._layout.chains]
        for group, (elimination, multipliers) in zip(self._groups, eliminations, strict=True):
            numbers = [self._layout.chain_of(chain.owner) for chain in group.layout.chains]
            places, t = np.ix_(group.static, group.static), T
            for frame_covariance, border in elimination.marginals(multipliers.covariance(covariance[places])):
                first_border = border[: len(group.static), : len(group.static)]
                if frame_covariance is not None:
                    t, done = t - 1, done + 1
                    if np.diag(frame_covariance).max(initial=0.0) > UNKNOWN:
                        raise undetermined
                    for number, columns in zip(numbers, group.layout.chain_columns, strict=True):
                        assert number is not None
                        chains[number][t] = frame_covariance[columns, columns]
                    progress(done / (T * len(self._groups)))
            if group.drifting:
                covariance[places] = first_border
        progress(1.0)
        return Marginals(chains, covariance)
