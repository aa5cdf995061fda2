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
    """Headings of a wearer's sensors over time.

    Attributes:
        time: ``(K,)`` seconds; linear in between, and beyond them as at the nearest.
        path: ``(K, S)`` radians, not wrapped.
    """

    time: Array
    path: Array

    @classmethod
    def of(cls, wearer: InertialSolution) -> "Headings":
        """Return the headings of a solution; constant ones stand at the middle of its frames."""
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
        detection_times: ``(N,)`` seconds, of each camera's detections.
        is_placed: whether a camera at a known place saw a wearer: the world is that camera's.
        reports: of the solves over all wearers.
        findings: on it.
    """

    frames: slice
    wearers: tuple[WearerEstimate, ...]
    cameras: tuple[CameraEstimate, ...] = ()
    headings: tuple[Headings, ...] = ()
    detection_times: tuple[Array, ...] = ()
    is_placed: bool = False
    reports: tuple[SolveReport, ...] = ()
    findings: tuple[Finding, ...] = ()

    def within(self, frames: slice) -> "SolvedWindow":
        """Some of the window's frames; who is who is still of all."""
        rows = slice(frames.start - self.frames.start, frames.stop - self.frames.start)
        cameras = tuple(camera.frames(rows) for camera in self.cameras)
        return replace(
            self, frames=frames, wearers=tuple(wearer.frames(rows) for wearer in self.wearers), cameras=cameras
        )

    def numbered(self, number: int) -> "SolvedWindow":
        """Return the window with solve reports that name its number, counted from 0."""

        def with_number(reports: tuple[SolveReport, ...]) -> tuple[SolveReport, ...]:
            return tuple(
                replace(solve_report, stage=f"{solve_report.stage}, window {number + 1}") for solve_report in reports
            )

        wearers = tuple(replace(wearer, reports=with_number(wearer.reports)) for wearer in self.wearers)
        return replace(self, wearers=wearers, reports=with_number(self.reports))


def overlap_middle(previous: SolvedWindow, window: SolvedWindow) -> slice:
    """The frames in which one passes over into the next."""
    # Of an overlap, at either end, where a window still misses what lies beyond; in between they meet
    end_effect = 0.4
    start, stop = window.frames.start, previous.frames.stop
    settled = int((stop - start) * end_effect)
    return slice(start + settled, stop - settled)


def moved(window: SolvedWindow, previous: SolvedWindow, has_floor: bool) -> SolvedWindow:
    """A window whose world is its own in the world of the one before, by where both have wearers and camera.

    Worlds differ by a shift; before a carried camera, by a turn about the vertical too, for its headings are found
    anew. On a floor, that is at the same height.
    """
    frames = overlap_middle(previous, window)
    target_part, source_part = previous.within(frames), window.within(frames)
    wearers = list(zip(target_part.wearers, source_part.wearers, strict=True))
    positions = [(target.motion.p_world_pelvis, source.motion.p_world_pelvis) for target, source in wearers]
    paired = zip(target_part.cameras, source_part.cameras, strict=True)
    yaw, cameras = 0.0, [(target.path, source.path) for target, source in paired]
    if cameras:
        turns = [(target.motion.R_parent_child[:, 0], source.motion.R_parent_child[:, 0]) for target, source in wearers]
        turns += [(target.R_world_camera, source.R_world_camera) for target, source in cameras]
        yaw = robust_mean_angle(
            np.concatenate([yaw_of(R_target @ transpose(R_source)) for R_target, R_source in turns])
        )
        positions += [(target.p_world_camera, source.p_world_camera) for target, source in cameras]
    turn = rotation_z(yaw)
    shifts = np.concatenate([p_target - p_source @ turn.T for p_target, p_source in positions])
    shift = np.median(shifts, axis=0) if cameras else np.mean(shifts, axis=0)
    if has_floor:
        shift[2] = 0.0
    middle = (frames.stop - frames.start) // 2
    return replace(
        window,
        wearers=tuple(
            _turned(wearer, yaw, shift, _unsureness(target, source, middle, has_floor))
            for wearer, (target, source) in zip(window.wearers, wearers, strict=True)
        ),
        cameras=tuple(_turned_camera(camera, yaw, shift) for camera in window.cameras),
        headings=tuple(replace(headings, path=headings.path + yaw) for headings in window.headings),
    )


