"""A scene fed to the fixed-lag tracker sample by sample: its answers as motions, and their errors."""

import time as clock
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise

import numpy as np

from tests.studies.scenes import with_nominal_pose
from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import Skeleton
from vip_factors.errors import InputError, RecordingError
from vip_factors.evaluate.metrics import (
    CM,
    ORIENTATION_JOINTS,
    common_frames,
    indices,
    jitter,
    local_orientation_error,
    mpjae,
    mpjpe,
)
from vip_factors.live.settings import LiveSettings
from vip_factors.live.tracker import FixedLagTracker
from vip_factors.live_estimate import LiveEstimate, LivePose
from vip_factors.sensors.calibration import Calibration
from vip_factors.sensors.camera_path import move_motion, scene_gauge
from vip_factors.sensors.live import LiveSample, live_samples, stream_head
from vip_factors.sensors.scene import Scene
from vip_factors.settings import Settings

SINCE_S = (0.0, 1.0, 3.0, 6.0, 1e9)  # edges of the times since the start that are told apart


def timed_answers(
    samples: Iterable[LiveSample], tracker: FixedLagTracker
) -> Iterator[tuple[float, list[LiveEstimate], float, float]]:
    """Of every sample with answers: its time, these, and wall and CPU seconds of all samples since the last ones."""
    wall, cpu = 0.0, 0.0
    for sample in samples:
        before = clock.perf_counter(), clock.thread_time()
        answers = tracker.push(sample)
        wall, cpu = wall + clock.perf_counter() - before[0], cpu + clock.thread_time() - before[1]
        if answers:
            yield sample.time, answers, wall, cpu
            wall, cpu = 0.0, 0.0


@dataclass(frozen=True)
class LiveRun:
    """What the tracker said of a scene of one wearer.

    Attributes:
        newest, smoothed: with zero lag, and one lag later; where tracking was lost the pose before is kept.
        newest_poses: as answered, with covariances; none where tracking was lost.
        start: seconds of the frame that the first answer in time was given to: those before it came late.
        calibration: at the end.
        lost: frames between the first and the last without an answer.
        cpu_seconds: by answer, of this process; the first is the start's.
        findings: each with the second of it.
    """

    newest: Motion
    smoothed: Motion
    newest_poses: tuple[LivePose, ...]
    start: float
    calibration: Calibration
    lost: int
    cpu_seconds: tuple[float, ...]
    findings: tuple[str, ...]

    @property
    def cpu_ms(self) -> tuple[float, float]:
        """Median and 95th percentile of an answer's milliseconds, the start's left out; NaN without any."""
        later = 1e3 * np.array(self.cpu_seconds[1:])
        return (float(np.median(later)), float(np.quantile(later, 0.95))) if len(later) else (np.nan, np.nan)


def live_settings(settings: Settings, **changes: object) -> LiveSettings:
    """Settings of the pipeline as those of a stream; ``changes`` are of what only a stream has."""
    own = {one.name: getattr(settings, one.name) for one in fields(Settings)}
    live = settings if isinstance(settings, LiveSettings) else LiveSettings(**own)
    return replace(with_nominal_pose(live), **changes)  # type: ignore[arg-type]


def run_live(scene: Scene, settings: LiveSettings, tell: Callable[[float], None] = lambda fraction: None) -> LiveRun:
    """Feed a scene of one wearer to the tracker as fast as it takes it."""
    tracker = FixedLagTracker(stream_head(scene), settings)
    wearer, end = scene.wearers[0], scene.wearers[0].interval[1]
    answers: list[LiveEstimate] = []
    seconds: list[float] = []
    at_once = 0  # answers of the start; all but the last of them came late
    begin = clock.process_time()
    for sample in live_samples(scene):
        new = tracker.push(sample)
        if not new:
            continue
        at_once = at_once or len(new)
        seconds.append(clock.process_time() - begin)
        answers += new
        tell(min(1.0, sample.time / end))
        begin = clock.process_time()
    answers += tracker.finish()
    newest = [one.wearers[0].newest for one in answers]
    smoothed = [pose for one in answers if (pose := one.wearers[0].smoothed) is not None]
    if not answers or not smoothed:
        raise RecordingError(
            f"scene '{scene.name}': the tracker gave no answer in {end:.1f} s: is it shorter than its start?"
        )
    body = answers[-1].wearers[0].skeleton or wearer.subject.body()
    motion, late = (filled_motion(one, body, settings.frame_rate, wearer.subject.name) for one in (newest, smoothed))
    return LiveRun(
        motion, late, tuple(newest), newest[min(at_once, len(newest)) - 1].time, answers[-1].wearers[0].calibration,
        len(motion) - len(newest), tuple(seconds),
        tuple(f"{one.time:.1f} s: {finding}" for one in answers for finding in one.findings),
    )  # fmt: skip


