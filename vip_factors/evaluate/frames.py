"""Two motions brought to the same frame times: the one place where evaluation interpolates."""

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.errors import InputError
from vip_factors.geometry.quaternions import interpolate_rotations

TIME_TOLERANCE = 1e-6  # seconds: rounding of frame times in files


def resample(motion: Motion, start: float, rate: float, count: int) -> Motion:
    """The motion at ``count`` frames from ``start`` on, every joint by slerp and the root linearly.

    Raises:
        InputError: where a frame lies outside the motion.
    """
    time = start + np.arange(count) / rate
    first, last = motion.time[[0, -1]]
    if count < 1 or time[0] < first - TIME_TOLERANCE or time[-1] > last + TIME_TOLERANCE:
        raise InputError(
            f"motion '{motion.name}' lasts from {first:.3f} to {last:.3f} s: cannot give {count} frames from "
            f"{start:.3f} s at {rate:g} Hz"
        )
    joints = [interpolate_rotations(motion.time, motion.R_parent_child[:, j], time) for j in range(24)]
    root = np.stack([np.interp(time, motion.time, motion.p_world_pelvis[:, axis]) for axis in range(3)], axis=1)
    return Motion(motion.skeleton, np.stack(joints, axis=1), root, rate, start, motion.name)


def common_frames(estimate: Motion, truth: Motion) -> tuple[Motion, Motion, slice]:
    """Both motions at those frames of the estimate that lie within the truth; skeletons stay each one's own.

    Returns:
        The estimate (its own frames, never interpolated), the truth at the same times, and which frames of the
        estimate they are.

    Raises:
        InputError: if they do not overlap, or one is empty.
    """
    for motion, which in ((estimate, "estimate"), (truth, "truth")):
        if len(motion) == 0:
            raise InputError(f"{which} '{motion.name}' has no poses: expected at least one; is its file cut off?")
    inside = np.flatnonzero(
        (estimate.time >= truth.time[0] - TIME_TOLERANCE) & (estimate.time <= truth.time[-1] + TIME_TOLERANCE)
    )
    if len(inside) == 0:
        raise InputError(
            f"estimate ({estimate.time[0]:.3f} to {estimate.time[-1]:.3f} s) and truth ({truth.time[0]:.3f} to "
            f"{truth.time[-1]:.3f} s) share no frame: check that both use the recording's clock"
        )
    chosen = slice(int(inside[0]), int(inside[-1]) + 1)
    part = estimate.frames(chosen)
    return part, resample(truth, part.start, part.rate, len(part)), chosen
