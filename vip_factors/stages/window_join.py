"""Solved windows in one world, and joined without seams: wearers, camera, and who is who.

Two windows overlap. At its ends a window knows less than all frames together do, by what lies beyond; within some steps
that fades. In the middle of an overlap both have settled: there one passes over into the other.
"""

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from vip_factors.display import ProgressCallback
from vip_factors.estimate import CameraEstimate, Estimate, PoseCovariance, WearerEstimate
from vip_factors.estimate_chunks import EstimateChunks
from vip_factors.findings import Finding, FindingLog
from vip_factors.geometry.rotations import Array, exp, log, rotation_z, transpose, wrap_angle, yaw_of
from vip_factors.initialise.camera import robust_mean_angle
from vip_factors.sensors.calibration import SensorCalibration
from vip_factors.sensors.camera import CameraPath, VideoClock
from vip_factors.sensors.sources import SceneSource
from vip_factors.solve.levenberg_marquardt import SolveReport
from vip_factors.stages.drift import clock_findings, drift_findings
from vip_factors.stages.inertial import InertialSolution
from vip_factors.stages.windows import WindowPlan


@dataclass(frozen=True)
class Headings:
    """Of a wearer's sensors, over some time.

    Attributes:
        time: ``(K,)`` seconds; linear in between, and beyond them as at the nearest.
        path: ``(K, S)`` radians, not wrapped.
    """

    time: Array
    path: Array

    @classmethod
    def of(cls, wearer: InertialSolution) -> "Headings":
        """Those of a solution; constant ones are those of the middle of its frames."""
        model, state = wearer.model, wearer.state
        time = model.heading_times if model.headings_drift else np.atleast_1d(np.mean(model.frames.time[[0, -1]]))
        return cls(time, state.heading_path[: len(time)])

    def at(self, time: float) -> Array:
        """``(S,)`` at an instant, seconds."""
        return np.array([np.interp(time, self.time, column) for column in self.path.T])


@dataclass(frozen=True)
class SolvedWindow:
    """A window and its solution.

    Attributes:
        frames: of the recording.
        wearers: their estimates, with the reports of the solves of each.
        cameras: those of the estimate; none of a wearer whom no camera sees.
        headings: of each wearer's sensors, where windows find them.
        detected_at: ``(N,)`` seconds of the first camera's detections.
        wearer_of_detection: ``(N,)`` whom each of them shows, −1 for nobody.
        is_placed: whether a camera at a known place saw a wearer: the world is that camera's.
        reports: of the solves over all wearers.
        findings: on it.
    """

    frames: slice
    wearers: tuple[WearerEstimate, ...]
    cameras: tuple[CameraEstimate, ...] = ()
    headings: tuple[Headings, ...] = ()
    detected_at: Array = field(default_factory=lambda: np.zeros(0))
    wearer_of_detection: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    is_placed: bool = False
    reports: tuple[SolveReport, ...] = ()
    findings: tuple[Finding, ...] = ()

    def within(self, frames: slice) -> "SolvedWindow":
        """Some of the window's frames; who is who is still of all."""
        own = slice(frames.start - self.frames.start, frames.stop - self.frames.start)
        cameras = tuple(camera.frames(own) for camera in self.cameras)
        return replace(self, frames=frames, wearers=tuple(one.frames(own) for one in self.wearers), cameras=cameras)

    def numbered(self, number: int) -> "SolvedWindow":
        """The same with reports that tell the window's number, counted from 0."""

        def with_number(reports: tuple[SolveReport, ...]) -> tuple[SolveReport, ...]:
            return tuple(replace(one, stage=f"{one.stage}, window {number + 1}") for one in reports)

        wearers = tuple(replace(one, reports=with_number(one.reports)) for one in self.wearers)
        return replace(self, wearers=wearers, reports=with_number(self.reports))


def overlap_middle(before: SolvedWindow, window: SolvedWindow) -> slice:
    """The frames in which one passes over into the next."""
    # Of an overlap, at either end, where a window still misses what lies beyond; in between they meet
    end_effect = 0.4
    first, last = window.frames.start, before.frames.stop
    settled = int((last - first) * end_effect)
    return slice(first + settled, last - settled)


