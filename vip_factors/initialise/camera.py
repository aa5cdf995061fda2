"""Where the camera starts, and where it puts the wearers: from the hypothesis cameras of the association (PnP).

Every hypothesis is a camera that sees one wearer's skeleton as one detection shows it, in that wearer's own world:
the vertical of all these worlds is the same, their headings and root paths are not.

How an IMU sits on a camera, if nobody said, follows from how the camera turned by the picture and by the IMU
(:func:`camera_mounting`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import median_filter

from vip_factors.geometry.quaternions import interpolate_points, interpolate_rotations
from vip_factors.geometry.rotations import (
    Array,
    angle_between,
    nearest_rotation,
    rotation_z,
    transpose,
    wrap_angle,
    yaw_of,
)
from vip_factors.sensors.camera import CameraPath

MEAN_ROUNDS = 10  # of reweighting: a robust mean settles in five
MEAN_SCALE = np.deg2rad(5.0)  # beyond which a hypothesis counts less: PnP on an inertial skeleton is off by so much
LEAP_SIGHTINGS, LEAP_WINDOW = 5, 0.6  # on either side; s that they may span
# A pan at 90 degrees a second turns by 15 between them; PnP on a skeleton of careless mountings by 24.
LEAP_TURN = np.deg2rad(30.0)
# s on either side, over which most sightings have to have leapt, too: a detector that takes left for right turns PnP
# by 45 degrees for a fifth of a second, and back. Without this 20 leaps in twelve minutes of gestures, now none;
# 48 films with a cut or another zoom in the middle are all told, as before.
LEAP_LASTS = 1.5
SMOOTHING = 0.5  # s, window of the median over single hypotheses


@dataclass(frozen=True)
class Sightings:
    """The hypothesis cameras of one wearer, one at most for each video frame.

    Attributes:
        time: ``(n,)`` seconds, increasing.
        R_camera_world: ``(n, 3, 3)`` from the wearer's own world.
        p_camera_pelvis: ``(n, 3)`` metres, where the camera sees the wearer's pelvis.
    """

    time: Array
    R_camera_world: Array
    p_camera_pelvis: Array

    def __len__(self) -> int:
        return len(self.time)

    def turned(self, yaw: float) -> "Sightings":
        """The same with the wearer's own world turned about the vertical by ``yaw`` radians."""
        return replace(self, R_camera_world=self.R_camera_world @ rotation_z(-yaw))


def robust_mean_rotation(R: Array, there: np.ndarray | float = 1.0) -> Array:
    """Means ``(..., 3, 3)`` of rotations ``(..., n, 3, 3)``, outliers discounted (Cauchy); ``there`` ``(..., n)`` says
    which there are."""
    weights = there * np.ones(R.shape[:-2])
    mean = _mean_rotation(R, weights)
    for _ in range(MEAN_ROUNDS):
        weights = there / (1 + (angle_between(mean[..., None, :, :], R) / MEAN_SCALE) ** 2)
        mean = _mean_rotation(R, weights)
    return mean


def _mean_rotation(R: Array, weights: Array) -> Array:
    return nearest_rotation(np.einsum("...n,...nij->...ij", weights, R))


def robust_mean_angle(angles: Array) -> float:
    """Mean of angles ``(n,)`` in radians, outliers discounted; found from the fullest direction."""
    spread = np.abs(wrap_angle(angles[:, None] - angles))
    mean = float(angles[np.argmin(np.sum(np.minimum(spread, 6 * MEAN_SCALE), axis=1))])
    for _ in range(MEAN_ROUNDS):
        error = wrap_angle(angles - mean)
        weights = 1 / (1 + (error / MEAN_SCALE) ** 2)
        mean += float(np.average(error, weights=weights))
    return float(wrap_angle(mean))


def standing_camera(sightings: Sightings, p_world_pelvis: Array) -> CameraPath:
    """A camera that stands still: the robust mean of the rotations, placed so that the first pelvis is where it is.

    ``p_world_pelvis`` ``(n, 3)`` at the sightings.
    """
    R = transpose(robust_mean_rotation(sightings.R_camera_world))
    p = np.median(p_world_pelvis - sightings.p_camera_pelvis @ R.T, axis=0)
    return CameraPath(sightings.time[:1], R[None], p[None])


def moving_camera(sightings: Sightings, p_world_pelvis: Array, time: Array) -> CameraPath:
    """A camera that moves, at instants ``time`` ``(T,)``: each sighting's own, smoothed by a running median."""
    R_world_camera = transpose(sightings.R_camera_world)
    return _path(_local_means(R_world_camera, sightings.time), sightings, p_world_pelvis, time)


