"""The pipeline: check → plan → calibrate → solve windows → join (thesis 4.3).

Without a camera each wearer goes by itself: inertial tracker → sparse inertial poser. With cameras all go together:
inertial trackers → association → video-inertial fusion, twice. Either way what all frames share is found first, on
coarse frames; then windows are solved at the full rate. What is short is one window, and all of it calibrates.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import zip_longest

from threadpoolctl import threadpool_limits

from vip_factors.display import ProgressCallback, silent
from vip_factors.errors import InputError
from vip_factors.estimate import Estimate
from vip_factors.estimate_chunks import EstimateChunks
from vip_factors.factor_graph.extra import ExtraFactors, UserTerms
from vip_factors.factor_graph.graph import FactorGraph, factor_graph_of
from vip_factors.findings import Finding
from vip_factors.problem.state import SceneState
from vip_factors.sensors.recording import Recording
from vip_factors.sensors.scene import Scene, as_scene
from vip_factors.sensors.sources import SceneInMemory, SceneSource, UnfilmedSource
from vip_factors.settings import Settings
from vip_factors.stages.calibrate import calibrate
from vip_factors.stages.fusion import fusion_problem
from vip_factors.stages.fusion_start import FusionStart
from vip_factors.stages.inertial import WearerStart, inertial_trackers
from vip_factors.stages.inertial_model import with_contacts
from vip_factors.stages.pauses import with_pauses
from vip_factors.stages.reporting import calibrated_estimate, with_model_errors
from vip_factors.stages.scene_solution import start_before_cameras
from vip_factors.stages.sensor_assignment import with_sensors_assigned
from vip_factors.stages.solve_windows import solve_at_once, solve_windows
from vip_factors.stages.solver import Solver
from vip_factors.stages.window_join import join
from vip_factors.stages.windows import MapFn, coarse_times, plan_scene, plan_windows
from vip_factors.terms.registry import unfilmed_problem

__all__ = ["factor_graph", "smooth", "smooth_chunks"]

DEFAULT = Settings()
# NumPy multiplies thousands of small matrices: a second thread costs more than it brings.
ONE_BLAS_THREAD = {"limits": 1, "user_api": "blas"}


def smooth(
    source: Recording | Scene,
    settings: Settings = DEFAULT,
    progress: ProgressCallback | None = None,
    extra_factors: ExtraFactors | None = None,
) -> Estimate:
    """Reconstruct a recording or a scene: of its wearers' IMUs and of what its cameras saw, or of the IMUs alone.

    First coarsely: the inertial tracker (IT; thesis eq. 4.10) starts the sparse inertial poser (SIP; thesis 3.3) or,
    before cameras, association and fusion, on every n-th frame, with headings, mountings and the mean pose free. Then
    at the full rate, with those kept. The acceleration factor is exact at either rate. What is long is solved in
    windows (:class:`~vip_factors.settings.WindowSettings`), unless there are extra factors.

    Args:
        source: of one wearer or several, each with a placed sensor, with or without cameras; a camera that never shows
            a wearer is left out, and a finding says so.
        settings: of all rooms.
        progress: called with the name of the stage and the fraction of it done.
        extra_factors: makes GTSAM factors of your own, given the frames' times, once for the coarse frames and once for
            all; see :data:`~vip_factors.factor_graph.extra.ExtraFactors`. Wearers are numbered in their order.

    Raises:
        InputError, RecordingError: for a recording that cannot be used.
        SolveError: if the problem is not determined.
    """
    return smooth_chunks(SceneInMemory(as_scene(source)), settings, progress, extra_factors).whole()


def smooth_chunks(
    source: SceneSource,
    settings: Settings = DEFAULT,
    progress: ProgressCallback | None = None,
    extra_factors: ExtraFactors | None = None,
    map_fn: MapFn = map,
) -> EstimateChunks:
    """Smooth a source that need not fit into memory: calibrate now, and solve windows as chunks are asked for.

    Args:
        source: of a scene, in memory or in a file.
        settings, progress, extra_factors: as of :func:`smooth`.
        map_fn: as :func:`map`: where windows are solved; before a camera, their full rate.

    Raises:
        InputError, RecordingError, SolveError: as :func:`smooth`; also as chunks are asked for.
    """
    extra = None if extra_factors is None else UserTerms(extra_factors)
    with threadpool_limits(**ONE_BLAS_THREAD):
        source, pause_findings = with_pauses(source, settings)
        source, findings, starts = with_sensors_assigned(source, settings, coarse_times(source, settings))
        estimate = _smooth_checked(source, findings, starts, settings, progress or silent, extra, map_fn)

    def reported(chunk: Estimate) -> Estimate:
        chunk = _with_findings(chunk, pause_findings)
        return with_model_errors(chunk) if settings.model_errors else chunk

    estimate = estimate.changed(reported)
    return replace(estimate, chunks=_in_one_thread(estimate.chunks))


def _smooth_checked(
    source: SceneSource,
    findings: tuple[Finding, ...],
    starts: Sequence[WearerStart | None],
    settings: Settings,
    on_progress: ProgressCallback,
    extra: UserTerms | None,
    map_fn: MapFn,
) -> EstimateChunks:
    """Smooth all wearers in front of the cameras, or each by itself if these show nobody; prepend ``findings``."""
    if source.head.camera is not None and settings.fusion.use_camera:
        filmed = _smooth_scene(source, starts, settings, on_progress, extra, map_fn)
        if isinstance(filmed, EstimateChunks):
            return filmed.changed(lambda chunk: _with_findings(chunk, findings))
        reason = "no wearer was found in it, the estimate is of the IMUs alone"
        findings = (*findings, *filmed, Finding("video unused", words={"reason": reason}))
    if extra is not None and len(source.wearers) > 1:
        raise InputError(
            "extra factors between several wearers need a camera that sees them; without one the wearers share no world"
        )
    estimates = []
    for recording, start in zip_longest(source.wearers, starts):
        wearer_source = UnfilmedSource(Scene(recording.head.name, (recording.head,)), (recording,))
        estimate = _smooth_scene(wearer_source, (start,), settings, on_progress, extra, map_fn)
        assert isinstance(estimate, EstimateChunks)
        estimates.append(estimate)
    return EstimateChunks.apart(source.head.name, estimates).changed(lambda chunk: _with_findings(chunk, findings))


def _smooth_scene(
    source: SceneSource,
    starts: Sequence[WearerStart | None],
    settings: Settings,
    on_progress: ProgressCallback,
    extra: UserTerms | None,
    map_fn: MapFn,
) -> EstimateChunks | tuple[Finding, ...]:
    """Smooth wearers in front of cameras, or one wearer; return findings if the cameras show none of the wearers."""
    plan = plan_windows(source, settings, single_window=extra is not None)
    calibration = calibrate(source, plan, settings, on_progress, extra, starts)
    if isinstance(calibration, tuple):
        return calibration
    if plan.is_one_window:
        return EstimateChunks.of(solve_at_once(source, calibration, plan, settings))
    calibrated = calibrated_estimate(calibration, settings)
    windows = solve_windows(source, calibration, calibrated, plan, settings, map_fn)
    return join(windows, calibrated, source, plan, on_progress)


def _with_findings(chunk: Estimate, findings: tuple[Finding, ...]) -> Estimate:
    """Prepend findings."""
    return replace(chunk, findings=(*findings, *chunk.findings))


def _in_one_thread(chunks: Iterator[Estimate]) -> Iterator[Estimate]:
    with threadpool_limits(**ONE_BLAS_THREAD):
        yield from chunks


def factor_graph(
    source: Recording | Scene, settings: Settings = DEFAULT, progress: ProgressCallback | None = None
) -> FactorGraph:
    """The factor graph of a recording or a scene before it is solved, with everything free, and where it starts.

    It is the problem in which headings, mountings and the camera are found, at ``calibration_rate``: of a
    scene the first round of fusion, of a recording the first calibration. What comes before it is done here: the
    inertial tracker and who is who.

    Args:
        source: of one wearer, or filmed.
        settings: of all rooms; ``calibration_rate=frame_rate`` for the graph of all frames.
        progress: called with the name of the stage and the fraction of it done.

    Returns:
        The graph, values to start from, and what they stand for.

    Raises:
        InputError, RecordingError: for a recording that cannot be used.
        SolveError: if a problem on the way is not determined.
    """
    scene = as_scene(source)
    solver = Solver(settings.solve, progress or silent, name=settings.solver)
    plan = plan_scene(SceneInMemory(scene), settings, single_window=True)
    trackers = inertial_trackers(scene, plan.all_coarse_time, settings, solver)
    if scene.camera is not None and settings.fusion.use_camera:
        start = start_before_cameras(scene, trackers, settings, solver, is_calibrated=True)
        if isinstance(start, FusionStart):
            problem = fusion_problem(start, None, start.associated, settings)
            return factor_graph_of(problem.model, problem.state)
    problems = [with_contacts(tracker.model, tracker.state) for tracker in trackers]
    state = SceneState.unfilmed([tracker.state for tracker in trackers])
    return factor_graph_of(unfilmed_problem(problems), state)
