"""The fixed-lag smoother of a stream: what is linearised when, and where all variables stand."""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from vip_factors.assembly.charts import Charts
from vip_factors.assembly.objective import joined_slices
from vip_factors.assembly.system import far_columns
from vip_factors.factor_graph.extra import ExtraFactors, StreamedTerms
from vip_factors.geometry.rotations import Array
from vip_factors.live.measurement import LiveFrame
from vip_factors.live.problem import FrameState, LagProblem, moved_frames, stacked
from vip_factors.problem.layout import Layout, Owner, OwnerId
from vip_factors.problem.scene import SceneProblem
from vip_factors.problem.state import SceneState
from vip_factors.settings import LiveSettings, RelinearisationSettings
from vip_factors.solve.joined_lag import Columns, JoinedChains, JoinedSolution, marginal
from vip_factors.solve.slices import REACH, Slices


@dataclass
class _LagEntry:
    """A frame of the lag: measurements, the point its coordinates start from, and where they are and were."""

    frame: LiveFrame
    origin: FrameState
    coordinates: Array
    state: FrameState
    linearised: Array | None = None
    shared: Array | None = None  # that it was linearised at


class LagSmoother:
    """Frames go in one by one; those of the lag are smoothed, those before it are held by their marginal.

    Attributes:
        problem: of any stretch.
        shared: what all frames share, as it is believed now, without frames.
        waited: whether what moved was not linearised anew in the last update.
    """

    def __init__(
        self, problem: LagProblem, shared: SceneState, settings: LiveSettings, extra: ExtraFactors | None = None,
        information: Array | None = None,
    ) -> None:  # fmt: skip
        self._information = information  # about what all frames share, from before the first one
        self.problem, self._settings = problem, settings
        self._extra = None if extra is None else StreamedTerms(extra, problem.layout)
        self.shared = self._origin = shared
        self._coordinates = np.zeros(problem.layout.static_width)
        self._frames: deque[_LagEntry] = deque()
        self._solution: JoinedSolution | None = None
        self._beginning = 0  # number of the very first frame
        # Frames that tracking goes on from, where something is known from before them.
        self._continued = 0 if information is None else round(settings.lag_s * settings.frame_rate) + REACH
        self.waited = False
        self._walks: dict[int, Array] = {}  # by frame behind which shared variables step, their sigmas
        self._epoch: dict[int, int] = {}  # of each frame: how many such steps lie before it
        self._every = max(1, round(settings.walk.every_s * settings.frame_rate))
        self._inflation = np.zeros(problem.layout.static_width)  # variances of the step behind the newest frame
        self._layout = layout = problem.layout
        self._usual_walk = layout.per_column("process_noise") * np.sqrt(settings.walk.every_s)
        parts = _parts(layout, extra is not None)
        self._layouts = [layout.of_owners(owners) for owners in parts]
        far = [None if extra is not None else far_columns(own, problem.wearers) for own in self._layouts]
        self._columns = [
            Columns(layout.frame_columns(owners), layout.static_columns(owners), own)
            for owners, own in zip(parts, far, strict=True)
        ]
        self._chain = JoinedChains(self._columns)
        most = settings.relinearisation.most
        self._slices = [
            Slices(one.frame_width, one.static_width, most, own) for one, own in zip(self._layouts, far, strict=True)
        ]
        self._limits, self._shared_limits = _limits(layout, settings.relinearisation), layout.per_column("relinearise")

    # What there is

    @property
    def numbers(self) -> range:
        """Numbers of the frames of the lag."""
        return range(self._frames[0].frame.number, self._frames[-1].frame.number + 1) if self._frames else range(0)

    def frame(self, number: int) -> LiveFrame:
        """The measurements of a frame of the lag."""
        return self._at(number).frame

    def state(self, number: int) -> FrameState:
        """A frame of the lag, as it is believed now."""
        return self._at(number).state

    def states(self, start: int) -> list[FrameState]:
        """All from a frame on."""
        return [one.state for one in self._frames if one.frame.number >= start]

    def _at(self, number: int) -> _LagEntry:
        return self._frames[number - self._frames[0].frame.number]

    # Steps

    def append(self, frame: LiveFrame, guess: FrameState) -> None:
        """A new frame behind the newest one; it counts from the next update on."""
        least_step = 1e-5  # of shared variables that do not step: no information is infinite
        if frame.number - 1 in self._epoch:
            before = frame.number - 1
            step = self._inflation + (self._usual_walk**2 if frame.number % self._every == 0 else 0.0)
            if np.any(step):
                self._walks[before] = np.sqrt(np.maximum(step, least_step**2))
            self._epoch[frame.number], self._inflation = (
                self._epoch[before] + (before in self._walks),
                np.zeros_like(step),
            )
        else:
            self._epoch[frame.number], self._beginning = 0, frame.number
        self._frames.append(_LagEntry(frame, guess, np.zeros(self._layout.frame_width), guess))
        if self._extra is not None:
            self._extra.append(frame.number, frame.time)

    def inflate_sigmas(self, sigmas: Array) -> None:
        """Let shared variables step by ``sigmas`` ``(s,)`` behind the newest frame: a sensor has moved, say."""
        self._inflation = self._inflation + sigmas**2

    def inflate_sensor_sigmas(self, wearer: int, sensor: int, heading_deg: float, mounting_deg: float) -> None:
        """Let one sensor's heading and mounting step by so much before the newest frame: it has moved."""
        owner, sigmas = OwnerId(Owner.WEARER, wearer), np.zeros(self._layout.static_width)
        for block, degrees in (("headings", heading_deg), ("R_bone_sensor", mounting_deg)):
            sigmas[self._layout.item_columns(owner, block, sensor)] = np.deg2rad(degrees)
        self.inflate_sigmas(sigmas)

    def scene(self, numbers: range) -> tuple[SceneProblem, SceneState]:
        """Some of the frames as a scene of their own, without priors."""
        some = [self._at(number) for number in numbers]
        return self.problem.model([one.frame for one in some], False), stacked([one.state for one in some], self.shared)

    def update(self, first: int | None = None) -> None:
        """One Gauss–Newton step over the frames that moved, and those from ``first`` on, if something is new there.

        Raises:
            SolveError: if the frames do not determine all variables.
        """
        newest = self.numbers[-1]
        fresh = next(one.frame.number for one in self._frames if one.linearised is None or one.frame.number == newest)
        start = min(fresh - REACH, newest if first is None else first)
        # What moved may wait for one update, if this one has video to take in: the longest are then no longer.
        self.waited = first is not None and not self.waited
        if not self.waited:
            start = min(start, self._first_moved())
        start = max(start, self._frames[0].frame.number)
        kept = [self._at(number) for number in range(start, newest + 1)]
        state = stacked([one.state for one in kept], self.shared)
        model = self.problem.model([one.frame for one in kept], beginning=start == self._beginning)
        coordinates = np.array([one.coordinates for one in kept])
        charts = Charts.at(self._layout, coordinates, self._coordinates)
        slices = self._slices = joined_slices(self._layouts, model, state, self._slices, charts)
        if self._extra is not None:
            self._extra.add_to(slices[0].blocks(len(kept)), state, start, charts)
        self._hold(coordinates, sum(one.frame.number < self._beginning + self._continued for one in kept))
        if self._information is not None and start == self._beginning:
            self._add_information(self._information)
        own = [(coordinates[:, one.frame], self._coordinates[one.static]) for one in self._columns]
        for t, one in enumerate(kept):
            quadratics = [
                part.in_coordinates(t, frames[t : t + REACH + 1], shared)
                for part, (frames, shared) in zip(slices, own, strict=True)
            ]
            self._chain.eliminate(one.frame.number, quadratics, self._walks.get(one.frame.number))
            one.linearised, one.shared = one.coordinates, self._coordinates
        self._take()

    def marginalise_before(self, before: int) -> None:
        """Marginalise frames with smaller numbers."""
        while self._frames and self._frames[0].frame.number < before:
            gone = self._frames.popleft().frame.number
            self._walks.pop(gone, None)
            self._epoch.pop(gone, None)
        if self._extra is not None:
            self._extra.drop_before(before)
        self._chain.marginalise_before(before)

    def covariance(self, number: int) -> Array:
        """Marginal covariance ``(w, w)`` of a frame's coordinates."""
        assert self._solution is not None
        return self._solution.covariance(number)

    def covariance_in_steps(self, number: int) -> Iterator[Array | None]:
        """The same of the solution that there is now, a step at a time; None until the last one."""
        assert self._solution is not None
        return self._solution.covariance_in_steps(number)

    @property
    def shared_coordinates(self) -> Array:
        """What all frames share ``(s,)``, from where tracking began with it."""
        return self._coordinates

    def shared_covariance(self) -> Array:
        """Marginal covariance ``(s, s)`` of what all frames share."""
        assert self._solution is not None
        return self._solution.shared_covariance()

    # Inside

    def _add_information(self, information: Array) -> None:
        """Put in what is known from before the first frame: of each part, and of what all have in common but once."""
        columns = self._columns
        common = columns[-1].static if len(columns) > 1 else np.zeros(0, int)
        for slices, part in zip(self._slices, columns, strict=True):
            own = marginal(information, part.static)
            if part is not columns[-1]:
                start = len(part.static) - len(common)
                own[start:, start:] -= marginal(information, common)
            shared = slice((REACH + 1) * slices.frame, None)
            slices.hessian[0, shared, shared] += own
            slices.gradient[0, shared] += own @ self._coordinates[part.static]

    def _hold(self, coordinates: Array, first: int) -> None:
        """Frames stay where they were predicted in what nothing tells of them.

        These are frames that are estimated each by itself, and the ``first`` ones, that tracking goes on from: of a
        wearer whom no camera has seen yet and whose feet do not stand, nothing else says where, and how fast, the root
        is there; nor of a carried camera that has seen nobody.
        """
        predicted_sigma = 10.0  # rad or m: far less than the least that a measurement says
        for layout, slices, part in zip(self._layouts, self._slices, self._columns, strict=True):
            for chain, columns in zip(layout.chains, layout.chain_columns, strict=True):
                own, held = np.arange(columns.start, columns.stop), first
                if chain.owner.kind is Owner.WEARER:
                    alone = not self.problem.wearers[chain.owner.number].use_acceleration
                    own, held = (own, len(coordinates)) if alone else (own[-3:], first)
                elif layout is not self._layouts[-1]:
                    continue  # what all have in common is held but once
                if held:
                    slices.hessian[:held, own, own] += 1 / predicted_sigma**2
                    slices.gradient[:held, own] += coordinates[:held, part.frame[own]] / predicted_sigma**2

    def _take(self) -> None:
        self._solution = found = self._chain.solution()
        states = moved_frames(self._layout, [one.origin for one in self._frames], found.values)
        for one, own, state in zip(self._frames, found.values, states, strict=True):
            one.coordinates, one.state = own, state
        if self._layout.static_width:
            self._coordinates = found.shared
            self.shared = self._origin.retract_static(self._layout, self._coordinates)

    def _first_moved(self) -> int:
        """The earliest of the frames to be linearised anew because something in them has moved."""
        settings, newest = self._settings.relinearisation, self.numbers[-1]
        for number in range(max(self.numbers[0], newest - settings.most + 1), newest):
            one = self._at(number)
            if one.linearised is None or one.shared is None:
                break
            if np.any(np.abs(one.coordinates - one.linearised) > self._limits):
                return number
            if np.any(np.abs(self._coordinates - one.shared) > self._shared_limits):
                return number
        return newest


def _parts(layout: Layout, together: bool) -> list[set[OwnerId]]:
    """Whose variables are solved for together: each wearer's with what films them; last, what films them alone."""
    owners = {one.owner for one in layout.chains} | {owner for owner, _ in layout.blocks}
    wearers = sorted(one for one in owners if one.kind is Owner.WEARER)
    if together or len(wearers) < 2:
        return [owners]
    return [*({one} | owners.difference(wearers) for one in wearers), owners.difference(wearers)]


def _limits(layout: Layout, settings: RelinearisationSettings) -> Array:
    """From which change on each column of a frame is linearised anew."""
    limits = np.full(layout.frame_width, np.deg2rad(settings.angle_deg))
    for columns in layout.chain_columns:
        limits[columns.stop - 3 : columns.stop] = settings.length_m  # every part ends with a position
    return limits
