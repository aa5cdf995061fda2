"""What all frames of a scene share, found on coarse frames: of all that is short, of some stretches of what is long.

Without a camera (one wearer) headings, mountings, the mean pose and axes of hinges are found from stretches that are
spread over the recording, in one problem (thesis eq. 4.10 and 3.3). In front of cameras the body, the cameras and the
detector are found too, from the first stretch that shows everybody.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from vip_factors.display import ProgressCallback
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array
from vip_factors.initialise.sensor_clocks import CLOCK_SECONDS
from vip_factors.problem.scene import ExtraTerms
from vip_factors.problem.state import SceneState
from vip_factors.sensors.frames import ImuFrames, in_stretches
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene
from vip_factors.sensors.sources import RecordingSource, SceneSource, frames_of, samples_around, without_gaps
from vip_factors.settings import Settings
from vip_factors.stages.findings import film_findings
from vip_factors.stages.floor import with_declared_floor
from vip_factors.stages.fusion import with_level_floor
from vip_factors.stages.inertial import (
    FoundStart,
    InertialSolution,
    calibrated,
    find_start,
    inertial_tracker,
    inertial_trackers,
)
from vip_factors.stages.inertial_model import with_contacts, with_inflated_contact_sigma
from vip_factors.stages.pauses import between_pauses
from vip_factors.stages.rival_starts import with_rivals_solved
from vip_factors.stages.scene_solution import SceneSolution, solve_from, start_before_cameras
from vip_factors.stages.sensor_checks import CorrectedSamples, Corrections, checked_scene, sensor_corrections
from vip_factors.stages.solver import Solver
from vip_factors.stages.windows import WindowPlan
from vip_factors.terms.registry import unfilmed_problem


@dataclass(frozen=True)
class Calibration:
    """What all frames of a scene share.

    Attributes:
        solution: of the coarse frames that it was found on.
        corrections: of each wearer's sensors.
        about_sensors: findings on them.
        solver: of the solution, with its reports.
    """

    solution: SceneSolution
    corrections: tuple[Corrections, ...]
    about_sensors: tuple[Finding, ...]
    solver: Solver

    @property
    def is_filmed(self) -> bool:
        """Whether a camera shows a wearer."""
        return self.solution.start is not None


def calibrate(
    source: SceneSource, plan: WindowPlan, settings: Settings, on_progress: ProgressCallback,
    extra: ExtraTerms | None = None, found: Sequence[FoundStart | None] = (),
) -> Calibration | tuple[Finding, ...]:  # fmt: skip
    """What all frames share, of wearers in front of a camera or of one whom no camera sees.

    Args:
        source: of the scene.
        plan: its frames.
        settings: of all rooms.
        on_progress: called with the name of the stage and the fraction of it done.
        extra: terms of a user's own; with them all frames are one window.
        found: each wearer's start, where it was looked for in the same samples.

    Returns:
        The calibration; or findings on what the cameras saw, if no wearer is recognised in any stretch.

    Raises:
        InputError, RecordingError: for a scene that cannot be used.
        SolveError: if the problem is not determined.
    """
    solver = Solver(settings.solve, on_progress, name=settings.solver, extra=extra)
    if not source.head.cameras:
        return _calibrate_unfilmed(source.wearers[0], plan, settings, solver, *found)
    fusion = replace(settings.solve, relative_decrease=settings.fusion.relative_decrease)
    return _calibrate_filmed(source, plan, settings, replace(solver, settings=fusion), found)


@dataclass(frozen=True)
class Stretches:
    """What a wearer's sensors measured in the stretches that calibrate.

    Attributes:
        recording: all but the samples.
        times: ``(T,)`` seconds of the coarse frames of each.
        samples: of each, with those on either side that frames look at.
    """

    recording: Recording
    times: Sequence[Array]
    samples: Sequence[Mapping[str, ImuStream]]

    @classmethod
    def of(cls, recording: RecordingSource, plan: WindowPlan) -> "Stretches":
        """Those of a plan; of a short recording all of it."""
        times = [plan.coarse_time(stretch) for stretch in plan.calibrating()]
        samples = [recording.between()] if plan.all_calibrate else [samples_around(recording, time) for time in times]
        return cls(recording.head, times, samples)

    @cached_property
    def together(self) -> Recording:
        """The stretches without the time between them."""
        if len(self.times) == 1:
            return replace(self.recording, imus=dict(self.samples[0]))
        return without_gaps(self.recording, self.samples, self.times)

    def frames(self) -> ImuFrames:
        """The coarse frames of all stretches."""
        sensors = self.together.placed
        parts = [frames_of(samples, sensors, time) for samples, time in zip(self.samples, self.times, strict=True)]
        return parts[0] if len(parts) == 1 else in_stretches(parts)


def check_sensors(
    stretches: Stretches, recording: RecordingSource, plan: WindowPlan, settings: Settings
) -> tuple[Corrections, tuple[Finding, ...]]:
    """What puts a wearer's sensors right, and findings: accelerometers by the stretches, clocks by the middle."""
    if not (settings.accelerometers.check or settings.sensor_clocks.check):
        return {}, ()
    compared = between_pauses(stretches.together)
    if not plan.all_calibrate:
        (start, end), half = recording.interval, CLOCK_SECONDS / 2
        middle = recording.between((start + end) / 2 - half, (start + end) / 2 + half)
        compared = replace(compared, imus=dict(middle))
    return sensor_corrections(stretches.together, compared, settings)


