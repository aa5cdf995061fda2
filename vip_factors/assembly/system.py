"""The normal equations of a scene, summed and eliminated a stretch of frames at a time.

Those whose frames have nothing in common are eliminated one after the other: wearers before a camera that stands still
cost what they cost alone.
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
from vip_factors.solve.apart import Chain, EliminationApart
from vip_factors.solve.band import Band, BandElimination, Multipliers, Shape, inverse_of_square
from vip_factors.solve.slices import Blocks
from vip_factors.terms.heading_walk import step_sigmas

THREADS = min(4, os.cpu_count() or 1)  # that sum ahead of the elimination: more share the interpreter
UNKNOWN = 1e8  # rad² or m²: what is not determined has such a variance, where rounding leaves it one


@dataclass
class Part:
    """Variables that are eliminated together.

    Attributes:
        layout: of the part.
        frame, static: its columns in the vector of a frame and in that of what all frames share.
        wearers: numbers of those whose terms it has.
        has_cameras: whether it has the terms of cameras alone.
        shape: of the chain.
        drifting: those of the wearers whose headings drift.
        stretches: of frames, in which headings are constant.
        wearer_parts: of several wearers before moving cameras each one's variables with the cameras', with columns
            among those of the part: they are quicker eliminated apart.
        memory: of the last elimination.
    """

    layout: Layout
    frame: np.ndarray
    static: np.ndarray
    wearers: list[int]
    has_cameras: bool
    shape: Shape
    drifting: list[int]
    stretches: list[slice]
    wearer_parts: list["Part"] = field(default_factory=list)
    memory: BandElimination | None = field(default=None, repr=False)


def owners_together(layout: Layout, together: bool) -> list[set[OwnerId]]:
    """Whose variables are solved for together: all, or each wearer's with what films them."""
    owners = {one.owner for one in layout.chains} | {owner for owner, _ in layout.blocks}
    wearers = sorted(one for one in owners if one.kind is Owner.WEARER)
    if together or len(wearers) < 2:
        return [owners]
    return [{one} | owners.difference(wearers) for one in wearers]


def far_columns(layout: Layout, wearers: Sequence[WearerProblem]) -> np.ndarray:
    """Columns of a frame that the frame two before sees, by accelerations: where a sensor is, and where a camera."""
    seen = np.ones(layout.frame_width, bool)
    for chain, columns in zip(layout.chains, layout.chain_columns, strict=True):
        if chain.owner.kind is Owner.WEARER:
            bones = [sensor.bone for sensor in wearers[chain.owner.number].sensors]
            seen[columns][:ROOT] = np.repeat(MOVES[:JOINT_COUNT, bones].any(axis=1), 3)
    return np.flatnonzero(seen)


def parts_of(problem: SceneProblem, layout: Layout, chunk: int) -> list[Part]:
    """The parts of a problem, in stretches of so many frames at most."""
    moving = any(one.owner.kind is Owner.CAMERA for one in layout.chains)
    parts = list[Part]()
    for owners in owners_together(layout, moving or problem.extra is not None):
        part = _part_of(problem, layout, owners, moving, not parts)
        cuts = {0, problem.frames}.union(*(_cuts(problem.wearers[number]) for number in part.drifting))
        part.stretches = [
            slice(begin, min(begin + chunk, end))
            for begin, end in itertools.pairwise(sorted(cuts))
            for begin in range(begin, end, chunk)
        ]
        if moving and problem.extra is None and sum(one.owner.kind is Owner.WEARER for one in part.layout.chains) > 1:
            for each in owners_together(part.layout, together=False):
                part.wearer_parts.append(_part_of(problem, part.layout, each, moving, not part.wearer_parts))
        parts.append(part)
    return parts


def _part_of(problem: SceneProblem, layout: Layout, owners: set[OwnerId], moving: bool, has_cameras: bool) -> Part:
    """The part of some owners, whose columns are among those of a layout, without its stretches."""
    own = layout.of_owners(owners)
    wearers = [one.owner.number for one in own.chains if one.owner.kind is Owner.WEARER]
    tied = moving or any(problem.wearers[number].use_acceleration for number in wearers)
    far = np.arange(own.frame_width) if problem.extra is not None else far_columns(own, problem.wearers)
    drifting = [number for number in wearers
                if problem.wearers[number].free_headings and problem.wearers[number].headings_drift]  # fmt: skip
    return Part(
        layout=own, frame=layout.frame_columns(owners), static=layout.static_columns(owners),
        wearers=wearers or list(range(len(problem.wearers))), has_cameras=has_cameras,
        shape=Shape(own.frame_width, own.static_width, far, tied), drifting=drifting, stretches=[],
    )  # fmt: skip


