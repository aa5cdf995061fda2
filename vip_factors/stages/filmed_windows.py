"""The estimate of a filmed scene that is solved window by window: calibrated from a stretch, then from end to end."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from vip_factors.body.skeleton import JOINT_COUNT
from vip_factors.estimate import CameraEstimate, Estimate, EstimateChunks, PoseCovariance, WearerEstimate
from vip_factors.findings import Finding, MergedFindings
from vip_factors.geometry.rotations import wrap_angle
from vip_factors.problem.scene import ExtraTerms
from vip_factors.sensors.calibration import SensorCalibration
from vip_factors.sensors.sources import SceneSource
from vip_factors.settings import Settings, flatten
from vip_factors.stages.drift import clock_findings, drift_findings
from vip_factors.stages.filmed_window import solve_scene_window
from vip_factors.stages.inertial_windows import WINDOWS, numbered
from vip_factors.stages.scene_calibration import SceneCalibration, calibrate_scene, fusion_solve_settings
from vip_factors.stages.solver import Progress, Solver
from vip_factors.stages.window_join import Headings, SolvedWindow, chunks_of, moved
from vip_factors.stages.windows import WindowPlan, scene_plan

OF_THE_WHOLE = ("heading drift", "video clock off", "video clock drift")  # no window tells these
LEAST_CLOCKS = 2  # windows through whose clocks there is a line


@dataclass
class _Gathered:
    """What windows teach of the whole, as they go by."""

    findings: MergedFindings
    headings: list[list[Headings]] = field(default_factory=list)
    wearer: list[np.ndarray] = field(default_factory=list)
    clocks: list[tuple[float, float]] = field(default_factory=list)  # seconds of the video, and how late it is there


def smooth_filmed(
    source: SceneSource, settings: Settings, on_progress: Progress, extra: ExtraTerms | None = None
) -> EstimateChunks | tuple[Finding, ...]:
    """The estimate of a scene with a camera; calibrated now, and in windows solved as its chunks are asked for.

    Args:
        source: of the scene.
        settings: of all rooms.
        on_progress: called with the name of the stage and the fraction of it done.
        extra: terms of a user's own; with them all frames are one window.

    Returns:
        The estimate; or findings, if no wearer is found in the video, wherever it is looked for.

    Raises:
        InputError, RecordingError: for a scene that cannot be used; for samples, as chunks are asked for.
        SolveError: if the problem is not determined; likewise.
    """
    plan = scene_plan(source, settings, whole=extra is not None or settings.calibration.from_truth)
    solver = Solver(fusion_solve_settings(settings), on_progress, name=settings.solver, extra=extra)
    stretch, findings = calibrate_scene(source, plan, settings, solver)
    if stretch is None:
        return findings
    if plan.is_one_window:
        return EstimateChunks.of(stretch.estimate(settings, plan.time(slice(0, plan.frames))))
    estimate = stretch.estimate(settings)
    moves = source.head.cameras[0].moving
    if plan.all_calibrate:
        head = replace(_head(estimate, source, plan, settings), wearer_of_detection=estimate.wearer_of_detection)
        windows = numbered(stretch.windows(plan, settings), plan, on_progress)
        return EstimateChunks(
            head, (plan.frames,) * len(head.wearers), chunks_of(windows, head), plan.frames if moves else 1
        )
    calibration, head = stretch.calibration(estimate), _head(estimate, source, plan, settings)
    known = [one for one in estimate.findings if one.kind not in OF_THE_WHOLE]
    gathered = _Gathered(MergedFindings(known), [[] for _ in source.wearers])

    def chunks() -> Iterator[Estimate]:
        on_progress(WINDOWS, 0.0)
        for chunk in chunks_of(_windows(source, calibration, plan, settings, on_progress, gathered), head):
            gathered.wearer.append(chunk.wearer_of_detection)
            yield chunk

    return EstimateChunks(
        head,
        (plan.frames,) * len(head.wearers),
        chunks(),
        plan.frames if moves else 1,
        lambda: _closed(head, source, plan, gathered),
    )


def _windows(
    source: SceneSource, calibration: SceneCalibration, plan: WindowPlan, settings: Settings, on_progress: Progress,
    gathered: _Gathered,
) -> Iterator[SolvedWindow]:  # fmt: skip
    """Every window, in one world."""
    spans, before = plan.windows(), None
    first = source.head.cameras[0]
    carried = first.moving and first.known_path is None
    for number, span in enumerate(spans):
        own = Solver(fusion_solve_settings(settings), lambda stage, fraction: None, name=settings.solver)
        window = solve_scene_window(source, calibration, before, plan, span, settings, own)
        if before is not None and carried and not window.is_placed:
            window = moved(window, before, settings.factors.floor_contact.use)
        window = before = window.numbered(number)
        time = plan.time(span)
        gathered.findings.add(window.findings, float(time[0]), float(time[-1]))
        for own_headings, headings in zip(gathered.headings, window.headings, strict=True):
            own_headings.append(headings)
        gathered.clocks.append(_clock_in(window, float(time[0] + time[-1]) / 2))
        on_progress(WINDOWS, (number + 1) / len(spans))
        yield window


def _head(estimate: Estimate, source: SceneSource, plan: WindowPlan, settings: Settings) -> Estimate:
    """The estimate of the calibrating stretch without its frames, as the windows' estimate begins."""
    empty = PoseCovariance(np.zeros((0, JOINT_COUNT, 3, 3)), np.zeros((0, 3, 3))) if settings.covariance else None
    none = [replace(one.frames(slice(0, 0)), covariance=empty) for one in estimate.wearers]
    return replace(
        estimate,
        name=source.head.name,
        wearers=tuple(replace(one, motion=replace(one.motion, rate=plan.rate, start=plan.start)) for one in none),
        camera=None if estimate.camera is None else estimate.camera.start,
        wearer_of_detection=np.zeros(0, int),
        settings=flatten(settings),
    )


