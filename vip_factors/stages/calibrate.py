"""Calibration of a scene: estimation of all variables that frames share, on coarse frames.

All coarse frames of a short recording calibrate, and some stretches of a long one. Without a camera (one wearer) the
headings, mountings, mean pose and hinge axes are estimated from stretches spread over the recording, in one problem
(thesis eq. 4.10 and 3.3). With cameras, the body, the cameras and the detector are estimated too, from the first
stretch that shows every wearer.
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
from vip_factors.stages.accelerometers import Corrections
from vip_factors.stages.findings import film_findings
from vip_factors.stages.floor import with_declared_floor
from vip_factors.stages.fusion import with_level_floor
from vip_factors.stages.inertial import (
    InertialSolution,
    WearerStart,
    calibrate_inertial,
    find_start,
    inertial_tracker,
    inertial_trackers,
)
from vip_factors.stages.inertial_model import with_contacts, with_inflated_contact_sigma
from vip_factors.stages.rival_starts import with_rivals_solved
from vip_factors.stages.scene_solution import SceneSolution, solve_from, start_before_cameras
from vip_factors.stages.sensor_checks import PreparedRecording, check_scene, sensor_corrections
from vip_factors.stages.solver import Solver
from vip_factors.stages.windows import WindowPlan
from vip_factors.terms.registry import unfilmed_problem


@dataclass(frozen=True)
class Calibration:
    """Variables that all frames of a scene share.

    Attributes:
        solution: solution of the coarse frames.
        corrections: corrections of each wearer's sensors.
        sensor_findings: findings about the sensors.
        solver: solver with the reports of its solves.
    """

    solution: SceneSolution
    corrections: tuple[Corrections, ...]
    sensor_findings: tuple[Finding, ...]
    solver: Solver

    @property
    def is_filmed(self) -> bool:
        """True if a camera shows a wearer."""
        return self.solution.start is not None


def calibrate(
    source: SceneSource,
    plan: WindowPlan,
    settings: Settings,
    on_progress: ProgressCallback,
    extra: ExtraTerms | None = None,
    known_starts: Sequence[WearerStart | None] = (),
) -> Calibration | tuple[Finding, ...]:
    """Calibrate wearers in front of cameras, or one wearer without a camera.

    Args:
        source: the scene.
        plan: its frames.
        settings: settings of all rooms.
        on_progress: called with the name of the stage and the fraction done.
        extra: terms of the user; with them all frames form one window.
        known_starts: start of each wearer that was already found on the same samples.

    Returns:
        The calibration; or findings, if no wearer is recognised in any stretch.

    Raises:
        InputError, RecordingError: for a scene that cannot be used.
        SolveError: if the problem is not determined.
    """
    solver = Solver(settings.solve, on_progress, name=settings.solver, extra=extra)
    if not source.head.cameras:
        return _calibrate_unfilmed(source.wearers[0], plan, settings, solver, *known_starts)
    fusion = replace(settings.solve, relative_decrease=settings.fusion.relative_decrease)
    return _calibrate_filmed(source, plan, settings, replace(solver, settings=fusion), known_starts)


@dataclass(frozen=True)
class Stretches:
    """Samples of a wearer's sensors in the stretches that calibrate.

    Attributes:
        recording: the recording without samples.
        times: ``(T,)`` seconds of the coarse frames of each stretch.
        samples: samples of each stretch, with the neighbours that frames need.
    """

    recording: Recording
    times: Sequence[Array]
    samples: Sequence[Mapping[str, ImuStream]]

    @classmethod
    def of(cls, recording: RecordingSource, plan: WindowPlan) -> "Stretches":
        """Read the stretches of a plan."""
        times = [plan.coarse_time(stretch) for stretch in plan.calibration_stretches()]
        samples = [recording.between()] if plan.uses_all_frames else [samples_around(recording, time) for time in times]
        return cls(recording.head, times, samples)

    @cached_property
    def joined_recording(self) -> Recording:
        """The stretches joined, without the time between them."""
        if len(self.times) == 1:
            return replace(self.recording, imus=dict(self.samples[0]))
        return without_gaps(self.recording, self.samples, self.times)

    def frames(self) -> ImuFrames:
        """Coarse frames of all stretches."""
        sensors = self.joined_recording.placed
        frames_by_stretch = [
            frames_of(samples, sensors, time) for samples, time in zip(self.samples, self.times, strict=True)
        ]
        return frames_by_stretch[0] if len(frames_by_stretch) == 1 else in_stretches(frames_by_stretch)


def check_sensors(
    stretches: Stretches, recording: RecordingSource, plan: WindowPlan, settings: Settings
) -> tuple[Corrections, tuple[Finding, ...]]:
    """Check a wearer's accelerometers in the stretches and clocks in the middle; return corrections and findings."""
    if not (settings.accelerometers.check or settings.sensor_clocks.check):
        return {}, ()
    compared = stretches.joined_recording
    if not plan.uses_all_frames:
        (start, end), half = recording.interval, CLOCK_SECONDS / 2
        middle = recording.between((start + end) / 2 - half, (start + end) / 2 + half)
        compared = replace(compared, imus=dict(middle))
    return sensor_corrections(stretches.joined_recording, compared, settings)