def _cuts(wearer: WearerProblem) -> set[int]:
    """Frames from which on headings are others."""
    return set((np.flatnonzero(np.diff(wearer.heading_numbers())) + 1).tolist())


@dataclass(frozen=True)
class Steps:
    """A solution: steps ``(T, w)`` of frames, ``(s,)`` of what they share, and ``(K − 1, S)`` of later headings of
    wearers by number."""

    frames: Array
    static: Array
    later_headings: dict[int, Array]


@dataclass(frozen=True)
class Marginals:
    """Covariances: ``(T, w, w)`` of each chain of the layout, and of what frames share ``(s, s)``."""

    chains: list[Array]
    static: Array


class SceneSystem:
    """A linearisation, summed anew for every elimination: there is no room for it all.

    Args:
        problem, state, layout, parts: of the scene.
        add: sums the factors of a part whose first frames begin at one into blocks.
        kernels: to eliminate with.
    """

    def __init__(
        self, problem: SceneProblem, state: SceneState, layout: Layout, parts: Sequence[Part],
        add: Callable[[Blocks, Part, int], None], kernels: Kernels = kernels,
    ) -> None:  # fmt: skip
        self._kernels = kernels
        self._problem, self._state, self._layout, self._parts, self._add = problem, state, layout, parts, add

    def bands(self, parts: Sequence[Part], stretches: Sequence[slice]) -> Iterator[list[Band]]:
        """The normal equations of parts in each stretch, one after the other: they are overwritten by those after."""
        longest = max(one.stop - one.start for one in stretches)
        free = [[Band(part.shape, longest, self._kernels) for part in parts] for _ in range(THREADS)]
        summed = deque[tuple[list[Band], Future[list[Band]]]]()

        def work(memory: list[Band], stretch: slice) -> list[Band]:
            bands = [band.first(stretch.stop - stretch.start) for band in memory]
            for band, part in zip(bands, parts, strict=True):
                band.empty()
                self._add(band.blocks, part, stretch.start)
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

    def _elimination(self, part: Part, damping: Array, parts: Sequence[Part]) -> BandElimination:
        """Of one part, whose bands are those of ``parts``."""
        if len(parts) == 1:
            part.memory = BandElimination(part.shape, damping, part.memory, self._kernels)
        else:
            chains = [Chain(one.frame, one.static) for one in parts]
            met = sum(one.width for one in parts[0].layout.chains if one.owner.kind is Owner.CAMERA)
            part.memory = EliminationApart(part.shape, damping, part.memory, chains, met, self._kernels)
        return part.memory

    def _eliminated(
        self, damping: float, apart: bool = False
    ) -> tuple[list[tuple[BandElimination, Multipliers]], Array, Array]:
        """Frames eliminated, and what all say of what they share: the triangular factor, and the vector."""
        layout = self._layout
        H, v = np.diag(damping * layout.per_column("step") ** -2.0), np.zeros(layout.static_width)
        steps = np.concatenate([np.zeros(0), *(one.step for one in layout.chains)])
        found = list[tuple[BandElimination, Multipliers]]()
        for part in self._parts:
            parts = part.wearer_parts if apart and part.wearer_parts else [part]
            elimination = self._elimination(part, damping * steps[part.frame] ** -2.0, parts)
            for stretch, bands in zip(part.stretches, self.bands(parts, part.stretches), strict=True):
                elimination.eliminate(*bands)
                if stretch.stop < self._problem.frames:
                    elimination.step(*self._heading_steps(part, stretch.stop))
            multipliers, information, vector = Multipliers.eliminated(*elimination.border, len(part.static))
            H[np.ix_(part.static, part.static)] += information
            v[part.static] += vector
            found.append((elimination, multipliers))
        R, failed = dpotrf(H) if len(v) else (H, 0)
        if failed:
            raise SolveError("the linear system is not determined")
        return found, R, v

    def _heading_steps(self, part: Part, frame: int) -> tuple[np.ndarray, Array, Array]:
        """What steps before a frame: columns, sigmas, and by how much the headings are more behind the step."""
        columns, sigmas, differences = [np.zeros(0, int)], [np.zeros(0)], [np.zeros(0)]
        for number in part.drifting:
            wearer, path = self._problem.wearers[number], self._state.wearers[number].heading_path
            before, behind = wearer.heading_numbers(slice(frame - 1, frame + 1))
            if before != behind:
                columns.append(part.layout.columns(OwnerId(Owner.WEARER, number), "headings"))
                sigmas.append(step_sigmas(wearer)[before])
                differences.append(path[behind] - path[before])
        return np.concatenate(columns), np.concatenate(sigmas), np.concatenate(differences)

    def step(self, damping: float) -> Steps:
        """The minimum of the quadratic with ``damping`` units on the diagonal.

        Raises:
            SolveError: if a variable is not determined.
        """
        eliminations, R, v = self._eliminated(damping, apart=True)
        shared = dtrsv(R, dtrsv(R, v, trans=1)) if len(v) else v
        frames, static, later = np.zeros((self._problem.frames, self._layout.frame_width)), shared.copy(), {}
        for part, (elimination, multipliers) in zip(self._parts, eliminations, strict=True):
            frames[:, part.frame], borders = elimination.given(multipliers.given(shared[part.static]))
            static[part.static] = borders[0, : len(part.static)]
            for number in part.drifting:
                columns = part.layout.columns(OwnerId(Owner.WEARER, number), "headings")
                later[number] = self._later_headings(part, number, borders[:, columns])
        return Steps(frames, static, later)

    def _later_headings(self, part: Part, number: int, headings: Array) -> Array:
        """``(K − 1, S)`` of one wearer, of those ``(n, S)`` between all steps of a part."""
        changes = sorted(set().union(*(_cuts(self._problem.wearers[other]) for other in part.drifting)))
        own = np.searchsorted(changes, sorted(_cuts(self._problem.wearers[number])), side="right")
        return headings[own]

    def static_covariance(self) -> Array:
        """Joint covariance ``(s, s)`` of what all frames share, of headings that drift as they are at first; between
        parts with such it is of the last ones.

        Raises:
            SolveError: if a variable is not determined.
        """
        eliminations, R, _ = self._eliminated(0.0)
        covariance = inverse_of_square(R)
        for part, (elimination, multipliers) in zip(self._parts, eliminations, strict=True):
            if part.drifting:
                at, n = np.ix_(part.static, part.static), len(part.static)
                *_, (_, first) = elimination.marginals(multipliers.covariance(covariance[at]))
                covariance[at] = first[:n, :n]
        return covariance

    def marginals(self, progress: Callable[[float], None] = lambda done: None) -> Marginals:
        """Covariances of all variables; ``progress`` is told what fraction is done.

        Raises:
            SolveError: if a variable is not determined.
        """
        progress(0.0)
        undetermined = SolveError("standard deviations: the data do not determine everything that is looked for")
        try:
            eliminations, R, _ = self._eliminated(0.0)
        except SolveError as error:
            raise undetermined from error
        covariance, T, done, first = inverse_of_square(R), self._problem.frames, 0, np.zeros((0, 0))
        chains = [np.empty((T, one.width, one.width)) for one in self._layout.chains]
        for part, (elimination, multipliers) in zip(self._parts, eliminations, strict=True):
            numbers = [self._layout.chain_of(one.owner) for one in part.layout.chains]
            at, t = np.ix_(part.static, part.static), T
            for of_frame, at_first in elimination.marginals(multipliers.covariance(covariance[at])):
                first = at_first[: len(part.static), : len(part.static)]
                if of_frame is not None:
                    t, done = t - 1, done + 1
                    if np.diag(of_frame).max(initial=0.0) > UNKNOWN:
                        raise undetermined
                    for number, columns in zip(numbers, part.layout.chain_columns, strict=True):
                        assert number is not None
                        chains[number][t] = of_frame[columns, columns]
                    progress(done / (T * len(self._parts)))
            if part.drifting:
                covariance[at] = first
        progress(1.0)
        return Marginals(chains, covariance)