def _closed(head: Estimate, source: SceneSource, plan: WindowPlan, gathered: _Gathered) -> Estimate:
    wearers = tuple(
        replace(one, calibration=_calibration(one, headings))
        for one, headings in zip(head.wearers, gathered.headings, strict=True)
    )
    last = float(plan.time(slice(plan.frames - 1, plan.frames))[0])
    unseen = source.detected(-np.inf, plan.start), source.detected(float(np.nextafter(last, np.inf)), np.inf)
    before, after = (np.full(count, -1) for count in unseen)
    camera, first = _with_clock(head.camera, gathered.clocks), source.head.cameras[0]
    clock = () if camera is None else clock_findings(first, camera, (plan.start, last))
    return replace(
        head,
        wearers=wearers,
        wearer_of_detection=np.concatenate([before, *gathered.wearer, after]).astype(int),
        findings=(*gathered.findings.all(), *_drifts(wearers), *clock),
    )


def _clock_in(window: SolvedWindow, time: float) -> tuple[float, float]:
    assert window.camera is not None
    clock = window.camera.clock
    own = (time - clock.offset) / (1 + clock.drift)
    return own, clock.late(own)


def _with_clock(camera: CameraEstimate | None, clocks: Sequence[tuple[float, float]]) -> CameraEstimate | None:
    """The camera with a clock through what windows found of it."""
    if camera is None or len(clocks) < LEAST_CLOCKS:
        return camera
    time, late = np.array(clocks).T
    drift, offset = np.polyfit(time, late, 1)
    return replace(camera, time_offset=float(offset), time_drift=float(drift))


def _drifts(wearers: Sequence[WearerEstimate]) -> Iterator[Finding]:
    for one in wearers:
        yield from drift_findings(one.motion.name, one.calibration)


def _calibration(one: WearerEstimate, headings: Sequence[Headings]) -> dict[str, SensorCalibration]:
    """Headings over all windows: each has its own until the next one begins."""
    kept = [own.time < after.time[0] for own, after in itertools.pairwise(headings)]
    kept.append(np.ones(len(headings[-1].time), bool))
    time = np.concatenate([own.time[which] for own, which in zip(headings, kept, strict=True)])
    knots = np.concatenate([own.knots[which] for own, which in zip(headings, kept, strict=True)])
    found = {}
    for sensor, path in zip(one.sensors, knots.T, strict=True):
        heading = float(wrap_angle(path[0]))
        moves = {"heading_time": time, "heading_path": heading + path - path[0]} if len(time) > 1 else {}
        found[sensor] = replace(one.calibration[sensor], heading=heading, **moves)
    return found
