"""Fixed-lag smoother of a stream: relinearisation, marginalisation and the state of all variables."""

from collections import deque
from dataclasses import dataclass

import numpy as np

from vip_factors.assembly.charts import Charts
from vip_factors.assembly.objective import joined_slices
from vip_factors.assembly.system import far_columns
from vip_factors.factor_graph.extra import ExtraFactors, StreamedTerms
from vip_factors.geometry.rotations import Array
from vip_factors.live.frames import FrameState, LagProblem, LiveFrame, stacked
from vip_factors.problem.layout import Layout, Owner, OwnerId
from vip_factors.problem.scene import SceneProblem
from vip_factors.problem.state import SceneState
from vip_factors.settings import LiveSettings, RelinearisationSettings
from vip_factors.solve.joined_lag import Columns, JoinedChains, JoinedSolution, marginal
from vip_factors.solve.slices import REACH, Slices


@dataclass
class _LagEntry:
    """A frame of the lag: measurements, origin of its coordinates, coordinates, state, and linearisation point."""

    frame: LiveFrame
    origin: FrameState
    coordinates: Array
    state: FrameState
    linearised: Array | None = None
    shared: Array | None = None  # shared coordinates at which it was linearised


class LagSmoother:
    """Smooths the frames of the lag; earlier ones are marginalised.

    Attributes:
        problem: problem of any stretch.
        shared: current state of the shared variables, without frames.
        shared_coordinates: their coordinates ``(s,)``, relative to the start of tracking.
        waited: whether the last update postponed the relinearisation of moved frames.
    """

    def __init__(
        self,
        problem: LagProblem,
        shared: SceneState,
        settings: LiveSettings,
        extra: ExtraFactors | None = None,
        information: Array | None = None,
    ) -> None:
        self._information = information  # about the shared variables, from before the first frame
        self.problem, self._settings = problem, settings
        self._extra = None if extra is None else StreamedTerms(extra, problem.layout)
        self.shared = self._origin = shared
        self.shared_coordinates = np.zeros(problem.layout.static_width)
        self._frames: deque[_LagEntry] = deque()
        self._solution: JoinedSolution | None = None
        self._beginning = 0  # number of the very first frame
        # Number of frames that tracking continues from, if there is information from before them.
        self._continued = 0 if information is None else round(settings.lag_s * settings.frame_rate) + REACH
        self.waited = False
        self._walks: dict[int, Array] = {}  # sigmas by frame, of a random walk of the shared variables after it
        self._every = max(1, round(settings.walk.every_s * settings.frame_rate))
        self._inflation = np.zeros(problem.layout.static_width)  # variances of the step after the newest frame
        self._layout = layout = problem.layout
        self._usual_walk = layout.per_column("process_noise") * np.sqrt(settings.walk.every_s)
        owner_sets = _parts(layout, extra is not None)
        self._layouts = [layout.of_owners(owners) for owners in owner_sets]
        far = [
            None if extra is not None else far_columns(layout_of_part, problem.wearers)
            for layout_of_part in self._layouts
        ]
        self._columns = [
            Columns(layout.frame_columns(owners), layout.static_columns(owners), far_of_part)
            for owners, far_of_part in zip(owner_sets, far, strict=True)
        ]
        self._chain = JoinedChains(self._columns)
        most_frames = settings.relinearisation.most
        self._slices = [
            Slices(layout_of_part.frame_width, layout_of_part.static_width, most_frames, far_of_part)
            for layout_of_part, far_of_part in zip(self._layouts, far, strict=True)
        ]
        self._limits, self._shared_limits = _limits(layout, settings.relinearisation), layout.per_column("relinearise")

    @property
    def numbers(self) -> range:
        """Numbers of the frames of the lag."""
        return range(self._frames[0].frame.number, self._frames[-1].frame.number + 1) if self._frames else range(0)

    def frame(self, number: int) -> LiveFrame:
        """Measurements of a frame of the lag."""
        return self._entry(number).frame

    def state(self, number: int) -> FrameState:
        """Current state of a frame of the lag."""
        return self._entry(number).state

    def states(self, start: int) -> list[FrameState]:
        """Current states of all frames from a number on."""
        return [entry.state for entry in self._frames if entry.frame.number >= start]

    def _entry(self, number: int) -> _LagEntry:
        return self._frames[number - self._frames[0].frame.number]

    def append(self, frame: LiveFrame, guess: FrameState) -> None:
        """Append a new frame; it counts from the next update on."""
        least_step = 1e-5  # of shared variables without a step: information stays finite
        if self._frames:
            step = self._inflation + (self._usual_walk**2 if frame.number % self._every == 0 else 0.0)
            if np.any(step):
                self._walks[frame.number - 1] = np.sqrt(np.maximum(step, least_step**2))
            self._inflation = np.zeros_like(step)
        else:
            self._beginning = frame.number
        self._frames.append(_LagEntry(frame, guess, np.zeros(self._layout.frame_width), guess))
        if self._extra is not None:
            self._extra.append(frame.number, frame.time)

    def free_sensor(self, wearer: int, sensor: int) -> None:
        """Free the calibration of a sensor after the newest frame, because it has moved."""
        straps_slip_deg = {"headings": 40.0, "R_bone_sensor": 30.0}
        owner, sigmas = OwnerId(Owner.WEARER, wearer), np.zeros(self._layout.static_width)
        for block, degrees in straps_slip_deg.items():
            sigmas[self._layout.item_columns(owner, block, sensor)] = np.deg2rad(degrees)
        self._inflation = self._inflation + sigmas**2

    def scene(self, numbers: range) -> tuple[SceneProblem, SceneState]:
        """A scene of some frames, without priors."""
        entries = [self._entry(number) for number in numbers]
        state = stacked([entry.state for entry in entries], self.shared)
        return self.problem.model([entry.frame for entry in entries], False), state

    def update(self, first_changed: int | None = None) -> None:
        """One Gauss–Newton step over the frames that moved, and those from ``first_changed`` on if data is new there.

        Raises:
            SolveError: if the frames do not determine all variables.
        """
        newest = self.numbers[-1]
        fresh = next((entry.frame.number for entry in self._frames if entry.linearised is None), newest)
        start = min(fresh - REACH, newest if first_changed is None else first_changed)
        # Moved frames may wait for one update if there is new video: this bounds the longest update.
        self.waited = first_changed is not None and not self.waited
        if not self.waited:
            start = min(start, self._first_moved())
        start = max(start, self._frames[0].frame.number)
        entries = [self._entry(number) for number in range(start, newest + 1)]
        state = stacked([entry.state for entry in entries], self.shared)
        model = self.problem.model([entry.frame for entry in entries], beginning=start == self._beginning)
        coordinates = np.array([entry.coordinates for entry in entries])
        charts = Charts.at(self._layout, coordinates, self.shared_coordinates)
        slices = self._slices = joined_slices(self._layouts, model, state, self._slices, charts)
        if self._extra is not None:
            self._extra.add_to(slices[0].blocks(len(entries)), state, start, charts)
        first_frames = sum(entry.frame.number < self._beginning + self._continued for entry in entries)
        self._hold_undetermined(coordinates, first_frames)
        if self._information is not None and start == self._beginning:
            self._add_information(self._information)
        origins = [
            (coordinates[:, part_columns.frame], self.shared_coordinates[part_columns.static])
            for part_columns in self._columns
        ]
        for t, entry in enumerate(entries):
            quadratics = [
                slices_of_part.in_coordinates(t, frames[t : t + REACH + 1], shared)
                for slices_of_part, (frames, shared) in zip(slices, origins, strict=True)
            ]
            self._chain.eliminate(entry.frame.number, quadratics, self._walks.get(entry.frame.number))
            entry.linearised, entry.shared = entry.coordinates, self.shared_coordinates
        self._solution = solution = self._chain.solution()
        states = self.problem.moved_frames([entry.origin for entry in self._frames], solution.values)
        for entry, coordinates_of_frame, moved in zip(self._frames, solution.values, states, strict=True):
            entry.coordinates, entry.state = coordinates_of_frame, moved
        if self._layout.static_width:
            self.shared_coordinates = solution.shared
            self.shared = self._origin.retract_static(self._layout, self.shared_coordinates)

    def marginalise_before(self, first_kept: int) -> None:
        """Marginalise frames with smaller numbers than ``first_kept``."""
        while self._frames and self._frames[0].frame.number < first_kept:
            number = self._frames.popleft().frame.number
            self._walks.pop(number, None)
        if self._extra is not None:
            self._extra.drop_before(first_kept)
        self._chain.marginalise_before(first_kept)

    @property
    def solution(self) -> JoinedSolution:
        """Solution of the last update, with covariances in coordinates."""
        assert self._solution is not None
        return self._solution

    def _add_information(self, information: Array) -> None:
        """Add the information from before the first frame: to each part, what parts have in common only once."""
        columns = self._columns
        common = columns[-1].static if len(columns) > 1 else np.zeros(0, int)
        for slices, columns_of_part in zip(self._slices, columns, strict=True):
            information_of_part = marginal(information, columns_of_part.static)
            if columns_of_part is not columns[-1]:
                start = len(columns_of_part.static) - len(common)
                information_of_part[start:, start:] -= marginal(information, common)
            shared = slice((REACH + 1) * slices.frame, None)
            slices.hessian[0, shared, shared] += information_of_part
            slices.gradient[0, shared] += information_of_part @ self.shared_coordinates[columns_of_part.static]

    def _hold_undetermined(self, coordinates: Array, first_frames: int) -> None:
        """Hold predicted states where no measurement determines them.

        This applies to frames that are estimated independently, and to the ``first_frames`` that tracking continues
        from: the root of a wearer whom no camera has seen and whose feet do not stand, and carried cameras that have
        seen nobody.
        """
        predicted_sigma = 10.0  # rad or m: weaker than any measurement
        for layout, slices, columns_of_part in zip(self._layouts, self._slices, self._columns, strict=True):
            for chain, columns in zip(layout.chains, layout.chain_columns, strict=True):
                rows, held_frames = np.arange(columns.start, columns.stop), first_frames
                if chain.owner.kind is Owner.WEARER:
                    is_independent = not self.problem.wearers[chain.owner.number].use_acceleration
                    rows, held_frames = (rows, len(coordinates)) if is_independent else (rows[-3:], first_frames)
                elif layout is not self._layouts[-1]:
                    continue  # what parts have in common is held only once
                if held_frames:
                    slices.hessian[:held_frames, rows, rows] += 1 / predicted_sigma**2
                    offset = coordinates[:held_frames, columns_of_part.frame[rows]]
                    slices.gradient[:held_frames, rows] += offset / predicted_sigma**2

    def _first_moved(self) -> int:
        """Number of the earliest frame to be relinearised because its variables have moved."""
        settings, newest = self._settings.relinearisation, self.numbers[-1]
        for number in range(max(self.numbers[0], newest - settings.most + 1), newest):
            entry = self._entry(number)
            if entry.linearised is None or entry.shared is None:
                break
            if np.any(np.abs(entry.coordinates - entry.linearised) > self._limits):
                return number
            if np.any(np.abs(self.shared_coordinates - entry.shared) > self._shared_limits):
                return number
        return newest


def _parts(layout: Layout, is_joint: bool) -> list[set[OwnerId]]:
    """Owners whose variables are solved together: each wearer with the cameras; last, the cameras alone."""
    owners = {chain.owner for chain in layout.chains} | {owner for owner, _ in layout.blocks}
    wearers = sorted(owner for owner in owners if owner.kind is Owner.WEARER)
    if is_joint or len(wearers) < 2:
        return [owners]
    return [*({wearer} | owners.difference(wearers) for wearer in wearers), owners.difference(wearers)]


def _limits(layout: Layout, settings: RelinearisationSettings) -> Array:
    """Change of each column of a frame from which on it is relinearised."""
    limits = np.full(layout.frame_width, np.deg2rad(settings.angle_deg))
    for columns in layout.chain_columns:
        limits[columns.stop - 3 : columns.stop] = settings.length_m  # every chain ends with a position
    return limits
