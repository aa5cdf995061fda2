"""Errors of a stream's answers: in all, and by how long it has been tracking, beside the error that it expects."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from vip_factors.body.motion import Motion
from vip_factors.errors import InputError
from vip_factors.evaluate.frames import common_frames
from vip_factors.evaluate.joints import ORIENTATION_JOINTS, indices
from vip_factors.evaluate.metrics import CM, local_orientation_error, mpjae, mpjpe
from vip_factors.evaluate.trajectory import jitter
from vip_factors.live_estimate import LivePose
from vip_factors.sensors.gauge import move_motion, scene_gauge

SINCE_S = (0.0, 1.0, 3.0, 6.0, np.inf)  # edges of the times since the start that are told apart


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


def pose_errors(motion: Motion, truth: Motion, after_s: float) -> PoseErrors:
    """Errors from ``after_s`` seconds of the stream on.

    Raises:
        InputError: if nothing is left to compare.
    """
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


def since_start(
    poses: Sequence[LivePose], start: float, truth: Motion, edges: Sequence[float] = SINCE_S
) -> tuple[SinceStart, ...]:
    """Errors and expectations by time since ``start``; spans without a frame are left out.

    Args:
        poses: as answered, in order.
        start: seconds, of the first answer that came in time.
        truth: at the same clock.
        edges: of the spans, seconds.
    """
    time = np.array([pose.time for pose in poses])
    inside = (time >= truth.time[0] - 1e-6) & (time <= truth.time[-1] + 1e-6)
    joints, spans = indices(ORIENTATION_JOINTS), []
    for since, until in pairwise(edges):
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
        rms = float(np.sqrt(np.mean(error**2)))
        spans.append(
            SinceStart(
                since, until, len(chosen), mpjpe(estimate, reference), float(np.rad2deg(rms)), float(np.rad2deg(sigma))
            )
        )
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
