"""The error of a stream's answers over time, and when it is good again."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vip_factors.body.kinematics import forward_kinematics
from vip_factors.body.motion import Motion
from vip_factors.body.skeleton import Skeleton
from vip_factors.evaluate.frames import resample
from vip_factors.evaluate.joints import POSITION_JOINTS, indices
from vip_factors.geometry.alignment import align_rigid, align_yaw
from vip_factors.geometry.rotations import Array
from vip_factors.live_estimate import LivePose

GOOD = 1.2  # times the error of the undisturbed stream
SUSTAINED_S = 1.0
GAUGE_S = 2.0  # before the fault, from which place and heading of the estimate's world are taken


@dataclass(frozen=True)
class ErrorOverTime:
    """Errors on the truth's own frames; NaN where there was no answer.

    Attributes:
        rate: frames per second.
        mpjpe_mm: ``(T,)``, 14 joints after a rigid alignment of each frame.
        place_cm: ``(T,)`` of the pelvis, in the world that the seconds before the fault agree on.
    """

    rate: float
    mpjpe_mm: Array
    place_cm: Array

    def mean(self, start: float, end: float) -> float:
        """MPJPE from ``start`` to ``end`` (s); NaN without an answer in that time."""
        return _mean(self.mpjpe_mm[self._rows(start, end)])

    def place(self, start: float, end: float) -> float:
        """Error of the place, cm, likewise."""
        return _mean(self.place_cm[self._rows(start, end)])

    def missing(self, start: float, end: float) -> int:
        """Frames without an answer."""
        return int(np.isnan(self.mpjpe_mm[self._rows(start, end)]).sum())

    def _rows(self, start: float, end: float) -> slice:
        return slice(max(0, round(start * self.rate)), max(0, round(min(end, 1e6) * self.rate)))


def error_over_time(poses: Sequence[LivePose], skeleton: Skeleton, truth: Motion, rate: float, until: float) -> Array:
    """Rows ``(T, 2)`` of MPJPE in mm and place in cm at ``k / rate``; ``until``: when the fault begins (s)."""
    frames = int(np.floor((len(truth) - 1) / truth.rate * rate + 1e-6)) + 1
    found: Array = np.full((frames, 2), np.nan)
    poses = [one for one in poses if 0 <= _row(one.time, rate) < frames]
    if not poses:
        return found
    row = np.array([_row(one.time, rate) for one in poses])
    body = forward_kinematics(
        skeleton, np.stack([one.R_parent_child for one in poses]), np.stack([one.p_world_pelvis for one in poses])
    )
    offset = poses[0].time - row[0] / rate  # frames lie where the stream put them
    true = resample(truth, max(0.0, offset), rate, frames - 1 if offset > 0 else frames).state.p_world_joint
    kept = row < len(true)
    ours, row = body.p_world_joint[kept], row[kept]
    true = true[row]
    joints = indices(POSITION_JOINTS)
    aligned = align_rigid(ours[:, joints], true[:, joints]).apply(ours)
    found[row, 0] = 1e3 * np.linalg.norm(aligned - true, axis=-1)[:, joints].mean(axis=1)
    before = (row >= (until - GAUGE_S) * rate) & (row < until * rate)
    if before.any():
        gauge = align_yaw(ours[before].reshape(-1, 3), true[before].reshape(-1, 3))
        moved = gauge.apply(ours.reshape(-1, 3)).reshape(ours.shape)
        found[row, 1] = 1e2 * np.linalg.norm(moved[:, 0] - true[:, 0], axis=1)
    return found


def _row(time: float, rate: float) -> int:
    """Number of the nearest frame; halfway between two always the later one, so that each has one row."""
    return int(np.floor(time * rate + 0.5 + 1e-6))


def seconds_until_good(error: ErrorOverTime, undisturbed: ErrorOverTime, start: float) -> float:
    """Seconds from ``start`` until a second begins whose mean error is at most 1.2 times the undisturbed stream's in
    the same second; NaN if none does. A frame without an answer is not good."""
    good = _good(error, undisturbed, start)
    return float(np.argmax(good) / error.rate) if good.any() else float("nan")


def bad_seconds(error: ErrorOverTime, undisturbed: ErrorOverTime, start: float) -> float:
    """How many of the seconds from ``start`` on are not so: what gets worse again later counts too."""
    return float(np.sum(~_good(error, undisturbed, start)) / error.rate)


def _good(error: ErrorOverTime, undisturbed: ErrorOverTime, start: float) -> np.ndarray:
    """Of each second, one for every frame from ``start`` on that it can begin with."""
    length = round(SUSTAINED_S * error.rate)
    begin = max(0, round(start * error.rate))
    frames = min(len(error.mpjpe_mm), len(undisturbed.mpjpe_mm))
    good = []
    for row in range(begin, frames - length + 1):
        ours, theirs = error.mpjpe_mm[row : row + length], undisturbed.mpjpe_mm[row : row + length]
        seen = np.isfinite(theirs)
        whole = bool(seen.any() and np.all(np.isfinite(ours[seen])))
        good.append(whole and bool(ours[seen].mean() <= GOOD * theirs[seen].mean()))
    return np.array(good, bool)


def _mean(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")