def moved(window: SolvedWindow, before: SolvedWindow, has_floor: bool) -> SolvedWindow:
    """A window whose world is its own in the world of the one before, by where both have wearers and camera.

    Worlds differ by a shift; before a carried camera, by a turn about the vertical too, for its headings are found
    anew. On a floor, that is at the same height.
    """
    frames = overlap_middle(before, window)
    other, own = before.within(frames), window.within(frames)
    wearers = list(zip(other.wearers, own.wearers, strict=True))
    positions = [(one.motion.p_world_pelvis, two.motion.p_world_pelvis) for one, two in wearers]
    yaw, cameras = 0.0, [(one.path, two.path) for one, two in zip(other.cameras, own.cameras, strict=True)]
    if cameras:
        turns = [(one.motion.R_parent_child[:, 0], two.motion.R_parent_child[:, 0]) for one, two in wearers]
        turns += [(one.R_world_camera, two.R_world_camera) for one, two in cameras]
        yaw = robust_mean_angle(np.concatenate([yaw_of(there @ transpose(here)) for there, here in turns]))
        positions += [(one.p_world_camera, two.p_world_camera) for one, two in cameras]
    turn = rotation_z(yaw)
    shifts = np.concatenate([there - here @ turn.T for there, here in positions])
    shift = np.median(shifts, axis=0) if cameras else np.mean(shifts, axis=0)
    if has_floor:
        shift[2] = 0.0
    middle = (frames.stop - frames.start) // 2
    return replace(
        window,
        wearers=tuple(
            _turned(one, yaw, shift, _unsureness(first, second, middle, has_floor))
            for one, (first, second) in zip(window.wearers, wearers, strict=True)
        ),
        cameras=tuple(_turned_camera(camera, yaw, shift) for camera in window.cameras),
        headings=tuple(replace(one, path=one.path + yaw) for one in window.headings),
    )


@dataclass
class SceneSummary:
    """What windows find of a whole scene, as they go by.

    Attributes:
        source, plan: of the scene.
        known: findings that the calibrating frames tell.
        log: of the windows' findings beside them.
        headings: by window, of each wearer.
        clocks: by window, of each camera, seconds of its video in the window's middle, and how late it is there.
        labels: by chunk, whom each detection shows.
    """

    source: SceneSource
    plan: WindowPlan
    known: tuple[Finding, ...]
    log: FindingLog = field(default_factory=FindingLog)
    headings: list[tuple[Headings, ...]] = field(default_factory=list)
    clocks: list[list[tuple[float, float]]] = field(default_factory=list)
    labels: list[np.ndarray] = field(default_factory=list)

    @classmethod
    def of(cls, source: SceneSource, plan: WindowPlan, calibrated: Estimate) -> "SceneSummary":
        """Before the first window, given the estimate of the calibrating frames."""
        of_windows = ("heading drift", "video clock")  # no frames of them all tell these
        return cls(source, plan, tuple(one for one in calibrated.findings if one.kind not in of_windows))

    def add(self, window: SolvedWindow) -> None:
        """What one more window found."""
        start, end = self.plan.time(window.frames)[[0, -1]].tolist()
        self.log.add_window(window.findings, start, end, self.known)
        self.headings.append(window.headings)
        middles = [((start + end) / 2 - one.clock.offset) / (1 + one.clock.drift) for one in window.cameras]
        self.clocks.append([(at, one.clock.late(at)) for at, one in zip(middles, window.cameras, strict=True)])

    def completed(self, head: Estimate) -> Estimate:
        """The head of the estimate, after all windows."""
        wearers = tuple(
            replace(wearer, calibration=_calibration(wearer, headings))
            for wearer, headings in zip(head.wearers, zip(*self.headings, strict=True), strict=True)
        )
        plan, last = self.plan, float(self.plan.time(slice(self.plan.frames - 1, self.plan.frames))[0])
        unseen = (-np.inf, plan.start), (float(np.nextafter(last, np.inf)), np.inf)
        before, after = (np.full(self.source.detected(*interval), -1) for interval in unseen)
        clocks = list[Finding]()
        given = {camera.name: camera for camera in self.source.head.cameras}
        for one, found in zip(head.cameras, zip(*self.clocks, strict=True), strict=True):
            own = clock_findings(given[one.name], _with_clock(one, found), (plan.start, last))
            clocks += [replace(finding, camera=one.name if len(given) > 1 else "") for finding in own]
        self.log.close()
        drifts = [finding for one in wearers for finding in drift_findings(one.motion.name, one.calibration)]
        return replace(
            head,
            wearers=wearers,
            wearer_of_detection=np.concatenate([before, *self.labels, after]).astype(int),
            findings=(*self.known, *self.log.take(), *drifts, *clocks),
        )