@dataclass
class SceneSummary:
    """Results of windows that concern the whole scene, collected window by window.

    Attributes:
        source, plan: of the scene.
        calibration_findings: findings about the calibrating frames.
        log: of the windows' findings beside them.
        headings: by window, of each wearer.
        clocks: by window, of each camera, seconds of its video in the window's middle, and how late it is there.
        labels: by chunk, of each camera, whom each detection shows.
    """

    source: SceneSource
    plan: WindowPlan
    calibration_findings: tuple[Finding, ...]
    log: FindingLog = field(default_factory=FindingLog)
    headings: list[tuple[Headings, ...]] = field(default_factory=list)
    clocks: list[list[tuple[float, float]]] = field(default_factory=list)
    labels: list[tuple[np.ndarray, ...]] = field(default_factory=list)

    @classmethod
    def of(cls, source: SceneSource, plan: WindowPlan, calibrated: Estimate) -> "SceneSummary":
        """Before the first window, given the estimate of the calibrating frames."""
        of_windows = ("heading drift", "video clock")  # no frames of them all tell these
        return cls(source, plan, tuple(finding for finding in calibrated.findings if finding.kind not in of_windows))

    def add(self, window: SolvedWindow) -> None:
        """Add the results of a window."""
        start, end = self.plan.time(window.frames)[[0, -1]].tolist()
        self.log.add_window(window.findings, start, end, self.calibration_findings)
        self.headings.append(window.headings)
        middles = [((start + end) / 2 - camera.clock.offset) / (1 + camera.clock.drift) for camera in window.cameras]
        self.clocks.append(
            [(time, camera.clock.late(time)) for time, camera in zip(middles, window.cameras, strict=True)]
        )

    def completed(self, head: Estimate) -> Estimate:
        """The head of the estimate, after all windows."""
        wearers = tuple(
            replace(wearer, calibration=_calibration(wearer, headings))
            for wearer, headings in zip(head.wearers, zip(*self.headings, strict=True), strict=True)
        )
        plan, last_time = self.plan, float(self.plan.time(slice(self.plan.frames - 1, self.plan.frames))[0])
        unseen = (-np.inf, plan.start), (float(np.nextafter(last_time, np.inf)), np.inf)
        clocks, cameras = list[Finding](), list[CameraEstimate]()
        camera_of_name = {camera.name: camera for camera in self.source.head.cameras}
        for camera, labels in zip(head.cameras, zip(*self.labels, strict=True), strict=True):
            before, after = (np.full(self.source.detected(*interval, camera.name), -1) for interval in unseen)
            cameras.append(replace(camera, wearer_of_detection=np.concatenate([before, *labels, after]).astype(int)))
        for camera, clock_samples in zip(head.cameras, zip(*self.clocks, strict=True), strict=True):
            camera_findings = clock_findings(
                camera_of_name[camera.name], _with_clock(camera, clock_samples), (plan.start, last_time)
            )
            clocks += [
                replace(finding, camera=camera.name if len(camera_of_name) > 1 else "") for finding in camera_findings
            ]
        self.log.close()
        drifts = [finding for wearer in wearers for finding in drift_findings(wearer.motion.name, wearer.calibration)]
        return replace(
            head,
            wearers=wearers,
            cameras=tuple(cameras),
            findings=(*self.calibration_findings, *self.log.take(), *drifts, *clocks),
        )


