"""Windows at the full rate, given what all frames share: each is solved by itself, and all are in one world.

Of a short scene all coarse frames calibrate, and windows start from their solution. Of a long one each window's own
coarse frames are solved first, as those of a scene whose calibration is known. A filmed window begins before the last
one ends: there the wearers are where the coarse frames of that have put them, and its headings are as these have left
them. So nothing waits for a window's full rate, which may be solved elsewhere.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from vip_factors.body.skeleton import JOINT_COUNT
from vip_factors.display import silent
from vip_factors.estimate import Estimate, PoseCovariance
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.frames import ImuFrames, coarser
from vip_factors.sensors.sources import RecordingSource, SceneInMemory, SceneSource, frames_of, samples_around
from vip_factors.settings import Settings, flatten
from vip_factors.stages.calibrate import Calibration
from vip_factors.stages.decode import SceneCovariance, decode, decode_cameras, decode_wearers, scene_covariance
from vip_factors.stages.filmed_window import FilmedWindow, filmed_windows
from vip_factors.stages.inertial import InertialSolution, track_window
from vip_factors.stages.inertial_model import frame_by_frame, method_of, with_contacts, with_fixed_calibration
from vip_factors.stages.reporting import at_nearest, filmed_estimate, unfilmed_estimate
from vip_factors.stages.scene_solution import SceneSolution
from vip_factors.stages.sensor_checks import PreparedRecording
from vip_factors.stages.solver import Solver
from vip_factors.stages.window_join import Headings, SolvedWindow, moved
from vip_factors.stages.windows import MapFn, WindowPlan

# m, of a window that is tracked afresh: where it begins the one before it tells, once it is moved there, and its height
# the floor; held as the beginning of a recording is, that height would be the tracker's.
LATER_START_SIGMA = 1.0


def solve_windows(
    source: SceneSource,
    calibration: Calibration,
    calibrated: Estimate,
    plan: WindowPlan,
    settings: Settings,
    map_fn: MapFn,
) -> Iterator[SolvedWindow]:
    """Every window, one after another, in one world.

    Args:
        source: the scene.
        calibration: what all windows share.
        calibrated: the estimate of the calibrating frames.
        plan, settings: of the scene.
        map_fn: as :func:`map`: where windows are solved; in front of a camera, their full rate.

    Raises:
        RecordingError: for samples that cannot be used.
        SolveError: if a window's problem is not determined.
    """
    quiet_solver = replace(calibration.solver, on_progress=silent, reports=[])
    if not calibration.is_filmed:
        recording = PreparedRecording(source.wearers[0], corrections=calibration.corrections[0])
        yield from _unfilmed_windows(recording, calibration, plan, settings, map_fn)
    elif plan.uses_all_frames:
        yield from _windows_of_solution(calibration.solution, plan, settings, quiet_solver, map_fn)
    else:
        is_carried = all(camera.moving and camera.known_path is None for camera in source.head.cameras)
        previous = None
        for window in map_fn(
            FilmedWindow.solved, filmed_windows(source, calibration, calibrated, plan, settings, quiet_solver)
        ):
            if previous is not None and is_carried and not window.is_placed:
                window = moved(window, previous, settings.factors.floor_contact.use)
            previous = window
            yield window


def solve_at_once(source: SceneSource, calibration: Calibration, plan: WindowPlan, settings: Settings) -> Estimate:
    """The estimate of all frames as one window, given what they share.

    Raises:
        SolveError: if the problem is not determined.
    """
    if calibration.is_filmed:
        frames = calibration.solution.frames_at(plan.time(slice(0, plan.frames)))
        return filmed_estimate(calibration, settings, frames)
    recording = PreparedRecording(source.wearers[0], corrections=calibration.corrections[0])
    (window,) = _unfilmed_windows(recording, calibration, plan, settings, map)
    return unfilmed_estimate(calibration, settings, window.wearers[0])


def _unfilmed_windows(
    recording: RecordingSource, calibration: Calibration, plan: WindowPlan, settings: Settings, map_fn: MapFn
) -> Iterator[SolvedWindow]:
    """Each moved to where the one before it has the wearer; where no sensor measured anything, he stays there."""
    solution, solver = calibration.solution, calibration.solver
    (shared,) = solution.wearers
    if not plan.is_one_window:
        solver = replace(solver, on_progress=silent)
    measured = ((span, _frames(recording, shared.model.frames.sensors, plan.time(span))) for span in plan.windows())
    # Without samples, which need not be sent elsewhere
    solution = replace(solution, scene=SceneInMemory(solution.scene).head)
    previous, has_floor = None, settings.acceleration and shared.model.has_floor
    for span, window in zip(
        plan.windows(), map_fn(partial(_solve_unfilmed, solution, plan, settings, solver), measured), strict=True
    ):
        if previous is None:
            previous = window
        else:
            window = window or _as_last_seen(shared, recording, plan.time(span), span, previous, settings)
            previous = moved(window, previous, has_floor)
        yield previous


def _frames(recording: RecordingSource, sensors: Sequence[str], time: Array) -> ImuFrames:
    return frames_of(samples_around(recording, time), sensors, time)


def _solve_unfilmed(
    solution: SceneSolution, plan: WindowPlan, settings: Settings, solver: Solver, window: tuple[slice, ImuFrames]
) -> SolvedWindow | None:
    """A window of its frames in a world of its own; None of a later one in which nothing was measured."""
    span, frames = window
    if span.start and not frames.orientation_valid.any():
        return None
    solver = replace(solver, reports=[])
    if not plan.uses_all_frames:
        solution = _tracked_afresh(solution, coarser(frames, plan.factor), span.start == 0, settings, solver)
    if settings.acceleration:
        start = solution.problem_on((frames,), settings)
        (model,), (state,) = start.model.wearers, start.state.wearers
        if span.start and not plan.uses_all_frames:
            gauge = replace(model.settings.gauge_prior, position_sigma=LATER_START_SIGMA)
            model = replace(model, settings=replace(model.settings, gauge_prior=gauge))
        state = solver.solve_wearer(model, state, "sparse inertial poser", solver.extra)
    else:
        (wearer,) = solution.wearers
        model, state = frame_by_frame(wearer.model), wearer.state
    solved = SceneSolution.unfilmed(solution.scene, [InertialSolution(model, state)]).fusion
    covariance = scene_covariance(solved.model, solved.state, solver) if settings.covariance else None
    poses = None if covariance is None else covariance.wearers[0]
    estimate = decode(method_of(model, settings), model, state, poses, flatten(settings))
    return SolvedWindow(span, (replace(estimate, reports=tuple(solver.reports)),))


def _tracked_afresh(
    solution: SceneSolution, frames: ImuFrames, is_first: bool, settings: Settings, solver: Solver
) -> SceneSolution:
    """A window's coarse frames solved by themselves, roughly; what all frames share is kept."""
    # Relative decrease at which coarse solves stop: the last one of a window goes on from there
    coarse_decrease = 0.1
    (shared,) = solution.wearers
    model = replace(shared.model, frames=frames, initial_pose=shared.model.initial_pose if is_first else None)
    headings = Headings.of(InertialSolution(model, shared.state)).at(float(frames.time[len(frames) // 2]))
    state = track_window(model, shared.state, headings, solver)
    if settings.acceleration:
        rough = replace(solver, settings=replace(solver.settings, relative_decrease=coarse_decrease))
        fixed = with_fixed_calibration(model)
        for _ in range(settings.calibration.passes):
            state = rough.solve_wearer(with_contacts(fixed, state), state, "calibrated")
    return SceneSolution.unfilmed(solution.scene, [InertialSolution(model, state)])


def _as_last_seen(
    shared: InertialSolution,
    recording: RecordingSource,
    time: Array,
    span: slice,
    previous: SolvedWindow,
    settings: Settings,
) -> SolvedWindow:
    """A window in which nobody measured anything: the wearer stays as at its first frame, which the one before has."""
    walking_speed, T = 1.4, len(time)  # m/s, unseen
    overlap = previous.wearers[0].motion.frames(slice(span.start - previous.frames.start, None))
    R, p_world = np.tile(overlap.R_parent_child[:1], (T, 1, 1, 1)), np.tile(overlap.p_world_pelvis[:1], (T, 1))
    model = replace(shared.model, frames=_frames(recording, recording.sensors, time), initial_pose=None)
    state, covariance = replace(shared.state, R_parent_child=R, p_world_pelvis=p_world), None
    if settings.covariance:  # turned in any way, and gone as far as people walk
        walked = walking_speed * (time - time[0])
        anyhow = np.tile(np.pi**2 * np.eye(3), (T, JOINT_COUNT, 1, 1))
        covariance = PoseCovariance(anyhow, walked[:, None, None] ** 2 * np.eye(3))
    return SolvedWindow(span, (decode(method_of(model, settings), model, state, covariance, flatten(settings)),))


def _windows_of_solution(
    solution: SceneSolution, plan: WindowPlan, settings: Settings, solver: Solver, map_fn: MapFn
) -> Iterator[SolvedWindow]:
    """Windows of a filmed scene that start from the solution of all coarse frames and are in its world."""
    fused = solution.fusion
    covariance = scene_covariance(fused.model, fused.state, solver) if settings.covariance else None
    measured = ((span, solution.frames_at(plan.time(span))) for span in plan.windows())
    sent = replace(solution, scene=SceneInMemory(solution.scene).head)
    return map_fn(partial(_solve_finely, sent, settings, replace(solver, reports=[]), covariance), measured)


def _solve_finely(
    solution: SceneSolution,
    settings: Settings,
    solver: Solver,
    covariance: SceneCovariance | None,
    window: tuple[slice, tuple[ImuFrames, ...]],
) -> SolvedWindow:
    (span, frames), solver = window, replace(solver, reports=[])
    fine = solution.at_full_rate(frames, settings, solver)
    nearest = None if covariance is None else at_nearest(covariance, solution.fusion, frames[0].time)
    cameras = decode_cameras(solution.associated, fine, nearest)
    detection_times = tuple(video.detections.time[video.detections.frame] for video in solution.associated)
    wearers = decode_wearers(fine, nearest)
    return SolvedWindow(span, wearers, cameras, detection_times=detection_times, reports=tuple(solver.reports))