def filled_motion(poses: Sequence[LivePose], body: Skeleton, rate: float, name: str) -> Motion:
    """Poses in order as frames at a rate; a pose is kept until the next one, as a viewer would see it."""
    start = poses[0].time
    frames = np.round((np.array([pose.time for pose in poses]) - start) * rate).astype(int)
    at = np.searchsorted(frames, np.arange(frames[-1] + 1), side="right") - 1
    R = np.stack([pose.R_parent_child for pose in poses])[at]
    p = np.stack([pose.p_world_pelvis for pose in poses])[at]
    return Motion(body, R, p, rate, start, name)


@dataclass(frozen=True)
class PoseErrors:
    """Means over frames.

    Attributes:
        mpjpe_mm, mpjae_deg: every frame aligned.
        root_cm: of the root's place, after one yaw and one translation of the whole motion.
        jitter: m/s³.
        frames: compared.
    """

    mpjpe_mm: float
    mpjae_deg: float
    root_cm: float
    jitter: float
    frames: int


def pose_errors(motion: Motion, truth: Motion, after_s: float) -> PoseErrors:
    """Errors from ``after_s`` seconds of the stream on."""
    late = int(np.count_nonzero(motion.time < after_s - 1e-6))
    if late >= len(motion):
        raise InputError(
            f"estimate of '{motion.name}' ends at {motion.time[-1]:.2f} s: expected more than {after_s:g} s"
        )
    estimate, reference, _ = common_frames(motion.frames(slice(late, None)), truth)
    moved = move_motion(estimate, scene_gauge([(estimate, reference)]))
    root = np.linalg.norm(moved.p_world_pelvis - reference.p_world_pelvis, axis=1).mean()
    return PoseErrors(
        mpjpe(estimate, reference), mpjae(estimate, reference), float(CM * root), jitter(estimate), len(estimate)
    )


@dataclass(frozen=True)
class SinceStart:
    """The newest poses of a span of time since tracking began.

    Attributes:
        since_s, until_s: of the span.
        frames: in it.
        mpjpe_mm: every frame aligned.
        error_deg, sigma_deg: of one joint (of the nine that MPJAE takes, each in its parent), root mean square over
            joints and frames, and what the covariances say of it. With honest covariances they are the same.
    """

    since_s: float
    until_s: float
    frames: int
    mpjpe_mm: float
    error_deg: float
    sigma_deg: float


def since_start(poses: Sequence[LivePose], start: float, truth: Motion) -> tuple[SinceStart, ...]:
    """Errors and expectations of poses by time since ``start`` (s); spans without a frame are left out."""
    time = np.array([pose.time for pose in poses])
    inside = (time >= truth.time[0] - 1e-6) & (time <= truth.time[-1] + 1e-6)
    joints, spans = indices(ORIENTATION_JOINTS), []
    for since, until in pairwise(SINCE_S):
        within = inside & (time - start >= since - 1e-6) & (time - start < until - 1e-6)
        chosen = [pose for pose, use in zip(poses, within, strict=True) if use]
        if not chosen:
            continue
        estimate, reference = _pair(chosen, truth)
        error = local_orientation_error(estimate, reference)[:, joints]
        variances = [
            np.trace(covariance[joints], axis1=1, axis2=2)
            for pose in chosen
            if (covariance := pose.joint_covariance) is not None
        ]
        sigma = float(np.sqrt(np.mean(variances))) if variances else float("nan")
        degrees = (float(np.rad2deg(one)) for one in (np.sqrt(np.mean(error**2)), sigma))
        spans.append(SinceStart(since, until, len(chosen), mpjpe(estimate, reference), *degrees))
    return tuple(spans)


def _pair(poses: Sequence[LivePose], truth: Motion) -> tuple[Motion, Motion]:
    """The poses, and the truth's frames next to them in time, as if they followed one another."""
    time = np.array([pose.time for pose in poses])
    nearest = np.clip(np.rint((time - truth.start) * truth.rate).astype(int), 0, len(truth) - 1)
    R = np.stack([pose.R_parent_child for pose in poses])
    p = np.stack([pose.p_world_pelvis for pose in poses])
    reference = Motion(
        truth.skeleton, truth.R_parent_child[nearest], truth.p_world_pelvis[nearest], truth.rate, 0.0, truth.name
    )
    return Motion(truth.skeleton, R, p, truth.rate, 0.0, truth.name), reference