def join(
    windows: Iterator[SolvedWindow],
    calibrated: Estimate,
    source: SceneSource,
    plan: WindowPlan,
    on_progress: ProgressCallback,
) -> EstimateChunks:
    """The estimate of windows in one world, in chunks.

    Args:
        windows: that overlap, in the order of time; solved as chunks are asked for.
        calibrated: the estimate of the calibrating frames.
        source, plan: of the scene.
        on_progress: called with the name of the stage and the fraction of it done.
    """
    none = [wearer.frames(slice(0, 0)) for wearer in calibrated.wearers]
    wearers = [replace(wearer, motion=replace(wearer.motion, rate=plan.rate, start=plan.start)) for wearer in none]
    frames, moving = (plan.frames,) * len(wearers), [camera.name for camera in source.head.cameras if camera.moving]
    head = replace(calibrated, name=source.head.name)
    head = replace(head, cameras=tuple(camera.start for camera in head.cameras), wearers=tuple(wearers))
    poses = tuple(plan.frames if camera.name in moving else 1 for camera in head.cameras)
    if plan.uses_all_frames or not source.head.cameras:
        return EstimateChunks(head, frames, chunks_of(windows, head, plan, on_progress), poses)
    summary = SceneSummary.of(source, plan, calibrated)
    unlabelled = (replace(camera, wearer_of_detection=np.zeros(0, int)) for camera in head.cameras)
    head = replace(head, cameras=tuple(unlabelled))
    chunks = chunks_of(windows, head, plan, on_progress, summary)
    return EstimateChunks(head, frames, chunks, poses, partial(summary.completed, head))


def chunks_of(
    windows: Iterable[SolvedWindow],
    head: Estimate,
    plan: WindowPlan,
    on_progress: ProgressCallback,
    summary: SceneSummary | None = None,
) -> Iterator[Estimate]:
    """The estimate chunk by chunk; two windows at a time are in memory.

    Args:
        windows, plan, on_progress: as of :func:`join`.
        head: the estimate without its frames.
        summary: collects the results of windows that concern the whole scene.
    """
    on_progress("windows", 0.0)
    count, previous, done, begin = len(plan.windows()), None, 0, -np.inf
    for number, window in enumerate(windows):
        on_progress("windows", (number + 1) / count)
        window = window.numbered(number)
        if summary is not None:
            summary.add(window)
        if previous is not None:
            meeting = overlap_middle(previous, window)
            boundary = float(window.wearers[0].motion.time[meeting.start - window.frames.start])
            yield _chunk(previous.within(slice(done, meeting.start)), begin, boundary, head, summary)
            yield _chunk(_between(previous.within(meeting), window.within(meeting)), boundary, boundary, head, summary)
            done, begin = meeting.stop, boundary
        previous = window
    assert previous is not None
    yield _chunk(previous.within(slice(done, previous.frames.stop)), begin, np.inf, head, summary)


def _chunk(window: SolvedWindow, start: float, end: float, head: Estimate, summary: SceneSummary | None) -> Estimate:
    """Return a chunk with its own frames and the labels of the detections between two instants."""
    wearers, cameras = [], list[CameraEstimate]()
    for camera, times in zip(window.cameras, window.detection_times, strict=True):
        labels = camera.wearer_of_detection[(times >= start) & (times < end)]
        cameras.append(replace(camera, wearer_of_detection=labels))
    if summary is not None:
        summary.labels.append(tuple(camera.wearer_of_detection for camera in cameras))
    for wearer_head, wearer in zip(head.wearers, window.wearers, strict=True):
        begin, rate = wearer_head.motion.start + window.frames.start / wearer_head.motion.rate, wearer_head.motion.rate
        motion = replace(
            wearer_head.motion, R_parent_child=wearer.motion.R_parent_child, p_world_pelvis=wearer.motion.p_world_pelvis
        )
        motion = replace(motion, start=begin, rate=rate)
        wearers.append(
            replace(
                wearer_head,
                motion=motion,
                covariance=wearer.covariance,
                residuals=wearer.residuals,
                reports=wearer.reports,
            )
        )
    return replace(head, cameras=tuple(cameras), wearers=tuple(wearers), reports=window.reports)


def _between(previous: SolvedWindow, window: SolvedWindow) -> SolvedWindow:
    """The frames of an overlap, of which the first are nearly as in one window, and the last as in the other."""
    count = previous.frames.stop - previous.frames.start
    share = np.linspace(0, 1, count + 2)[1:-1]
    wearers = tuple(_estimate_between(*pair, share) for pair in zip(previous.wearers, window.wearers, strict=True))
    cameras = tuple(_camera_between(*pair, share) for pair in zip(previous.cameras, window.cameras, strict=True))
    return replace(previous, wearers=wearers, cameras=cameras, reports=())


