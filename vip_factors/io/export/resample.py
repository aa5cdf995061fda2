"""An estimate at another frame rate."""

from dataclasses import replace

import numpy as np
from scipy.interpolate import make_interp_spline

from vip_factors.body.kinematics import Motion
from vip_factors.errors import InputError
from vip_factors.estimate import CameraEstimate, Estimate, PoseCovariance, WearerEstimate
from vip_factors.geometry.quaternions import interpolate_smoothly
from vip_factors.geometry.rotations import Array

SAME_RATE = 1e-9  # relative: rates come from differences of times


def resampled(estimate: Estimate, rate: float | None) -> Estimate:
    """The estimate at ``rate`` frames per second, from its first frame on; as it is if that is its rate or None.

    Poses follow cubic splines: against linear steps, feet that stand stay five times nearer to where they were.
    Nothing is filtered: at a lower rate, movements faster than half of it are sampled as they come.

    Raises:
        InputError: for a rate that is not positive.
    """
    if rate is None:
        return estimate
    if not 0 < rate < float("inf"):
        raise InputError(f"{rate:g} frames a second: expected a positive number")
    motion = estimate.wearers[0].motion
    if abs(motion.rate - rate) <= SAME_RATE * rate:
        return estimate
    wearers = tuple(_wearer(one, rate) for one in estimate.wearers)
    camera = None if estimate.camera is None else _camera(estimate.camera, motion.time, wearers[0].motion.time)
    return replace(estimate, wearers=wearers, camera=camera)


def poses_at(motion: Motion, time: Array) -> tuple[Array, Array]:
    """Joint rotations ``(N, 24, 3, 3)`` and root positions ``(N, 3)`` at ``time`` ``(N,)``; the ends are kept."""
    inside = np.clip(time, motion.time[0], motion.time[-1])
    spline = make_interp_spline(motion.time, motion.p_world_pelvis, k=min(3, len(motion) - 1))
    return interpolate_smoothly(motion.time, motion.R_parent_child, inside), spline(inside)


def _wearer(estimate: WearerEstimate, rate: float) -> WearerEstimate:
    motion = estimate.motion
    frames = int(np.floor((len(motion) - 1) / motion.rate * rate + 1e-6)) + 1
    time = motion.start + np.arange(frames) / rate
    R, p = poses_at(motion, time)
    covariance = estimate.covariance
    return replace(
        estimate,
        motion=replace(motion, R_parent_child=R, p_world_pelvis=p, rate=rate),
        covariance=None if covariance is None else PoseCovariance(
            _between(motion.time, covariance.joints, time), _between(motion.time, covariance.root, time)
        ),
        residuals={kind: _between(motion.time, values, time) for kind, values in estimate.residuals.items()},
    )  # fmt: skip


def _camera(camera: CameraEstimate, before: Array, time: Array) -> CameraEstimate:
    """A camera that stands still stays one pose."""
    moves = len(camera.path) > 1
    covariance, residual = camera.covariance, camera.residual_px
    return replace(
        camera,
        path=camera.path.at(time) if moves else camera.path,
        covariance=_between(before, covariance, time) if covariance is not None and moves else covariance,
        residual_px=None if residual is None else _between(before, residual, time),
    )


def _between(before: Array, values: Array, time: Array) -> Array:
    """Linear between frames, of any shape behind the first axis; NaN beside what is not known."""
    if len(values) != len(before):
        return values
    left = np.clip(np.searchsorted(before, time, side="right") - 1, 0, max(len(before) - 2, 0))
    right = np.minimum(left + 1, len(before) - 1)
    step = np.where(right > left, before[right] - before[left], 1.0)
    share = np.clip((time - before[left]) / step, 0.0, 1.0)
    share = np.where(share > 1 - 1e-9, 1.0, np.where(share < 1e-9, 0.0, share))
    share = share.reshape(-1, *[1] * (values.ndim - 1))
    mixed = np.where(share == 1, values[right], (1 - share) * values[left] + share * values[right])
    return np.where(share == 0, values[left], mixed)
