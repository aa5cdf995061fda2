"""A long recording without all of it in memory: its calibration from some stretches, then window by window.

What all frames share (headings, mountings, the mean pose, axes of hinges) is found on coarse frames of stretches that
are spread over the recording, in one problem. Every window is then solved as a recording would be whose calibration is
known, from a little before the last one ends, and where that has put the wearer.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.assembly.objective import WearerObjective
from vip_factors.body.skeleton import JOINT_COUNT
from vip_factors.estimate import PoseCovariance, SolveReport
from vip_factors.geometry.rotations import Array
from vip_factors.initialise.calibration import InitialCalibration
from vip_factors.initialise.pose import first_poses
from vip_factors.problem.state import WearerState
from vip_factors.problem.wearer import WearerProblem
from vip_factors.sensors.frames import ImuFrames, in_stretches
from vip_factors.sensors.imu_stream import ImuStream
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.sampled import SampledRecording, closed_up, frames_of, samples_around
from vip_factors.settings import Settings
from vip_factors.solve.marginals import chain_marginals
from vip_factors.stages.decode import pose_covariance, residuals
from vip_factors.stages.inertial import Tracked, at_frames, calibrated, found_start, inertial_tracker
from vip_factors.stages.inertial_model import alone, calibration_held, kept, placed_on_floor, with_contacts
from vip_factors.stages.sensor_checks import CorrectedSamples, sensor_corrections
from vip_factors.stages.solver import Solver
from vip_factors.stages.windows import WindowPlan

WALKING = 1.4  # m/s, unseen
ROUGHLY = 0.1  # relative decrease at which coarse solves stop: the last one of a window goes on from there


@dataclass(frozen=True)
class SolvedWindow:
    """A window and its solution.

    Attributes:
        frames: of the recording.
        state: in the world of the windows before it, as far as they overlap.
        covariance: on request; of the root's position as from the window's first frame.
        residuals: as of an estimate.
        reports: of its solves.
    """

    frames: slice
    state: WearerState
    covariance: PoseCovariance | None
    residuals: dict[str, Array]
    reports: tuple[SolveReport, ...] = ()


def with_sensors_checked(
    recording: SampledRecording, plan: WindowPlan, settings: Settings
) -> tuple[SampledRecording, tuple[str, ...]]:
    """The recording with its sensors put right, and what was found: see :mod:`~vip_factors.stages.sensor_checks`.

    Accelerometers are looked over in the stretches that calibrate, clocks are compared in the middle.

    Raises:
        RecordingError: for a recording that cannot be used.
    """
    if not (settings.accelerometers.check or settings.sensor_clocks.check):
        return recording, ()
    _, _, together = _calibrating(recording, plan)
    (start, end), half = recording.interval, settings.sensor_clocks.seconds / 2
    middle = dict(recording.between((start + end) / 2 - half, (start + end) / 2 + half))
    corrections, findings = sensor_corrections(together, replace(together, imus=middle), settings)
    return CorrectedSamples(recording, corrections) if corrections else recording, findings


def _calibrating(
    recording: SampledRecording, plan: WindowPlan
) -> tuple[list[Array], list[Mapping[str, ImuStream]], Recording]:
    """Times of the coarse frames that calibrate, their samples stretch by stretch, and these closed up."""
    times = [plan.coarse_time(one) for one in plan.calibrating()]
    stretches = [samples_around(recording, time) for time in times]
    if len(times) == 1:
        return times, stretches, replace(recording.head, imus=dict(stretches[0]))
    return times, stretches, closed_up(recording.head, stretches, times)


def calibrate(recording: SampledRecording, plan: WindowPlan, settings: Settings, solver: Solver) -> Tracked:
    """What all frames share, found from coarse frames of some stretches.

    Returns:
        The problem as the inertial tracker leaves it, on the stretches' frames, and the solution of the free one.

    Raises:
        InputError, RecordingError: for a recording that cannot be used.
        SolveError: if the problem is not determined.
    """
    times, stretches, together = _calibrating(recording, plan)
    frames = in_stretches([frames_of(own, recording.sensors, time) for own, time in zip(stretches, times, strict=True)])
    evenly = replace(frames, time=frames.time[0] + frames.step * np.arange(len(frames)))
    calibration, starts = found_start(together, evenly, settings, solver.telling("start"))
    tracked = inertial_tracker(together, frames, _with_knots_in_stretches(plan, settings), solver, calibration)
    if settings.acceleration:
        tracked = calibrated(tracked, settings, solver)
    return replace(tracked, starts=starts)


def _with_knots_in_stretches(plan: WindowPlan, settings: Settings) -> Settings:
    """Settings whose headings have no more knots than there are stretches to see them in."""
    every, stretches = settings.calibration.heading_knot_s, settings.windows.calibration_stretches
    if every is None:
        return settings
    apart = plan.frames / plan.rate / max(stretches - 1, 1)
    return replace(settings, calibration=replace(settings.calibration, heading_knot_s=max(every, apart)))


def solve_windows(
    found: Tracked, recording: SampledRecording, plan: WindowPlan, settings: Settings, solver: Callable[[int], Solver]
) -> Iterator[SolvedWindow]:
    """Every window, one after another.

    Args:
        found: what all of them share.
        recording, plan, settings: of all.
        solver: of a window, by its number.

    Raises:
        RecordingError: for samples that cannot be used.
        SolveError: if a window's problem is not determined.
    """
    before: SolvedWindow | None = None
    for number, span in enumerate(plan.windows()):
        time, own = plan.time(span), solver(number)
        streams = samples_around(recording, time)
        frames = frames_of(streams, recording.sensors, time)
        coarse = frames_of(streams, recording.sensors, time[:: plan.factor])
        first = found.model.initial_pose if span.start == 0 else None
        model = replace(found.model, frames=coarse, initial_pose=first)
        if before is not None and not frames.orientation_valid.any():
            model, state = replace(model, frames=frames), _as_last_seen(before, span)
            covariance = _unknown(frames) if settings.covariance else None
        else:
            state = _tracked(model, found.state, own)
            model, state = _at_full_rate(model, state, frames, before, span, settings, own)
            covariance = _covariance(model, state) if settings.covariance else None
        reports = tuple(replace(one, stage=f"{one.stage}, window {number + 1}") for one in own.reports)
        before = SolvedWindow(span, state, covariance, residuals(model, state), reports)
        yield before


def _tracked(model: WearerProblem, found: WearerState, solver: Solver) -> WearerState:
    """The inertial tracker's solution on a window's frames, on standing feet; what all frames share is kept."""
    middle = model.knot_weights(slice(len(model.frames) // 2, len(model.frames) // 2 + 1))
    headings = found.headings if middle is None else middle[0] @ found.heading_knots
    calibration = InitialCalibration(headings, np.full(len(headings), np.inf), found.R_bone_sensor)
    R = first_poses(model.frames, [sensor.bone for sensor in model.sensors], calibration, model.prior)
    state = replace(found, R_parent_child=R, p_world_pelvis=np.zeros((len(R), 3)))
    state = solver.solve_wearer(WearerObjective(alone(model)), state, "inertial tracker")
    return placed_on_floor(model, state)


def _at_full_rate(
    model: WearerProblem, state: WearerState, frames: ImuFrames, before: SolvedWindow | None, span: slice,
    settings: Settings, solver: Solver,
) -> tuple[WearerProblem, WearerState]:  # fmt: skip
    """The solution on all of a window's frames, from that of the inertial tracker on its coarse ones."""
    if not settings.acceleration:
        return alone(model), _where_it_was(state, before, span)
    roughly = replace(solver, settings=replace(solver.settings, relative_decrease=ROUGHLY))
    held = calibration_held(model)
    for _ in range(settings.calibration.passes):
        state = roughly.solve_wearer(WearerObjective(with_contacts(held, state)), state, "calibrated")
    time = model.frames.time
    fine = with_contacts(kept(model, frames), _where_it_was(at_frames(state, time, frames.time), before, span))
    state = _where_it_was(at_frames(state, time, frames.time), before, span)
    return fine, solver.solve_wearer(WearerObjective(fine), state, "sparse inertial poser")


