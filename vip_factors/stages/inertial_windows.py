"""A wearer by the sensors alone: the calibration of all frames from some stretches, then window by window.

What all frames share (headings, mountings, the mean pose, axes of hinges) is found on coarse frames of stretches that
are spread over the recording, in one problem (thesis eq. 4.10 and 3.3). Every window is then solved by itself, as a
recording would be whose calibration is known, and moved to where the one before it, which ends a little later than it
begins, has the wearer. Of a short recording all frames calibrate, and windows start from that solution.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from vip_factors.body.kinematics import Motion, forward_kinematics
from vip_factors.body.skeleton import JOINT_COUNT
from vip_factors.display import ProgressCallback, silent
from vip_factors.estimate import Estimate, PoseCovariance, WearerEstimate
from vip_factors.estimate_chunks import EstimateChunks
from vip_factors.findings import Finding
from vip_factors.geometry.rotations import Array
from vip_factors.initialise.calibration import InitialCalibration, first_poses
from vip_factors.initialise.sensor_faults import CLOCK_SECONDS
from vip_factors.problem.scene import ExtraTerms
from vip_factors.problem.state import SceneState, WearerState
from vip_factors.problem.wearer import WearerProblem
from vip_factors.sensors.frames import ImuFrames, in_stretches
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.sources import RecordingSource, frames_of, samples_around, without_gaps
from vip_factors.settings import Settings, flatten
from vip_factors.stages.calibration_start import start_choice, start_findings
from vip_factors.stages.decode import decode, scene_covariance
from vip_factors.stages.drift import drift_findings, leap_findings
from vip_factors.stages.inertial import (
    InertialSolution,
    at_frames,
    calibrated,
    find_start,
    inertial_tracker,
    with_calibration_sigmas,
)
from vip_factors.stages.inertial_model import (
    frame_by_frame,
    method_of,
    on_frames_with_fixed_calibration,
    placed_on_floor,
    with_contacts,
    with_fixed_calibration,
    with_inflated_contact_sigma,
)
from vip_factors.stages.rival_starts import with_rivals_solved
from vip_factors.stages.sensor_checks import CorrectedSamples, sensor_corrections
from vip_factors.stages.solver import Solver
from vip_factors.stages.wearer_findings import posture_findings
from vip_factors.stages.window_join import SolvedWindow, chunks_of, moved
from vip_factors.stages.windows import Each, WindowPlan
from vip_factors.terms.registry import unfilmed_problem

# m, of a window that is tracked afresh: where it begins the one before it tells, once it is moved there, and its height
# the floor; held as the beginning of a recording is, that height would be the tracker's.
LATER_START_SIGMA = 1.0
WINDOWS = "windows"  # the stage, as progress tells it


def smooth_wearer(
    recording: RecordingSource,
    settings: Settings,
    on_progress: ProgressCallback,
    extra: ExtraTerms | None = None,
    each: Each = map,
) -> EstimateChunks:
    """The estimate of a wearer; calibrated now, and in windows solved as its chunks are asked for.

    Findings on accelerometers and on the wearer's posture are of the frames that calibrate; clocks are compared in the
    recording's middle.

    Args:
        recording: of the wearer.
        settings: of all rooms.
        on_progress: called with the name of the stage and the fraction of it done.
        extra: terms of a user's own; with them all frames are one window.
        each: as :func:`map`: where windows are solved.

    Raises:
        InputError, RecordingError: for a recording that cannot be used; for samples, as chunks are asked for.
        SolveError: if the problem is not determined; likewise.
    """
    plan = WindowPlan.of(recording.head.name, recording.interval, settings, whole=extra is not None)
    solver = Solver(settings.solve, on_progress, name=settings.solver, extra=extra)
    recording, about_sensors = with_sensors_checked(recording, plan, settings)
    shared = calibrate(recording, plan, settings, solver)
    windows = solve_windows(shared, recording, plan, settings, solver, each)
    if plan.is_one_window:
        window = next(windows).wearers[0]
        estimate = _with_findings(replace(window, reports=tuple(solver.reports)), window.motion, recording, shared)
    else:
        sample = _decode(shared.model, shared.state, settings)
        none = sample.frames(slice(0, 0))
        head = replace(
            none, motion=replace(none.motion, rate=plan.rate, start=plan.start), reports=tuple(solver.reports)
        )
        estimate = _with_findings(head, sample.motion, recording, shared)
    if settings.acceleration:
        estimate = with_calibration_sigmas(estimate, shared, settings.calibration, extra)
    whole = Estimate.of_one(replace(estimate, findings=(*about_sensors, *estimate.findings)))
    if plan.is_one_window:
        return EstimateChunks.of(whole)
    return EstimateChunks(whole, (plan.frames,), chunks_of(numbered(windows, plan, on_progress), whole))


def numbered(
    windows: Iterator[SolvedWindow], plan: WindowPlan, on_progress: ProgressCallback
) -> Iterator[SolvedWindow]:
    """The windows, in one world, and how far they are; reports tell their numbers."""
    on_progress(WINDOWS, 0.0)
    count = len(plan.windows())
    for number, window in enumerate(windows):
        on_progress(WINDOWS, (number + 1) / count)
        yield window.numbered(number)


def _with_findings(
    estimate: WearerEstimate, motion: Motion, recording: RecordingSource, shared: InertialSolution
) -> WearerEstimate:
    """The estimate with what is odd about it, in the frames of a ``motion``, and how its start was found."""
    head, sensors = recording.head, shared.model.frames.sensors
    wearer, mountings = head.subject.name, shared.model.prior_R_bone_sensor
    state = shared.state
    bones = forward_kinematics(shared.model.skeleton, state.R_parent_child, state.p_world_pelvis).R_world_bone
    findings = (
        *leap_findings(wearer, head, shared.model.frames, bones, estimate.calibration),
        *start_findings(wearer, sensors, shared.starts),
        *posture_findings(wearer, head, motion, estimate.calibration, mountings),
        *drift_findings(wearer, estimate.calibration, head.restarts),
    )
    return replace(estimate, findings=findings, start=start_choice(sensors, shared.starts))


def with_sensors_checked(
    recording: RecordingSource, plan: WindowPlan, settings: Settings
) -> tuple[RecordingSource, tuple[Finding, ...]]:
    """The recording with its sensors put right, and what was found: see :mod:`~vip_factors.stages.sensor_checks`.

    Accelerometers are looked over in the stretches that calibrate; clocks are compared in the middle of a long one.

    Raises:
        RecordingError: for a recording that cannot be used.
    """
    if not (settings.accelerometers.check or settings.sensor_clocks.check):
        return recording, ()
    _, _, together = _calibrating(recording, plan)
    compared = together
    if not plan.all_calibrate:
        (start, end), half = recording.interval, CLOCK_SECONDS / 2
        middle = recording.between((start + end) / 2 - half, (start + end) / 2 + half)
        compared = replace(together, imus=dict(middle))
    corrections, findings = sensor_corrections(together, compared, settings)
    return CorrectedSamples(recording, corrections) if corrections else recording, findings


def _calibrating(
    recording: RecordingSource, plan: WindowPlan
) -> tuple[list[Array], list[Mapping[str, ImuStream]], Recording]:
    """Times of the coarse frames that calibrate, their samples stretch by stretch, and these without gaps."""
    times = [plan.coarse_time(one) for one in plan.calibrating()]
    stretches = [recording.between()] if plan.all_calibrate else [samples_around(recording, time) for time in times]
    if len(times) == 1:
        return times, stretches, replace(recording.head, imus=dict(stretches[0]))
    return times, stretches, without_gaps(recording.head, stretches, times)


def calibrate(recording: RecordingSource, plan: WindowPlan, settings: Settings, solver: Solver) -> InertialSolution:
    """What all frames share, found from coarse frames of some stretches.

    Returns:
        The problem as the inertial tracker leaves it, on the stretches' frames, and the solution of the free one.

    Raises:
        InputError, RecordingError: for a recording that cannot be used.
        SolveError: if the problem is not determined.
    """
    times, stretches, together = _calibrating(recording, plan)
    each = [frames_of(own, recording.sensors, time) for own, time in zip(stretches, times, strict=True)]
    frames = evenly = each[0]
    if len(each) > 1:
        frames = in_stretches(each)
        evenly = replace(frames, time=frames.time[0] + frames.step * np.arange(len(frames)))
    calibration, starts = find_start(together, evenly, settings, solver.progress_of("start"))
    if not plan.all_calibrate:
        settings = _with_knots_in_stretches(plan, settings)
    inertial = inertial_tracker(together, frames, settings, solver, calibration)
    if settings.acceleration:
        inertial = calibrated(inertial, settings, solver, solver.extra)
        free = with_contacts(with_inflated_contact_sigma(inertial.model, settings.calibration), inertial.state)
        problem, state = unfilmed_problem([free], solver.extra), SceneState.unfilmed([inertial.state])
        starts = with_rivals_solved(starts, problem, state, 0, together, settings, solver)
    # Without a camera an estimate has its recording's name.
    return replace(inertial, model=replace(inertial.model, name=recording.head.name), starts=starts)


def _with_knots_in_stretches(plan: WindowPlan, settings: Settings) -> Settings:
    """Settings whose headings have no more knots than there are stretches to see them in."""
    every, stretches = settings.calibration.heading_knot_s, settings.windows.calibration_stretches
    if every is None:
        return settings
    apart = plan.frames / plan.rate / max(stretches - 1, 1)
    return replace(settings, calibration=replace(settings.calibration, heading_knot_s=max(every, apart)))


def solve_windows(
    shared: InertialSolution, recording: RecordingSource, plan: WindowPlan, settings: Settings, solver: Solver,
    each: Each = map,
) -> Iterator[SolvedWindow]:  # fmt: skip
    """Every window, one after another, each moved to where the one before it has the wearer.

    Nothing but that, and where a wearer stays whom no sensor measured, ties one window to another: they are solved by
    themselves, wherever ``each`` has that done.

    Args:
        shared: what all of them share.
        recording, plan, settings: of all.
        solver: of all if they are one; else each has its own like it.
        each: as :func:`map`.

    Raises:
        RecordingError: for samples that cannot be used.
        SolveError: if a window's problem is not determined.
    """
    if plan.is_one_window:
        span = plan.windows()[0]
        solved = _solved(shared, plan, settings, solver, (span, recording.between()))
        assert solved is not None
        yield solved
        return
    own = replace(solver, on_progress=silent, reports=[])
    measured = ((span, samples_around(recording, plan.time(span))) for span in plan.windows())
    windows = each(partial(_solved, shared, plan, settings, own), measured)
    before, has_floor = None, settings.acceleration and shared.model.has_floor
    for span, window in zip(plan.windows(), windows, strict=True):
        if before is None:
            before = window
        else:
            own_world = window or _as_last_seen(shared, recording, plan, span, before, settings)
            before = moved(own_world, before, has_floor)
        yield before


def _solved(
    shared: InertialSolution,
    plan: WindowPlan,
    settings: Settings,
    solver: Solver,
    given: tuple[slice, Mapping[str, ImuStream]],
) -> SolvedWindow | None:
    """A window of its frames and samples, in a world of its own; None of a later one in which nothing was measured."""
    span, streams = given
    own = solver if plan.is_one_window else replace(solver, reports=[])
    frames = frames_of(streams, shared.model.frames.sensors, plan.time(span))
    if span.start and not frames.orientation_valid.any():
        return None
    model, state = _solve_window(shared, frames, streams, plan, span, settings, own)
    covariance = None
    if settings.covariance:
        scene = unfilmed_problem([model]), SceneState.unfilmed([state])
        covariance = scene_covariance(*scene, own).wearers[0]
    wearer = _decode(model, state, settings, covariance)
    return SolvedWindow(span, (replace(wearer, reports=tuple(own.reports)),))


def _solve_window(
    shared: InertialSolution, frames: ImuFrames, streams: Mapping[str, ImuStream], plan: WindowPlan, span: slice,
    settings: Settings, solver: Solver,
) -> tuple[WearerProblem, WearerState]:  # fmt: skip
    """The problem on all of a window's frames, and its solution."""
    time, model, state = frames.time, shared.model, shared.state
    if not plan.all_calibrate:
        coarse = frames_of(streams, frames.sensors, time[:: plan.factor])
        model = replace(model, frames=coarse, initial_pose=model.initial_pose if span.start == 0 else None)
        state = _track_window(model, state, solver)
        if settings.acceleration:
            state = _settled(model, state, settings, solver)
    if not settings.acceleration:
        return frame_by_frame(model), state
    state = at_frames(state, model.frames.time, time)
    fine = with_contacts(on_frames_with_fixed_calibration(model, frames), state)
    if span.start and not plan.all_calibrate:
        gauge = replace(fine.settings.gauge_prior, position_sigma=LATER_START_SIGMA)
        fine = replace(fine, settings=replace(fine.settings, gauge_prior=gauge))
    return fine, solver.solve_wearer(fine, state, "sparse inertial poser", solver.extra)