def _calibrate_unfilmed(
    recording: RecordingSource, plan: WindowPlan, settings: Settings, solver: Solver, found: FoundStart | None = None
) -> Calibration:
    """By the sensors alone, from all stretches together."""
    stretches = Stretches.of(recording, plan)
    corrections, about_sensors = check_sensors(stretches, recording, plan, settings)
    if corrections:
        stretches = Stretches.of(CorrectedSamples(recording, corrections), plan)
    together, frames = stretches.together, stretches.frames()
    evenly = replace(frames, time=frames.time[0] + frames.step * np.arange(len(frames)))
    start, starts = (
        (found.calibration, found.starts)
        if found is not None and found.is_on(evenly.time) and not corrections
        else find_start(together, evenly, settings, solver.progress_of("start"))
    )
    wearer = inertial_tracker(together, frames, settings, solver, start)
    if settings.acceleration:
        wearer = calibrated(wearer, settings, solver, solver.extra)
        free = with_contacts(with_inflated_contact_sigma(wearer.model), wearer.state)
        problem, state = unfilmed_problem([free], solver.extra), SceneState.unfilmed([wearer.state])
        starts = with_rivals_solved(starts, problem, state, 0, together, settings, solver)
    wearer = InertialSolution(wearer.model, wearer.state, starts)
    solution = SceneSolution.unfilmed(Scene(together.name, (together,)), [wearer])
    return Calibration(solution, (corrections,), about_sensors, solver)


def _calibrate_filmed(
    source: SceneSource, plan: WindowPlan, settings: Settings, solver: Solver, found: Sequence[FoundStart | None]
) -> Calibration | tuple[Finding, ...]:
    """By sensors and cameras, from the first stretch that shows all wearers, or from that which shows most."""
    looks = 3  # at stretches that are spread over a scene, where the first does not show every wearer
    best, most, findings = None, 0, tuple[Finding, ...]()
    coarse = len(plan.all_coarse_time)
    for begin in sorted({round(one) for one in np.linspace(0, max(coarse - plan.stretch, 0), looks)}):
        stretch = slice(begin, min(begin + plan.stretch, coarse))
        calibration = _calibrate_on(source, plan, stretch, settings, replace(solver, reports=[]), found)
        if not isinstance(calibration, Calibration):
            findings = findings or calibration
            continue
        shown = calibration.solution.shown
        if best is None or shown > most:
            best, most = calibration, shown
        if shown == len(source.wearers):
            break
    return findings if best is None else best


def _calibrate_on(
    source: SceneSource,
    plan: WindowPlan,
    stretch: slice,
    settings: Settings,
    solver: Solver,
    found: Sequence[FoundStart | None],
) -> Calibration | tuple[Finding, ...]:
    """One stretch of coarse frames; or why nobody was recognised in it."""
    time = plan.coarse_time(stretch)
    scene = source.between() if plan.all_calibrate else source.between(float(time[0]), float(time[-1]))
    scene = with_declared_floor(scene, settings.floor)
    if stretch.start:
        scene = replace(scene, wearers=tuple(replace(one, initial_pose="none") for one in scene.wearers))
    scene, corrections, about_sensors = checked_scene(scene, settings)
    same = [None if changed else start for start, changed in zip(found, corrections, strict=False)]
    trackers = inertial_trackers(scene, time, settings, solver, same)
    start = start_before_cameras(scene, trackers, settings, solver)
    if isinstance(start, tuple):
        return *film_findings(scene, start), *start
    solution = solve_from(start, scene, settings, solver).with_rivals_solved(settings, solver)
    if settings.floor != "none" and not solution.is_world_known:
        solution = replace(solution, fused=with_level_floor(solution.fused, solver))
    return Calibration(solution.on_floor(settings), corrections, about_sensors, solver)