def carried_camera(
    sightings: Sightings, p_world_pelvis: Array, time: Array, R_inertial_camera: Array
) -> tuple[CameraPath, float]:
    """A camera whose own IMU tells its rotations ``(T, 3, 3)`` but for the heading: the path, and that heading."""
    measured = interpolate_rotations(time, R_inertial_camera, np.clip(sightings.time, time[0], time[-1]))
    heading = robust_mean_angle(yaw_of(transpose(sightings.R_camera_world) @ transpose(measured)))
    path = _path(rotation_z(heading) @ measured, sightings, p_world_pelvis, time)
    return CameraPath(time, rotation_z(heading) @ R_inertial_camera, path.p_world_camera), heading


def _path(R_world_camera: Array, sightings: Sightings, p_world_pelvis: Array, time: Array) -> CameraPath:
    p = p_world_pelvis - np.einsum("tij,tj->ti", R_world_camera, sightings.p_camera_pelvis)
    return CameraPath(sightings.time, R_world_camera, running_median(p, sightings.time)).at(time)


def _local_means(R: Array, time: Array) -> Array:
    """At each instant the robust mean of what is near."""
    first = np.searchsorted(time, time - SMOOTHING)  # more than enough
    rows = first[:, None] + np.arange(np.max(np.searchsorted(time, time + SMOOTHING) - first, initial=1))
    rows = np.minimum(rows, len(time) - 1)
    there = np.abs(time[rows] - time[:, None]) <= SMOOTHING / 2
    there[:, 1:] &= rows[:, 1:] != rows[:, :-1]  # the last one but once
    return robust_mean_rotation(R[rows], there)


def running_median(values: Array, time: Array) -> Array:
    """Medians of ``(n, 3)`` over about half a second."""
    instants = np.unique(time)  # several cameras may see at one instant
    step = float(np.median(np.diff(instants))) * len(instants) / len(time) if len(instants) > 1 else 1.0
    window = max(1, min(len(values), round(SMOOTHING / step) | 1))
    return np.asarray(median_filter(values, size=(window, 1), mode="nearest"))


def leaps(sightings: Sightings) -> Array:
    """Instants ``(n,)`` at which wearer or world leap in the camera's frame faster than people and cameras move.

    A cut in the video does so, a change of zoom (which looks like a change of depth), or a stranger taken for the
    wearer. Medians over a few sightings before and after are compared: single hypotheses are rough.
    """
    time, p, R = sightings.time, sightings.p_camera_pelvis, sightings.R_camera_world
    found, n = [], LEAP_SIGHTINGS
    if len(time) < 2 * n:
        return np.zeros(0)
    turns, moves = _turns(R, n), _moves(p, n)
    for k in n + np.flatnonzero((turns | moves) & (time[2 * n - 1 :] - time[: 1 - 2 * n] <= LEAP_WINDOW)):
        first, last = np.searchsorted(time, [time[k] - LEAP_LASTS, time[k] + LEAP_LASTS])
        before, after = slice(first, k), slice(k, last)
        if turns[k - n]:
            is_leap = angle_between(*(robust_mean_rotation(R[one]) for one in (before, after))) > LEAP_TURN
        else:
            is_leap = _is_far(np.median(p[before], axis=0), np.median(p[after], axis=0))
        if is_leap:
            found.append(time[k])
    times = np.array(found)
    return times[np.diff(times, prepend=-np.inf) > LEAP_WINDOW]


def _is_far(before: Array, after: Array) -> np.ndarray:
    # A runner crosses 1 m between the middles of five sightings at 30 Hz; PnP's depth is off by some 5 %.
    leap_m, leap_of_depth = 0.5, 0.15
    return np.linalg.norm(after - before, axis=-1) > leap_m + leap_of_depth * np.abs(before[..., 2])


def _moves(p: Array, n: int) -> np.ndarray:
    """Of the ``n``-th of points ``(N, 3)`` and later ones, whether it and those after it are far from those before."""
    middles = np.median(sliding_window_view(p, n, axis=0), axis=-1)
    return _is_far(middles[:-n], middles[n:])


def _turns(R: Array, n: int) -> np.ndarray:
    """The same of rotations ``(N, 3, 3)``."""
    leap_scatter = 1 / 3  # of the turn, at most, on either side: hypotheses that flip to and fro scatter by more
    some = np.moveaxis(sliding_window_view(R, n, axis=0), -1, 1)
    means = _mean_rotation(some, np.ones(some.shape[:2]))
    scatter = np.median(angle_between(means[:, None], some), axis=1)
    turn = angle_between(means[:-n], means[n:])
    return (turn > LEAP_TURN) & (np.maximum(scatter[:-n], scatter[n:]) < leap_scatter * turn)