def _where_it_was(state: WearerState, before: SolvedWindow | None, span: slice) -> WearerState:
    """The state moved to where the window before has its first frame."""
    if before is None:
        return state
    there = before.state.p_world_pelvis[span.start - before.frames.start]
    return replace(state, p_world_pelvis=state.p_world_pelvis + (there - state.p_world_pelvis[0]))


def _as_last_seen(before: SolvedWindow, span: slice) -> WearerState:
    """A window in which nobody measured anything: the wearer stays as at its first frame, which the one before has."""
    first = span.start - before.frames.start
    last = before.state.window(slice(first, first + 1))
    T = span.stop - span.start
    R, p_world = np.tile(last.R_parent_child, (T, 1, 1, 1)), np.tile(last.p_world_pelvis, (T, 1))
    return replace(last, R_parent_child=R, p_world_pelvis=p_world)


def _unknown(frames: ImuFrames) -> PoseCovariance:
    """Of frames in which nothing was measured: turned in any way, and gone as far as people walk."""
    walked = WALKING * (frames.time - frames.time[0])
    return PoseCovariance(
        np.tile(np.pi**2 * np.eye(3), (len(frames), JOINT_COUNT, 1, 1)), walked[:, None, None] ** 2 * np.eye(3)
    )


def _covariance(model: WearerProblem, state: WearerState) -> PoseCovariance:
    objective = WearerObjective(model)
    return pose_covariance(objective.frame_keys, chain_marginals(objective.linearise(state)))
