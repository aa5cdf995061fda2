"""The pipeline on one page: source → windows → initialise → solve → chunks → estimate (thesis 4.3).

Without a camera each wearer goes by itself: inertial tracker → sparse inertial poser. With cameras all go together:
inertial trackers → association → video-inertial fusion, twice. Either way what all frames share is found first, on
coarse frames; then windows are solved at the full rate. What is short is one window, and all of it calibrates.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
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
from vip_factors.sensors.sources import SceneInMemory, SceneSource
from vip_factors.settings import Settings, flatten
from vip_factors.stages.association import associate_cameras, usable_cameras
from vip_factors.stages.filmed_windows import smooth_filmed
from vip_factors.stages.fusion import fusion_problem
from vip_factors.stages.fusion_start import start_fusion
from vip_factors.stages.inertial import inertial_trackers
from vip_factors.stages.inertial_model import with_contacts
from vip_factors.stages.inertial_windows import smooth_wearer
from vip_factors.stages.reporting import with_model_errors
from vip_factors.stages.restarts import in_own_frames, with_restarts
from vip_factors.stages.sensor_assignment import with_sensors_assigned
from vip_factors.stages.solver import Solver
from vip_factors.stages.windows import Each, scene_plan
from vip_factors.terms.registry import unfilmed_problem

__all__ = ["factor_graph", "smooth", "smooth_chunks"]

DEFAULT = Settings()


def smooth(
    source: Recording | Scene, settings: Settings = DEFAULT, progress: ProgressCallback | None = None,
    extra_factors: ExtraFactors | None = None,
) -> Estimate:  # fmt: skip
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
    source: SceneSource, settings: Settings = DEFAULT, progress: ProgressCallback | None = None,
    extra_factors: ExtraFactors | None = None, each: Each = map,
) -> EstimateChunks:  # fmt: skip
    """The same of a source that need not fit into memory: calibrated now, windows are solved as chunks are asked for.

    Args:
        source: of a scene, in memory or in a file.
        settings, progress, extra_factors: as of :func:`smooth`.
        each: as :func:`map`: where windows are solved; before a camera, their full rate.

    Raises:
        InputError, RecordingError, SolveError: as :func:`smooth`; also as chunks are asked for.
    """
    found = _solved_chunks(source, settings, progress or silent, extra_factors, each)
    return found.changed(lambda one: with_model_errors(one, settings)) if settings.model_errors else found


def _solved_chunks(
    source: SceneSource,
    settings: Settings,
    on_progress: ProgressCallback,
    extra_factors: ExtraFactors | None,
    each: Each,
) -> EstimateChunks:
    with _one_blas_thread():
        extra = None if extra_factors is None else UserTerms(extra_factors)
        source, pauses, about_pauses = with_restarts(source, settings)
        found = _each_solved(source, settings, on_progress, extra, each)
        if not about_pauses:
            return found
    return found.with_findings(about_pauses).changed(lambda one: in_own_frames(one, pauses))


def _each_solved(
    source: SceneSource, settings: Settings, on_progress: ProgressCallback, extra: UserTerms | None, each: Each
) -> EstimateChunks:
    with _one_blas_thread():
        source, findings = with_sensors_assigned(source, settings)
        if source.head.camera is not None and settings.fusion.use_camera:
            filmed = smooth_filmed(source, settings, on_progress, extra, each)
            if isinstance(filmed, EstimateChunks):
                return replace(filmed.with_findings(findings), chunks=_in_one_thread(filmed.chunks))
            findings = (*findings, *filmed, Finding("not in the video"))
        if extra is not None and len(source.wearers) > 1:
            raise InputError(
                "extra factors among several wearers need a camera that sees them: else each is in a world of its own"
            )
        alone = [smooth_wearer(one, settings, on_progress, extra, each) for one in source.wearers]
        if len(alone) > 1:  # several are told apart by who they are; one has the recording's name
            alone = [one.changed(partial(_named, name)) for one, name in zip(alone, source.head.names, strict=True)]
    return _each_in_own_world(source.head.name, alone, findings, settings)


def _named(name: str, estimate: Estimate) -> Estimate:
    """The estimate of one wearer under another name."""
    one = estimate.only_wearer
    about = (replace(said, wearer=name) if said.wearer == one.motion.name else said for said in one.findings)
    return replace(estimate, wearers=(replace(one, motion=replace(one.motion, name=name), findings=tuple(about)),))


def _each_in_own_world(
    name: str, each: Sequence[EstimateChunks], findings: tuple[Finding, ...], settings: Settings
) -> EstimateChunks:
    """Estimates of wearers who have no world in common, as one."""
    wearers = tuple(one.head.only_wearer for one in each)
    findings = (*findings, *(finding for one in wearers for finding in one.findings))
    if len(wearers) > 1:
        findings = (*findings, Finding("apart"))
    head = Estimate(name, wearers[0].method, wearers, findings=findings, settings=flatten(settings))
    ended = [Estimate.of_one(replace(one, reports=())) for one in wearers]

    def chunks() -> Iterator[Estimate]:
        for own in zip_longest(*(one.chunks for one in each)):
            yield replace(head, wearers=tuple((one or end).only_wearer for one, end in zip(own, ended, strict=True)))

    return EstimateChunks(head, tuple(one.frames[0] for one in each), _in_one_thread(chunks()))


def _in_one_thread(chunks: Iterator[Estimate]) -> Iterator[Estimate]:
    with _one_blas_thread():
        yield from chunks


def _one_blas_thread() -> threadpool_limits:
    """NumPy multiplies thousands of small matrices here: a second thread in each product costs more than it brings,
    and twice the time where another program wants the core."""
    return threadpool_limits(limits=1, user_api="blas")


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
    plan = scene_plan(SceneInMemory(scene), settings, whole=True)
    wearers = inertial_trackers(scene, plan.all_coarse_time, settings, solver)
    if scene.camera is not None and settings.fusion.use_camera:
        associated = usable_cameras(associate_cameras(scene, wearers, settings, solver.progress_of("association")))
        if associated:
            start = fusion_problem(start_fusion(associated, wearers, settings), None, associated, settings)
            return factor_graph_of(start.model, start.state)
    problems = [with_contacts(one.model, one.state) for one in wearers]
    return factor_graph_of(unfilmed_problem(problems), SceneState.unfilmed([one.state for one in wearers]))
