"""The pipeline on one page: recording → inertial tracker → sparse inertial poser → estimate.

And with cameras: scene → inertial trackers → association → video-inertial fusion, twice → estimate (thesis 4.3).
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import zip_longest

from threadpoolctl import threadpool_limits

from vip_factors.assembly.objective import WearerObjective
from vip_factors.errors import InputError
from vip_factors.estimate import Estimate, EstimateChunks, PoseCovariance, WearerEstimate
from vip_factors.factor_graph.extra import ExtraFactors, UserTerms
from vip_factors.problem.state import WearerState
from vip_factors.problem.wearer import WearerProblem
from vip_factors.sensors.frames import resample
from vip_factors.sensors.long_scene import LongScene, SceneInMemory
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.sampled import RecordingInMemory, SampledRecording
from vip_factors.sensors.scene import Scene
from vip_factors.settings import Settings, flatten
from vip_factors.solve.levenberg_marquardt import SolveSettings
from vip_factors.solve.marginals import chain_marginals
from vip_factors.stages.association import first_association, of_use
from vip_factors.stages.calibration_start import start_choice, start_findings
from vip_factors.stages.decode import decode, pose_covariance
from vip_factors.stages.drift import drift_findings
from vip_factors.stages.filming import start_filming
from vip_factors.stages.fusion import fuse_finely, fuse_in_rounds
from vip_factors.stages.inertial import (
    Tracked,
    at_frames,
    calibrated,
    inertial_tracker,
    inertial_trackers,
    with_calibration_sigmas,
)
from vip_factors.stages.inertial_model import alone, kept, method_of, with_contacts
from vip_factors.stages.open_graph import factor_graph
from vip_factors.stages.reporting import scene_estimate, who_is_who
from vip_factors.stages.scene_calibration import stiff
from vip_factors.stages.scene_windowed import covered, smooth_scene_windows
from vip_factors.stages.sensor_checks import checked, checked_scene
from vip_factors.stages.solver import Progress, Solver
from vip_factors.stages.wearer_findings import posture_findings
from vip_factors.stages.windowed import is_long, smooth_windows
from vip_factors.stages.windows import scene_frames

__all__ = ["covered", "factor_graph", "is_long", "smooth", "smooth_long", "smooth_long_scene", "smooth_scene"]

DEFAULT = Settings()
UNSEEN = "no wearer was found in the video: the estimate is of the IMUs alone, without a camera"
UNPLACED = "without a camera the wearers are not placed relative to one another"
# NumPy multiplies thousands of small matrices here: a second thread in each product costs more than it brings, and
# twice the time where another program wants the core.
one_blas_thread = threadpool_limits.wrap(limits=1, user_api="blas")


@one_blas_thread
def smooth(
    recording: Recording, settings: Settings = DEFAULT, progress: Progress | None = None,
    extra_factors: ExtraFactors | None = None,
) -> WearerEstimate:  # fmt: skip
    """Reconstruct a whole recording from its IMUs.

    First coarsely: the inertial tracker (IT; thesis eq. 4.10) starts the sparse inertial poser (SIP; thesis 3.3) on
    every n-th frame, with headings, mountings and the mean pose free. Then at the full rate, with those kept. The
    acceleration factor is exact at either rate. A long recording is solved in windows
    (:class:`~vip_factors.settings.WindowSettings`), unless there are extra factors.

    Args:
        recording: with at least one placed sensor.
        settings: of all rooms.
        progress: called with the name of the stage and the fraction of it done.
        extra_factors: makes GTSAM factors of your own, given the frames' times, once for the coarse frames and once for
            all; see :data:`~vip_factors.factor_graph.extra.ExtraFactors`.

    Raises:
        InputError, RecordingError: for a recording that cannot be used.
        SolveError: if the problem is not determined.
    """
    if extra_factors is None and recording.placed and is_long(RecordingInMemory(recording).interval, settings):
        return smooth_long(recording.name, [RecordingInMemory(recording)], settings, progress).whole().only_wearer
    solver = _solver(settings, settings.solve, progress, extra_factors)
    coarse = settings.coarse_factor if settings.acceleration else 1
    recording, about_sensors = checked(recording, settings)
    frames = resample(recording, settings.frame_rate / coarse)
    tracked = inertial_tracker(recording, frames, settings, solver)
    model, state = tracked.model, tracked.state
    if not settings.acceleration:
        model = alone(model)
    else:
        tracked = calibrated(tracked, settings, solver, solver.extra)
        model, state = tracked.model, tracked.state
        model = kept(model, resample(recording, settings.frame_rate))
        state = at_frames(state, frames.time, model.frames.time)
        model = with_contacts(model, state)
        state = solver.solve_wearer(WearerObjective(model, solver.extra), state, "sparse inertial poser")
    covariance = _covariance(model, state) if settings.covariance else None
    estimate = decode(
        recording.name, method_of(model, settings), model, state, covariance, tuple(solver.reports), flatten(settings)
    )
    who = f"wearer '{recording.subject.name}'"
    odd = posture_findings(who, recording, estimate.motion, estimate.calibration, model.prior_R_bone_sensor)
    drift = drift_findings(who, estimate.calibration)
    found = (*about_sensors, *start_findings(who, frames.sensors, tracked.starts), *odd, *drift)
    estimate = replace(estimate, findings=found, start=start_choice(frames.sensors, tracked.starts))
    if not settings.acceleration:
        return estimate
    return with_calibration_sigmas(estimate, tracked, settings.calibration, solver.extra)


@one_blas_thread
def smooth_scene(
    scene: Scene, settings: Settings = DEFAULT, progress: Progress | None = None,
    extra_factors: ExtraFactors | None = None,
) -> Estimate:  # fmt: skip
    """Reconstruct a scene: of its wearers' IMUs and of what its cameras saw, or of the IMUs alone.

    A long one is solved in windows (:class:`~vip_factors.settings.WindowSettings`), unless there are extra factors.

    Args:
        scene: with or without cameras; one that never shows a wearer is left out, and a finding says so.
        settings: of all rooms.
        progress: called with the name of the stage and the fraction of it done.
        extra_factors: makes GTSAM factors of your own, as for :func:`smooth`; wearers are numbered in their order.

    Raises:
        InputError, RecordingError: for a scene that cannot be used.
        SolveError: if the problem is not determined.
    """
    if scene.camera is None or not settings.fusion.use_camera:
        return _inertial(scene, settings, progress, (), extra_factors)
    source = SceneInMemory(scene)
    if extra_factors is None and not settings.calibration.from_truth and is_long(covered(source), settings):
        long = smooth_long_scene(source, settings, progress)
        if long is not None:
            return long.whole()
    measured = scene
    scene, about_sensors = checked_scene(measured, settings)
    solver = _solver(settings, stiff(settings), progress, extra_factors)
    frames = scene_frames(scene, settings.frame_rate, settings.coarse_factor)
    wearers = inertial_trackers(scene, frames.coarse, settings, solver)
    names = [wearer.subject.name for wearer in scene.wearers]
    wearers, filmed_by = first_association(scene, wearers, settings, solver)
    associated = of_use(filmed_by)
    if not associated:
        return _inertial(measured, settings, progress, (*who_is_who(scene, filmed_by), UNSEEN), extra_factors)
    filmed = start_filming(associated, wearers, settings)
    fused, associated = fuse_in_rounds(filmed, associated, names, settings, solver)
    fine = fuse_finely(scene, filmed, fused, associated, frames.fine, settings, solver)
    estimate = scene_estimate(scene, fused, fine, associated, tuple(solver.reports), settings)
    told = tuple(
        replace(one, start=start_choice(tracked.model.frames.sensors, tracked.starts))
        for one, tracked in zip(estimate.wearers, wearers, strict=True)
    )
    findings = (*about_sensors, *estimate.findings, *_about_starts(names, wearers))
    return replace(estimate, wearers=told, findings=findings)


def smooth_long(
    name: str, wearers: Sequence[SampledRecording], settings: Settings = DEFAULT, progress: Progress | None = None
) -> EstimateChunks:
    """Reconstruct wearers whom no camera sees, whose recordings need not fit into memory.

    Every wearer's calibration is found now; windows are solved as the chunks of the estimate are asked for.

    Args:
        name: of the scene.
        wearers: their recordings.
        settings: of all rooms.
        progress: called with the name of the stage and the fraction of it done.

    Raises:
        InputError, RecordingError: for recordings that cannot be used.
        SolveError: if the problem is not determined.
    """
    tell = progress or (lambda stage, fraction: None)
    return _side_by_side(name, [smooth_windows(one, settings, tell) for one in wearers])


def _side_by_side(name: str, each: Sequence[EstimateChunks]) -> EstimateChunks:
    """Estimates of wearers who have no world in common, as one."""
    heads = [one.head.only_wearer for one in each]
    head = replace(each[0].head, name=name, wearers=tuple(heads), findings=_unplaced(heads))
    ended = [Estimate.of_one(replace(one, reports=())) for one in heads]

    def chunks() -> Iterator[Estimate]:
        for own in zip_longest(*(one.chunks for one in each)):
            wearers = [(chunk or last).only_wearer for chunk, last in zip(own, ended, strict=True)]
            yield replace(head, wearers=tuple(wearers))

    return EstimateChunks(head, tuple(one.frames[0] for one in each), chunks())


def _unplaced(wearers: Sequence[WearerEstimate]) -> tuple[str, ...]:
    """Findings on wearers who have no world in common."""
    return (*(sentence for one in wearers for sentence in one.findings), *([UNPLACED] if len(wearers) > 1 else []))


def smooth_long_scene(
    source: LongScene, settings: Settings = DEFAULT, progress: Progress | None = None
) -> EstimateChunks | None:
    """Reconstruct a scene with a camera that need not fit into memory, window by window.

    What all frames share is found now; windows are solved as the chunks of the estimate are asked for.

    Args:
        source: the scene.
        settings: of all rooms.
        progress: called with the name of the stage and the fraction of it done.

    Returns:
        The estimate; None if no wearer was found in the video: each is to be reconstructed without it.

    Raises:
        InputError, RecordingError: for a scene that cannot be used.
        SolveError: if the problem is not determined.
    """
    estimate = smooth_scene_windows(source, settings, progress or (lambda stage, fraction: None))
    return None if estimate is None else replace(estimate, head=replace(estimate.head, settings=flatten(settings)))


def _about_starts(names: Sequence[str], wearers: Sequence[Tracked]) -> Iterator[str]:
    for name, one in zip(names, wearers, strict=True):
        yield from start_findings(f"wearer '{name}'", one.model.frames.sensors, one.starts)


def _solver(
    settings: Settings, solve: SolveSettings, progress: Progress | None, extra_factors: ExtraFactors | None
) -> Solver:
    extra = None if extra_factors is None else UserTerms(extra_factors)
    return Solver(solve, progress or (lambda stage, fraction: None), name=settings.solver, extra=extra)


def _inertial(
    scene: Scene, settings: Settings, progress: Progress | None, findings: tuple[str, ...],
    extra_factors: ExtraFactors | None,
) -> Estimate:  # fmt: skip
    """Each wearer by itself, in a world of its own.

    Raises:
        InputError: for extra factors among several wearers, who have no world in common.
    """
    if extra_factors is not None and len(scene.wearers) > 1:
        raise InputError(
            "extra factors among several wearers need a camera that sees them: else each is in a world of its own"
        )
    estimates = tuple(smooth(wearer, settings, progress, extra_factors) for wearer in scene.wearers)
    findings = (*findings, *_unplaced(estimates))
    return Estimate(scene.name, estimates[0].method, estimates, findings=findings, settings=flatten(settings))


def _covariance(model: WearerProblem, state: WearerState) -> PoseCovariance:
    objective = WearerObjective(model)
    return pose_covariance(objective.frame_keys, chain_marginals(objective.linearise(state)))
