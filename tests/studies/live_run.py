"""A scene fed to the fixed-lag tracker sample by sample, and its answers as motions."""

import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from tests.studies.declared_pose import with_nominal_pose
from vip_factors.body.motion import Motion
from vip_factors.body.skeleton import Skeleton
from vip_factors.errors import RecordingError
from vip_factors.live.settings import LiveSettings
from vip_factors.live.tracker import FixedLagTracker
from vip_factors.live_estimate import LiveEstimate, LivePose
from vip_factors.sensors.calibration import Calibration
from vip_factors.sensors.live import LiveSetup, live_samples
from vip_factors.sensors.scene import Scene
from vip_factors.settings import Settings


@dataclass(frozen=True)
class LiveRun:
    """What the tracker said of a scene of one wearer.

    Attributes:
        newest, smoothed: with zero lag, and one lag later; where tracking was lost the pose before is kept.
        newest_poses, smoothed_poses: as answered, with covariances; none where tracking was lost.
        start: seconds of the frame that the first answer in time was given to: those before it came late.
        calibration: at the end.
        lost: frames between the first and the last without an answer.
        cpu_seconds: by answer, of this process; the first is the start's.
        findings: with the second of each.
    """

    newest: Motion
    smoothed: Motion
    newest_poses: tuple[LivePose, ...]
    smoothed_poses: tuple[LivePose, ...]
    start: float
    calibration: Calibration
    lost: int
    cpu_seconds: tuple[float, ...]
    findings: tuple[tuple[float, str], ...]

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
    """Feed a scene of one wearer to the tracker as fast as it takes it.

    Raises:
        RecordingError: if there was no answer, or none that was smoothed.
    """
    tracker = FixedLagTracker(LiveSetup.of(scene), settings)
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
    name, rate = wearer.subject.name, settings.frame_rate
    motion = filled_motion(newest, body, rate, name)
    return LiveRun(
        motion,
        filled_motion(smoothed, body, rate, name),
        tuple(newest),
        tuple(smoothed),
        newest[min(at_once, len(newest)) - 1].time,
        answers[-1].wearers[0].calibration,
        len(motion) - len(newest),
        tuple(seconds),
        tuple((one.time, finding) for one in answers for finding in one.findings),
    )


def filled_motion(poses: Sequence[LivePose], body: Skeleton, rate: float, name: str) -> Motion:
    """Poses in order as frames at a rate; a pose is kept until the next one, as a viewer would see it."""
    start = poses[0].time
    frames = np.round((np.array([pose.time for pose in poses]) - start) * rate).astype(int)
    at = np.searchsorted(frames, np.arange(frames[-1] + 1), side="right") - 1
    R = np.stack([pose.R_parent_child for pose in poses])[at]
    p = np.stack([pose.p_world_pelvis for pose in poses])[at]
    return Motion(body, R, p, rate, start, name)