def join(
    windows: Iterator[SolvedWindow], calibrated: Estimate, source: SceneSource, plan: WindowPlan,
    on_progress: ProgressCallback,
) -> EstimateChunks:  # fmt: skip
    """The estimate of windows in one world, in chunks.

    Args:
        windows: that overlap, in the order of time; solved as chunks are asked for.
        calibrated: the estimate of the calibrating frames.
        source, plan: of the scene.
        on_progress: called with the name of the stage and the fraction of it done.
    """
    none = [wearer.frames(slice(0, 0)) for wearer in calibrated.wearers]
    wearers = [replace(one, motion=replace(one.motion, rate=plan.rate, start=plan.start)) for one in none]
    frames, moving = (plan.frames,) * len(wearers), [camera.name for camera in source.head.cameras if camera.moving]
    head = replace(calibrated, name=source.head.name)
    head = replace(head, cameras=tuple(camera.start for camera in head.cameras), wearers=tuple(wearers))
    poses = tuple(plan.frames if camera.name in moving else 1 for camera in head.cameras)
    if plan.uses_all_frames or not source.head.cameras:
        return EstimateChunks(head, frames, chunks_of(windows, head, plan, on_progress), poses)
    summary = SceneSummary.of(source, plan, calibrated)
    head = replace(head, wearer_of_detection=np.zeros(0, int))
    chunks = chunks_of(windows, head, plan, on_progress, summary)
    return EstimateChunks(head, frames, chunks, poses, partial(summary.completed, head))


def chunks_of(
    windows: Iterable[SolvedWindow], head: Estimate, plan: WindowPlan, on_progress: ProgressCallback,
    summary: SceneSummary | None = None,
) -> Iterator[Estimate]:  # fmt: skip
    """The estimate chunk by chunk; two windows at a time are in memory.

    Args:
        windows, plan, on_progress: as of :func:`join`.
        head: the estimate without its frames.
        summary: told what windows find of the whole scene, if they do.
    """
    on_progress("windows", 0.0)
    count, before, done, begin = len(plan.windows()), None, 0, -np.inf
    for number, window in enumerate(windows):
        on_progress("windows", (number + 1) / count)
        window = window.numbered(number)
        if summary is not None:
            summary.add(window)
        if before is not None:
            meeting = overlap_middle(before, window)
            boundary = float(window.wearers[0].motion.time[meeting.start - window.frames.start])
            yield _chunk(before.within(slice(done, meeting.start)), begin, boundary, head, summary)
            yield _chunk(_between(before.within(meeting), window.within(meeting)), boundary, boundary, head, summary)
            done, begin = meeting.stop, boundary
        before = window
    assert before is not None
    yield _chunk(before.within(slice(done, before.frames.stop)), begin, np.inf, head, summary)


def _chunk(window: SolvedWindow, start: float, end: float, head: Estimate, summary: SceneSummary | None) -> Estimate:
    """Of all its frames; who is who in the video from one instant to another."""
    labels, wearers = window.wearer_of_detection[(window.detected_at >= start) & (window.detected_at < end)], []
    if summary is not None:
        summary.labels.append(labels)
    for whole, one in zip(head.wearers, window.wearers, strict=True):
        begin, rate = whole.motion.start + window.frames.start / whole.motion.rate, whole.motion.rate
        motion = replace(
            whole.motion, R_parent_child=one.motion.R_parent_child, p_world_pelvis=one.motion.p_world_pelvis
        )
        motion = replace(motion, start=begin, rate=rate)
        wearers.append(
            replace(whole, motion=motion, covariance=one.covariance, residuals=one.residuals, reports=one.reports)
        )
    return replace(
        head, cameras=window.cameras, wearers=tuple(wearers), wearer_of_detection=labels, reports=window.reports
    )


def _between(one: SolvedWindow, other: SolvedWindow) -> SolvedWindow:
    """The frames of an overlap, of which the first are nearly as in one window, and the last as in the other."""
    count = one.frames.stop - one.frames.start
    share = np.linspace(0, 1, count + 2)[1:-1]
    wearers = tuple(_estimate_between(*two, share) for two in zip(one.wearers, other.wearers, strict=True))
    cameras = tuple(_camera_between(*two, share) for two in zip(one.cameras, other.cameras, strict=True))
    return replace(one, wearers=wearers, cameras=cameras, reports=())


def _estimate_between(one: WearerEstimate, other: WearerEstimate, share: Array) -> WearerEstimate:
    first, second = one.motion, other.motion
    motion = replace(
        first,
        R_parent_child=_turns_between(first.R_parent_child, second.R_parent_child, share),
        p_world_pelvis=_values_between(first.p_world_pelvis, second.p_world_pelvis, share),
    )
    covariance = one.covariance
    if covariance is not None and other.covariance is not None:
        covariance = PoseCovariance(
            _values_between(covariance.joints, other.covariance.joints, share),
            _values_between(covariance.root, other.covariance.root, share),
        )
    nearer = (share < 0.5)[:, None]
    residuals = {kind: np.where(nearer, values, other.residuals[kind]) for kind, values in one.residuals.items()}
    return replace(one, motion=motion, covariance=covariance, residuals=residuals, reports=())