def _estimate_between(previous: WearerEstimate, wearer: WearerEstimate, share: Array) -> WearerEstimate:
    motion, next_motion = previous.motion, wearer.motion
    motion = replace(
        motion,
        R_parent_child=_turns_between(motion.R_parent_child, next_motion.R_parent_child, share),
        p_world_pelvis=_values_between(motion.p_world_pelvis, next_motion.p_world_pelvis, share),
    )
    covariance = previous.covariance
    if covariance is not None and wearer.covariance is not None:
        covariance = PoseCovariance(
            _values_between(covariance.joints, wearer.covariance.joints, share),
            _values_between(covariance.root, wearer.covariance.root, share),
        )
    nearer = (share < 0.5)[:, None]
    residuals = {kind: np.where(nearer, values, wearer.residuals[kind]) for kind, values in previous.residuals.items()}
    return replace(previous, motion=motion, covariance=covariance, residuals=residuals, reports=())


def _camera_between(previous: CameraEstimate, camera: CameraEstimate, share: Array) -> CameraEstimate:
    path, second_path, covariance, residual = previous.path, camera.path, previous.covariance, previous.residual_px
    if len(path) == len(share) == len(second_path):
        path = CameraPath(
            path.time,
            _turns_between(path.R_world_camera, second_path.R_world_camera, share),
            _values_between(path.p_world_camera, second_path.p_world_camera, share),
        )
        if covariance is not None and camera.covariance is not None:
            covariance = _values_between(covariance, camera.covariance, share)
    if residual is not None and camera.residual_px is not None:
        residual = np.where((share < 0.5)[:, None], residual, camera.residual_px)
    return replace(previous, path=path, covariance=covariance, residual_px=residual)


def _turns_between(R_earlier: Array, R_later: Array, share: Array) -> Array:
    """Rotations ``(T, ..., 3, 3)``, each its share of the way from one to the other."""
    share = share.reshape(-1, *(1,) * (R_earlier.ndim - 2))
    return R_earlier @ exp(share * log(transpose(R_earlier) @ R_later))


def _values_between(start_values: Array, end_values: Array, share: Array) -> Array:
    return start_values + share.reshape(-1, *(1,) * (start_values.ndim - 1)) * (end_values - start_values)


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
        name: replace(sensor, heading=sensor.heading + yaw, heading_path=sensor.heading_path + yaw)
        for name, sensor in estimate.calibration.items()
    }
    covariance = estimate.covariance
    if covariance is not None:
        covariance = replace(covariance, root=turn @ covariance.root @ turn.T + unsure)
    return replace(estimate, motion=moved, calibration=calibration, covariance=covariance)


def _unsureness(previous: WearerEstimate, wearer: WearerEstimate, middle: int, has_floor: bool) -> Array:
    """Additional covariance ``(3, 3)`` of a wearer's position in the previous window, m²."""
    added = np.zeros((3, 3))
    if previous.covariance is not None and wearer.covariance is not None:
        axes = slice(0, 2 if has_floor else 3)
        added[axes, axes] = (previous.covariance.root - wearer.covariance.root)[middle, axes, axes]
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
    is_kept = [
        headings_of_window.time < following.time[0] for headings_of_window, following in itertools.pairwise(headings)
    ]
    is_kept.append(np.ones(len(headings[-1].time), bool))
    time = np.concatenate(
        [headings_of_window.time[which] for headings_of_window, which in zip(headings, is_kept, strict=True)]
    )
    paths = np.concatenate(
        [headings_of_window.path[which] for headings_of_window, which in zip(headings, is_kept, strict=True)]
    )
    calibration = {}
    for sensor, path in zip(wearer.sensors, paths.T, strict=True):
        heading = float(wrap_angle(path[0]))
        moves = {"heading_time": time, "heading_path": heading + path - path[0]} if len(time) > 1 else {}
        calibration[sensor] = replace(wearer.calibration[sensor], heading=heading, **moves)
    return calibration