def _calibrate_unfilmed(
    recording: RecordingSource,
    plan: WindowPlan,
    settings: Settings,
    solver: Solver,
    known_start: WearerStart | None = None,
) -> Calibration:
    """Calibrate from the sensors alone, with all stretches together."""
    stretches = Stretches.of(recording, plan)
    corrections, sensor_findings = check_sensors(stretches, recording, plan, settings)
    if corrections:
        stretches = Stretches.of(PreparedRecording(recording, corrections=corrections), plan)
    joined_recording, frames = stretches.joined_recording, stretches.frames()
    evenly = replace(frames, time=frames.time[0] + frames.step * np.arange(len(frames)))
    start, starts = (
        (known_start.calibration, known_start.starts)
        if known_start is not None and known_start.matches_frames(evenly.time) and not corrections
        else find_start(joined_recording, evenly, settings, solver.progress_of("start"))
    )
    wearer = inertial_tracker(joined_recording, frames, settings, solver, start)
    if settings.acceleration:
        wearer = calibrate_inertial(wearer, settings, solver, solver.extra)
        free = with_contacts(with_inflated_contact_sigma(wearer.model), wearer.state)
        problem, state = unfilmed_problem([free], solver.extra), SceneState.unfilmed([wearer.state])
        starts = with_rivals_solved(starts, problem, state, 0, joined_recording, settings, solver)
    wearer = InertialSolution(wearer.model, wearer.state, starts)
    solution = SceneSolution.unfilmed(Scene(joined_recording.name, (joined_recording,)), [wearer])
    return Calibration(solution, (corrections,), sensor_findings, solver)


def _calibrate_filmed(
    source: SceneSource,
    plan: WindowPlan,
    settings: Settings,
    solver: Solver,
    known_starts: Sequence[WearerStart | None],
) -> Calibration | tuple[Finding, ...]:
    """Calibrate from sensors and cameras, on the first stretch that shows all or most wearers."""
    attempts = 3  # stretches spread over the scene, tried until one shows every wearer
    best_calibration, best_count, findings = None, 0, tuple[Finding, ...]()
    coarse = len(plan.all_coarse_time)
    for begin in sorted({round(frame) for frame in np.linspace(0, max(coarse - plan.stretch, 0), attempts)}):
        stretch = slice(begin, min(begin + plan.stretch, coarse))
        calibration = _calibrate_on(source, plan, stretch, settings, replace(solver, reports=[]), known_starts)
        if not isinstance(calibration, Calibration):
            findings = findings or calibration
            continue
        shown = calibration.solution.shown
        if best_calibration is None or shown > best_count:
            best_calibration, best_count = calibration, shown
        if shown == len(source.wearers):
            break
    return findings if best_calibration is None else best_calibration


def _calibrate_on(
    source: SceneSource,
    plan: WindowPlan,
    stretch: slice,
    settings: Settings,
    solver: Solver,
    known_starts: Sequence[WearerStart | None],
) -> Calibration | tuple[Finding, ...]:
    """Calibrate on one stretch of coarse frames; return findings if no wearer is recognised."""
    time = plan.coarse_time(stretch)
    scene = source.between() if plan.uses_all_frames else source.between(float(time[0]), float(time[-1]))
    scene = with_declared_floor(scene, settings.floor)
    if stretch.start:
        scene = replace(scene, wearers=tuple(replace(wearer, initial_pose="none") for wearer in scene.wearers))
    scene, corrections, sensor_findings = check_scene(scene, settings)
    same = [None if changed else start for start, changed in zip(known_starts, corrections, strict=False)]
    trackers = inertial_trackers(scene, time, settings, solver, same)
    start = start_before_cameras(scene, trackers, settings, solver)
    if isinstance(start, tuple):
        return *film_findings(scene, start), *start
    solution = solve_from(start, scene, settings, solver).with_rivals_solved(settings, solver)
    if settings.floor != "none" and not solution.is_world_known:
        solution = replace(solution, fusion=with_level_floor(solution.fusion, solver))
    return Calibration(solution.on_floor(settings), corrections, sensor_findings, solver)
