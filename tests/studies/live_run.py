"""A scene fed to the fixed-lag tracker sample by sample: its answers as motions, and their errors over time."""

import time as clock
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from tests.studies.scenes import with_nominal_pose
from vip_factors.body.kinematics import Motion, forward_kinematics
from vip_factors.body.skeleton import Skeleton
from vip_factors.errors import RecordingError
from vip_factors.evaluate.metrics import POSITION_JOINTS, indices, resample
from vip_factors.geometry.poses import align_rigid
from vip_factors.geometry.rotations import Array
from vip_factors.live.tracker import FixedLagTracker
from vip_factors.live_estimate import LiveEstimate, LivePose, motion_of
from vip_factors.sensors.live import live_samples, stream_head
from vip_factors.sensors.scene import Scene
from vip_factors.settings import CommonSettings, LiveSettings


@dataclass(frozen=True)
class LiveRun:
    """What the tracker said of a scene of one wearer.

    Attributes:
        newest, smoothed: with zero lag, and one lag later; where tracking was lost the pose before is kept.
        lost: frames between the first and the last without an answer.
        cpu_s: of this process.
        findings: each with the second of it.
    """

    newest: Motion
    smoothed: Motion
    lost: int
    cpu_s: float
    findings: tuple[str, ...]


def live_settings(settings: CommonSettings, **changes: object) -> LiveSettings:
    """Settings of the pipeline as those of a stream; ``changes`` are of what only a stream has."""
    own = {field_.name: getattr(settings, field_.name) for field_ in fields(CommonSettings)}
    live = settings if isinstance(settings, LiveSettings) else LiveSettings(**own)
    return replace(with_nominal_pose(live), **changes)  # type: ignore[arg-type]


def streamed(scene: Scene, settings: LiveSettings) -> list[LiveEstimate]:
    """What the tracker answers to a scene, as fast as it goes."""
    tracker = FixedLagTracker(stream_head(scene), settings)
    return [*(answer for sample in live_samples(scene) for answer in tracker.push(sample)), *tracker.finish()]


def smoothed_motion(answers: Sequence[LiveEstimate], wearer: int, scene: Scene, rate: float) -> Motion | None:
    """The smoothed poses, on the body that was believed at the end."""
    poses = [pose for answer in answers if (pose := answer.wearers[wearer].smoothed) is not None]
    if not poses:
        return None
    subject = scene.wearers[wearer].subject
    return filled_motion(poses, answers[-1].wearers[wearer].skeleton or subject.body(), rate, subject.name)


def run_live(scene: Scene, settings: LiveSettings) -> LiveRun:
    """Feed a scene of one wearer to the tracker as fast as it takes it."""
    begin = clock.process_time()
    answers = streamed(scene, settings)
    smoothed = smoothed_motion(answers, 0, scene, settings.frame_rate)
    if smoothed is None:
        raise RecordingError(f"scene '{scene.name}': the tracker gave no answer: is it shorter than its start?")
    poses = [answer.wearers[0].newest for answer in answers]
    newest = filled_motion(poses, smoothed.skeleton, settings.frame_rate, smoothed.name)
    findings = tuple(f"{answer.time:.1f} s: {finding}" for answer in answers for finding in answer.findings)
    return LiveRun(newest, smoothed, len(newest) - len(poses), clock.process_time() - begin, findings)


def filled_motion(poses: Sequence[LivePose], body: Skeleton, rate: float, name: str) -> Motion:
    """Poses in order as frames at a rate; a pose is kept until the next one, as a viewer would see it."""
    start = poses[0].time
    frames = np.round((np.array([pose.time for pose in poses]) - start) * rate).astype(int)
    at = np.searchsorted(frames, np.arange(frames[-1] + 1), side="right") - 1
    return motion_of([poses[index] for index in at], body, rate, name)


def error_over_time(poses: Sequence[LivePose], body: Skeleton, truth: Motion, rate: float) -> Array:
    """MPJPE ``(T,)`` in mm at ``k / rate`` seconds, each frame aligned rigidly; NaN where there is no pose."""
    frames = int(np.floor((len(truth) - 1) / truth.rate * rate + 1e-6)) + 1
    error: Array = np.full(frames, np.nan)
    # Halfway between two frames it is always the later one, so that each pose has a frame of its own.
    nearest = np.floor(np.array([pose.time for pose in poses]) * rate + 0.5 + 1e-6).astype(int)
    chosen = [(row, one) for row, one in zip(nearest, poses, strict=True) if 0 <= row < frames]
    if not chosen:
        return error
    offset = max(0.0, chosen[0][1].time - chosen[0][0] / rate)  # frames lie where the stream put them
    true = resample(truth, offset, rate, frames - (offset > 0)).state.p_world_joint
    chosen = [(row, one) for row, one in chosen if row < len(true)]
    R, p = (np.stack([getattr(one, name) for _, one in chosen]) for name in ("R_parent_child", "p_world_pelvis"))
    rows, joints = [row for row, _ in chosen], indices(POSITION_JOINTS)
    ours, theirs = forward_kinematics(body, R, p).p_world_joint[:, joints], true[rows][:, joints]
    error[rows] = 1e3 * np.linalg.norm(align_rigid(ours, theirs).apply(ours) - theirs, axis=-1).mean(axis=1)
    return error