def _track_window(model: WearerProblem, shared: WearerState, solver: Solver) -> WearerState:
    """The inertial tracker's solution on a window's frames, on standing feet; what all frames share is kept."""
    middle = model.knot_weights(slice(len(model.frames) // 2, len(model.frames) // 2 + 1))
    headings = shared.headings if middle is None else middle[0] @ shared.heading_knots
    calibration = InitialCalibration(headings, np.full(len(headings), np.inf), shared.R_bone_sensor)
    R = first_poses(model.frames, [sensor.bone for sensor in model.sensors], calibration, model.prior)
    state = replace(shared, R_parent_child=R, p_world_pelvis=np.zeros((len(R), 3)))
    state = solver.solve_wearer(frame_by_frame(model), state, "inertial tracker")
    return placed_on_floor(model, state)


def _settled(model: WearerProblem, state: WearerState, settings: Settings, solver: Solver) -> WearerState:
    """The sparse inertial poser on a window's coarse frames, roughly: what all frames share is kept."""
    # Relative decrease at which coarse solves stop: the last one of a window goes on from there
    coarse_decrease = 0.1
    rough = replace(solver, settings=replace(solver.settings, relative_decrease=coarse_decrease))
    held = with_fixed_calibration(model)
    for _ in range(settings.calibration.passes):
        state = rough.solve_wearer(with_contacts(held, state), state, "calibrated")
    return state


def _as_last_seen(
    shared: InertialSolution, recording: RecordingSource, plan: WindowPlan, span: slice, before: SolvedWindow,
    settings: Settings,
) -> SolvedWindow:  # fmt: skip
    """A window in which nobody measured anything: the wearer stays as at its first frame, which the one before has."""
    time = plan.time(span)
    frames = frames_of(samples_around(recording, time), recording.sensors, time)
    last = before.wearers[0].motion.frames(slice(span.start - before.frames.start, None))
    T = len(time)
    R, p_world = np.tile(last.R_parent_child[:1], (T, 1, 1, 1)), np.tile(last.p_world_pelvis[:1], (T, 1))
    state = replace(shared.state, R_parent_child=R, p_world_pelvis=p_world)
    model = replace(shared.model, frames=frames, initial_pose=None)
    return SolvedWindow(span, (_decode(model, state, settings, _unknown(frames) if settings.covariance else None),))


def _unknown(frames: ImuFrames) -> PoseCovariance:
    """Of frames in which nothing was measured: turned in any way, and gone as far as people walk."""
    walking_speed = 1.4  # m/s, unseen
    walked = walking_speed * (frames.time - frames.time[0])
    return PoseCovariance(
        np.tile(np.pi**2 * np.eye(3), (len(frames), JOINT_COUNT, 1, 1)), walked[:, None, None] ** 2 * np.eye(3)
    )


def _decode(
    model: WearerProblem, state: WearerState, settings: Settings, covariance: PoseCovariance | None = None
) -> WearerEstimate:
    return decode(method_of(model, settings), model, state, covariance, flatten(settings))