def _camera_between(one: CameraEstimate, other: CameraEstimate, share: Array) -> CameraEstimate:
    first, second, covariance, residual = one.path, other.path, one.covariance, one.residual_px
    if len(first) == len(share) == len(second):
        first = CameraPath(
            first.time,
            _turns_between(first.R_world_camera, second.R_world_camera, share),
            _values_between(first.p_world_camera, second.p_world_camera, share),
        )
        if covariance is not None and other.covariance is not None:
            covariance = _values_between(covariance, other.covariance, share)
    if residual is not None and other.residual_px is not None:
        residual = np.where((share < 0.5)[:, None], residual, other.residual_px)
    return replace(one, path=first, covariance=covariance, residual_px=residual)


def _turns_between(one: Array, other: Array, share: Array) -> Array:
    """Rotations ``(T, ..., 3, 3)``, each its share of the way from one to the other."""
    share = share.reshape(-1, *(1,) * (one.ndim - 2))
    return one @ exp(share * log(transpose(one) @ other))


def _values_between(one: Array, other: Array, share: Array) -> Array:
    return one + share.reshape(-1, *(1,) * (one.ndim - 1)) * (other - one)


def _turned_camera(camera: CameraEstimate, yaw: float, shift: Array) -> CameraEstimate:
    turn, path, calibration = rotation_z(yaw), camera.path, camera.calibration
    path = CameraPath(path.time, turn @ path.R_world_camera, path.p_world_camera @ turn.T + shift)
    if calibration is not None:
        calibration = replace(calibration, heading=calibration.heading + yaw)
    return replace(camera, path=path, calibration=calibration)


def _turned(estimate: WearerEstimate, yaw: float, shift: Array, unsure: Array) -> WearerEstimate:
    """A wearer in a world turned about the vertical, then shifted, and as unsure as that one is of where it is."""
    turn, motion, R = rotation_z(yaw), estimate.motion, estimate.motion.R_parent_child.copy()
    R[:, 0] = turn @ R[:, 0]
    moved = replace(motion, R_parent_child=R, p_world_pelvis=motion.p_world_pelvis @ turn.T + shift)
    calibration = {
        name: replace(one, heading=one.heading + yaw, heading_path=one.heading_path + yaw)
        for name, one in estimate.calibration.items()
    }
    covariance = estimate.covariance
    if covariance is not None:
        covariance = replace(covariance, root=turn @ covariance.root @ turn.T + unsure)
    return replace(estimate, motion=moved, calibration=calibration, covariance=covariance)


def _unsureness(before: WearerEstimate, own: WearerEstimate, middle: int, has_floor: bool) -> Array:
    """What the one before is less sure of a wearer's place, ``(3, 3)`` m²."""
    added = np.zeros((3, 3))
    if before.covariance is not None and own.covariance is not None:
        axes = slice(0, 2 if has_floor else 3)
        added[axes, axes] = (before.covariance.root - own.covariance.root)[middle, axes, axes]
    return added


def _with_clock(camera: CameraEstimate, clocks: Sequence[tuple[float, float]]) -> CameraEstimate:
    """The camera with a clock through what windows found of it."""
    least_clocks = 2  # windows through whose clocks there is a line
    if len(clocks) < least_clocks:
        return camera
    time, late = np.array(clocks).T
    drift, offset = np.polyfit(time, late, 1)
    return replace(camera, clock=VideoClock(float(offset), float(drift)))


def _calibration(wearer: WearerEstimate, headings: Sequence[Headings]) -> dict[str, SensorCalibration]:
    """Headings over all windows: each has its own until the next one begins."""
    kept = [own.time < after.time[0] for own, after in itertools.pairwise(headings)]
    kept.append(np.ones(len(headings[-1].time), bool))
    time = np.concatenate([own.time[which] for own, which in zip(headings, kept, strict=True)])
    paths = np.concatenate([own.path[which] for own, which in zip(headings, kept, strict=True)])
    calibration = {}
    for sensor, path in zip(wearer.sensors, paths.T, strict=True):
        heading = float(wrap_angle(path[0]))
        moves = {"heading_time": time, "heading_path": heading + path - path[0]} if len(time) > 1 else {}
        calibration[sensor] = replace(wearer.calibration[sensor], heading=heading, **moves)
    return calibration