def together(looks: Sequence[tuple[CameraPath, Sightings]]) -> tuple[CameraPath, Sightings]:
    """What several cameras of one world saw of a wearer, as one camera would see it that lies in the world's origin."""
    time, R, p = [], [], []
    for path, seen in looks:
        there = path.at(seen.time)
        time.append(seen.time)
        R.append(there.R_world_camera @ seen.R_camera_world)
        p.append(there.p_world_camera + np.einsum("tij,tj->ti", there.R_world_camera, seen.p_camera_pelvis))
    order = np.argsort(np.concatenate(time), kind="stable")
    sightings = Sightings(*(np.concatenate(parts)[order] for parts in (time, R, p)))
    return CameraPath(np.zeros(1), np.eye(3)[None], np.zeros((1, 3))), sightings


def world_turn(camera: CameraPath, sightings: Sightings) -> float:
    """By how much a wearer's own world is turned about the vertical in the camera's: radians, to be added."""
    R = camera.at(sightings.time).R_world_camera
    return robust_mean_angle(yaw_of(R @ sightings.R_camera_world))


def filmed_path(camera: CameraPath, sightings: Sightings, p_world_pelvis: Array, time: Array) -> Array:
    """Root path ``(T, 3)`` at ``time``: where the camera sees the wearer, and as they walked in between.

    ``p_world_pelvis`` ``(T, 3)`` is the wearer's own path, turned into the camera's world; it is moved by what it is
    off at the sightings.
    """
    there = camera.at(sightings.time)
    seen = there.p_world_camera + np.einsum("tij,tj->ti", there.R_world_camera, sightings.p_camera_pelvis)
    own = interpolate_points(time, p_world_pelvis, sightings.time)
    shift = running_median(seen - own, sightings.time)
    return p_world_pelvis + interpolate_points(sightings.time, shift, time)


HEADINGS = np.deg2rad(np.arange(0.0, 360.0, 0.5))


def camera_mounting(R_world_camera: Array, R_inertial_imu: Array) -> tuple[Array, float]:
    """``R_camera_imu`` ``(3, 3)`` and the IMU's heading in radians that fit best, outliers discounted.

    With ``C`` the camera's rotations by the picture and ``S`` the IMU's, ``C R_camera_imu = Rz(γ) S`` in every frame.
    For a heading ``γ`` the mounting is the mean of ``Cᵀ Rz(γ) S`` (Wahba's problem), the better the nearer these lie
    to each other; their sum is linear in ``cos γ``, ``sin γ`` and 1, so all headings can be tried.

    A camera that only turns about the vertical leaves the two free to turn against each other; any pair that fits does
    then, for all that is measured.

    Args:
        R_world_camera: ``(n, 3, 3)``, the world's z up.
        R_inertial_imu: ``(n, 3, 3)`` at the same instants.
    """
    # Beyond which a frame counts less: a camera by PnP on an inertial skeleton is off by so much
    scale = np.deg2rad(10.0)
    rounds = 10  # of reweighting: a robust mean settles in five
    weights = np.ones(len(R_world_camera))
    mounting, heading = np.eye(3), 0.0
    for _ in range(rounds):
        mounting, heading = _weighted(R_world_camera, R_inertial_imu, weights)
        off = angle_between(R_world_camera @ mounting, rotation_z(heading) @ R_inertial_imu)
        weights = 1 / (1 + (off / scale) ** 2)
    return mounting, heading


def _weighted(C: Array, S: Array, weights: Array) -> tuple[Array, float]:
    """The best pair: the heading whose mountings lie nearest to each other, and their mean."""
    horizontal, turned = np.diag([1.0, 1.0, 0.0]), np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    cosine, sine, rest = (
        np.einsum("n,nij->ij", weights, transpose(C) @ part @ S) for part in (horizontal, turned, np.diag([0, 0, 1.0]))
    )
    sums = np.cos(HEADINGS)[:, None, None] * cosine + np.sin(HEADINGS)[:, None, None] * sine + rest
    U, size, Vt = np.linalg.svd(sums)
    signs = np.ones((len(sums), 3))
    signs[:, 2] = np.sign(np.linalg.det(U) * np.linalg.det(Vt))
    best = int(np.argmax(np.sum(signs * size, axis=1)))
    return (U[best] * signs[best]) @ Vt[best], float(HEADINGS[best])
