"""The estimate of a filmed scene that is solved window by window: calibrated from a stretch, then from end to end."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from vip_factors.body.skeleton import JOINT_COUNT
from vip_factors.display import ProgressCallback, silent
from vip_factors.estimate import CameraEstimate, Estimate, PoseCovariance, WearerEstimate
from vip_factors.estimate_chunks import EstimateChunks
from vip_factors.findings import Finding, MergedFindings
from vip_factors.geometry.rotations import wrap_angle
from vip_factors.problem.scene import ExtraTerms
from vip_factors.sensors.calibration import SensorCalibration
from vip_factors.sensors.sources import SceneSource
from vip_factors.settings import Settings, flatten
from vip_factors.stages.drift import clock_findings, drift_findings
from vip_factors.stages.filmed_window import CoarseWindow, solve_coarsely
from vip_factors.stages.inertial_windows import numbered
from vip_factors.stages.scene_calibration import SceneCalibration, calibrate_scene, fusion_solve_settings
from vip_factors.stages.solver import Solver
from vip_factors.stages.window_join import Headings, SolvedWindow, chunks_of, moved
from vip_factors.stages.windows import Each, WindowPlan, scene_plan

OF_THE_WHOLE = ("heading drift", "video clock off", "video clock drift")  # no window tells these


def smooth_filmed(
    source: SceneSource,
    settings: Settings,
    on_progress: ProgressCallback,
    extra: ExtraTerms | None = None,
    each: Each = map,
) -> EstimateChunks | tuple[Finding, ...]:
    """The estimate of a scene with a camera; calibrated now, and in windows solved as its chunks are asked for.

    Args:
        source: of the scene.
        settings: of all rooms.
        on_progress: called with the name of the stage and the fraction of it done.
        extra: terms of a user's own; with them all frames are one window.
        each: as :func:`map`: where windows are solved at the full rate.

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
    head = _head(estimate, source, plan, settings)
    learned = None
    if plan.all_calibrate:
        head = replace(head, wearer_of_detection=estimate.wearer_of_detection)
        windows = stretch.windows(plan, settings, each)
    else:
        learned = _Learned(source, plan, MergedFindings([f for f in estimate.findings if f.kind not in OF_THE_WHOLE]))
        windows = learned.listening_to(_windows(source, stretch.calibration(estimate), plan, settings, each))
    chunks = chunks_of(numbered(windows, plan, on_progress), head)
    return EstimateChunks(
        head,
        (plan.frames,) * len(head.wearers),
        chunks if learned is None else learned.labelled(chunks),
        plan.frames if source.head.cameras[0].moving else 1,
        None if learned is None else partial(learned.closed, head),
    )


def _windows(
    source: SceneSource, calibration: SceneCalibration, plan: WindowPlan, settings: Settings, each: Each
) -> Iterator[SolvedWindow]:
    """Every window, in one world."""
    before, first = None, source.head.cameras[0]
    carried = first.moving and first.known_path is None
    for window in each(CoarseWindow.solved, _coarse_windows(source, calibration, plan, settings)):
        if before is not None and carried and not window.is_placed:
            window = moved(window, before, settings.factors.floor_contact.use)
        before = window
        yield window


def _coarse_windows(
    source: SceneSource, calibration: SceneCalibration, plan: WindowPlan, settings: Settings
) -> Iterator[CoarseWindow]:
    """The coarse frames of every window, one after the other."""
    before = None
    for span in plan.windows():
        own = Solver(fusion_solve_settings(settings), silent, name=settings.solver)
        before = solve_coarsely(source, calibration, before, plan, span, settings, own)
        yield before


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


@dataclass
class _Learned:
    """What windows teach of the whole scene, as they go by."""

    source: SceneSource
    plan: WindowPlan
    findings: MergedFindings
    headings: list[tuple[Headings, ...]] = field(default_factory=list)  # of each window
    wearer: list[np.ndarray] = field(default_factory=list)
    clocks: list[tuple[float, float]] = field(default_factory=list)  # seconds of the video, and how late it is there

    def listening_to(self, windows: Iterator[SolvedWindow]) -> Iterator[SolvedWindow]:
        """The windows, as they are."""
        for window in windows:
            assert window.camera is not None
            start, end = self.plan.time(window.frames)[[0, -1]].tolist()
            self.findings.add(window.findings, start, end)
            self.headings.append(window.headings)
            clock = window.camera.clock
            own = ((start + end) / 2 - clock.offset) / (1 + clock.drift)
            self.clocks.append((own, clock.late(own)))
            yield window

    def labelled(self, chunks: Iterator[Estimate]) -> Iterator[Estimate]:
        """The chunks, as they are."""
        for chunk in chunks:
            self.wearer.append(chunk.wearer_of_detection)
            yield chunk

    def closed(self, head: Estimate) -> Estimate:
        """The head of the estimate, after all windows."""
        wearers = tuple(
            replace(one, calibration=_calibration(one, headings))
            for one, headings in zip(head.wearers, zip(*self.headings, strict=True), strict=True)
        )
        plan, last = self.plan, float(self.plan.time(slice(self.plan.frames - 1, self.plan.frames))[0])
        unseen = (-np.inf, plan.start), (float(np.nextafter(last, np.inf)), np.inf)
        before, after = (np.full(self.source.detected(*one), -1) for one in unseen)
        camera = _with_clock(head.camera, self.clocks)
        clock = () if camera is None else clock_findings(self.source.head.cameras[0], camera, (plan.start, last))
        drifts = [finding for one in wearers for finding in drift_findings(one.motion.name, one.calibration)]
        return replace(
            head,
            wearers=wearers,
            wearer_of_detection=np.concatenate([before, *self.wearer, after]).astype(int),
            findings=(*self.findings.all(), *drifts, *clock),
        )


def _with_clock(camera: CameraEstimate | None, clocks: Sequence[tuple[float, float]]) -> CameraEstimate | None:
    """The camera with a clock through what windows found of it."""
    least_clocks = 2  # windows through whose clocks there is a line
    if camera is None or len(clocks) < least_clocks:
        return camera
    time, late = np.array(clocks).T
    drift, offset = np.polyfit(time, late, 1)
    return replace(camera, time_offset=float(offset), time_drift=float(drift))


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
