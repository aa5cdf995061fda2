"""Initial camera path and wearer positions from the PnP poses of the association.

Each PnP pose relates the camera to one wearer's skeleton in that wearer's world; these worlds have the same vertical
but different headings and root paths. :func:`camera_mounting` estimates the mounting of an IMU on the camera, and
:func:`along_odometry` aligns a path from visual odometry with such poses.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import median_filter

from vip_factors.geometry.quaternions import interpolate_points, interpolate_rotations
from vip_factors.geometry.rotations import (
    Array,
    angle_between,
    log,
    nearest_rotation,
    rotation_z,
    transpose,
    wrap_angle,
    yaw_of,
)
from vip_factors.sensors.camera import CameraPath, Odometry
from vip_factors.sensors.scene import Camera

MEAN_ROUNDS = 10  # of reweighting; a robust mean converges in five
MEAN_SCALE = np.deg2rad(5.0)  # Cauchy scale: usual error of PnP on an inertial skeleton
LEAP_SIGHTINGS, LEAP_WINDOW = 5, 0.6  # on either side; s that they may span
LEAP_TURN = np.deg2rad(30.0)  # a pan at 90 °/s turns by 15° between them, PnP with careless mountings by 24°
LEAP_LASTS = 1.5  # s on either side of a lasting leap; swapped sides turn PnP for a fifth of a second only
SMOOTHING = 0.5  # s, window of the median over PnP poses
COMPARED_S = 1.0  # over which odometry and rough poses are compared: these jitter from frame to frame


@dataclass(frozen=True)
class Sightings:
    """PnP poses of one wearer, at most one for each video frame.

    Attributes:
        time: ``(n,)`` seconds, increasing.
        R_camera_world: ``(n, 3, 3)`` from the wearer's world.
        p_camera_pelvis: ``(n, 3)`` metres, the wearer's pelvis in the camera's frame.
    """

    time: Array
    R_camera_world: Array
    p_camera_pelvis: Array

    def __len__(self) -> int:
        return len(self.time)

    def turned(self, yaw: float) -> "Sightings":
        """Turn the wearer's world about the vertical by ``yaw`` radians."""
        return replace(self, R_camera_world=self.R_camera_world @ rotation_z(-yaw))


def robust_mean_rotation(R: Array, is_present: np.ndarray | float = 1.0) -> Array:
    """Robust means ``(..., 3, 3)`` (Cauchy) of rotations ``(..., n, 3, 3)`` with a mask ``(..., n)``."""
    weights = is_present * np.ones(R.shape[:-2])
    mean = _mean_rotation(R, weights)
    for _ in range(MEAN_ROUNDS):
        weights = is_present / (1 + (angle_between(mean[..., None, :, :], R) / MEAN_SCALE) ** 2)
        mean = _mean_rotation(R, weights)
    return mean


def _mean_rotation(R: Array, weights: Array) -> Array:
    return nearest_rotation(np.einsum("...n,...nij->...ij", weights, R))


def robust_mean_angle(angles: Array) -> float:
    """Robust mean of angles ``(n,)`` in radians, started from the densest direction."""
    spread = np.abs(wrap_angle(angles[:, None] - angles))
    mean = float(angles[np.argmin(np.sum(np.minimum(spread, 6 * MEAN_SCALE), axis=1))])
    for _ in range(MEAN_ROUNDS):
        error = wrap_angle(angles - mean)
        weights = 1 / (1 + (error / MEAN_SCALE) ** 2)
        mean += float(np.average(error, weights=weights))
    return float(wrap_angle(mean))


def standing_camera(sightings: Sightings, p_world_pelvis: Array) -> CameraPath:
    """Pose of a static camera: robust mean of the rotations, median of the positions.

    ``p_world_pelvis`` ``(n, 3)`` m is at the sightings.
    """
    R = transpose(robust_mean_rotation(sightings.R_camera_world))
    p = np.median(p_world_pelvis - sightings.p_camera_pelvis @ R.T, axis=0)
    return CameraPath(sightings.time[:1], R[None], p[None])


def moving_camera(sightings: Sightings, p_world_pelvis: Array, time: Array) -> CameraPath:
    """Path of a moving camera at ``time`` ``(T,)``: poses of the sightings, smoothed."""
    seen = sightings.time
    start = np.searchsorted(seen, seen - SMOOTHING)
    rows = start[:, None] + np.arange(np.max(np.searchsorted(seen, seen + SMOOTHING) - start, initial=1))
    rows = np.minimum(rows, len(seen) - 1)
    is_near = np.abs(seen[rows] - seen[:, None]) <= SMOOTHING / 2
    is_near[:, 1:] &= rows[:, 1:] != rows[:, :-1]  # without repetitions of the last row
    R_world_camera = robust_mean_rotation(transpose(sightings.R_camera_world)[rows], is_near)
    return _path(R_world_camera, sightings, p_world_pelvis, time)


def carried_camera(
    sightings: Sightings, p_world_pelvis: Array, time: Array, R_inertial_camera: Array
) -> tuple[CameraPath, float]:
    """Path of a camera with an IMU, whose orientations ``(T, 3, 3)`` are given, and the IMU's heading in radians."""
    measured = interpolate_rotations(time, R_inertial_camera, np.clip(sightings.time, time[0], time[-1]))
    heading = robust_mean_angle(yaw_of(transpose(sightings.R_camera_world) @ transpose(measured)))
    path = _path(rotation_z(heading) @ measured, sightings, p_world_pelvis, time)
    return CameraPath(time, rotation_z(heading) @ R_inertial_camera, path.p_world_camera), heading


def _path(R_world_camera: Array, sightings: Sightings, p_world_pelvis: Array, time: Array) -> CameraPath:
    p = p_world_pelvis - np.einsum("tij,tj->ti", R_world_camera, sightings.p_camera_pelvis)
    return CameraPath(sightings.time, R_world_camera, running_median(p, sightings.time)).at(time)


def running_median(values: Array, time: Array) -> Array:
    """Running median of ``(n, 3)`` over about half a second."""
    instants = np.unique(time)  # several cameras may share an instant
    step = float(np.median(np.diff(instants))) * len(instants) / len(time) if len(instants) > 1 else 1.0
    window = max(1, min(len(values), round(SMOOTHING / step) | 1))
    return np.asarray(median_filter(values, size=(window, 1), mode="nearest"))


def leaps(sightings: Sightings) -> Array:
    """Instants ``(n,)`` at which wearer or world leap in the camera's frame faster than people and cameras move.

    Causes are a cut in the video, a change of zoom, or a bystander taken for the wearer. Medians over a few sightings
    before and after are compared, since single PnP poses are rough.
    """
    time, p, R = sightings.time, sightings.p_camera_pelvis, sightings.R_camera_world
    leap_times, n = [], LEAP_SIGHTINGS
    if len(time) < 2 * n:
        return np.zeros(0)
    turns, moves = _turns(R, n), _moves(p, n)
    for k in n + np.flatnonzero((turns | moves) & (time[2 * n - 1 :] - time[: 1 - 2 * n] <= LEAP_WINDOW)):
        start, end = np.searchsorted(time, [time[k] - LEAP_LASTS, time[k] + LEAP_LASTS])
        preceding, following = slice(start, k), slice(k, end)
        if turns[k - n]:
            is_leap = angle_between(*(robust_mean_rotation(R[rows]) for rows in (preceding, following))) > LEAP_TURN
        else:
            is_leap = _is_leap(np.median(p[preceding], axis=0), np.median(p[following], axis=0))
        if is_leap:
            leap_times.append(time[k])
    times = np.array(leap_times)
    return times[np.diff(times, prepend=-np.inf) > LEAP_WINDOW]


def _is_leap(preceding: Array, following: Array) -> np.ndarray:
    # a runner moves 1 m between the middles of five sightings at 30 Hz; PnP's depth has an error of about 5 %
    leap_m, leap_of_depth = 0.5, 0.15
    return np.linalg.norm(following - preceding, axis=-1) > leap_m + leap_of_depth * np.abs(preceding[..., 2])


def _moves(p: Array, n: int) -> np.ndarray:
    """Test for the ``n``-th and later of points ``(N, 3)`` if the following ``n`` are far from the preceding ones."""
    middles = np.median(sliding_window_view(p, n, axis=0), axis=-1)
    return _is_leap(middles[:-n], middles[n:])


def _turns(R: Array, n: int) -> np.ndarray:
    """Test as :func:`_moves` for rotations ``(N, 3, 3)``."""
    leap_scatter = 1 / 3  # of the turn, on either side: ambiguous poses scatter by more
    windows = np.moveaxis(sliding_window_view(R, n, axis=0), -1, 1)
    means = _mean_rotation(windows, np.ones(windows.shape[:2]))
    scatter = np.median(angle_between(means[:, None], windows), axis=1)
    turn = angle_between(means[:-n], means[n:])
    return (turn > LEAP_TURN) & (np.maximum(scatter[:-n], scatter[n:]) < leap_scatter * turn)


def together(looks: Sequence[tuple[CameraPath, Sightings]]) -> tuple[CameraPath, Sightings]:
    """Combine the sightings of several cameras of one world, as of one camera in the world's origin."""
    time, R, p = [], [], []
    for path, sightings_k in looks:
        poses = path.at(sightings_k.time)
        time.append(sightings_k.time)
        R.append(poses.R_world_camera @ sightings_k.R_camera_world)
        p.append(poses.p_world_camera + np.einsum("tij,tj->ti", poses.R_world_camera, sightings_k.p_camera_pelvis))
    order = np.argsort(np.concatenate(time), kind="stable")
    sightings = Sightings(*(np.concatenate(arrays)[order] for arrays in (time, R, p)))
    return CameraPath(np.zeros(1), np.eye(3)[None], np.zeros((1, 3))), sightings


def world_turn(camera: CameraPath, sightings: Sightings) -> float:
    """Yaw of a wearer's world in the camera's world, radians."""
    R = camera.at(sightings.time).R_world_camera
    return robust_mean_angle(yaw_of(R @ sightings.R_camera_world))


def filmed_path(camera: CameraPath, sightings: Sightings, p_world_pelvis: Array, time: Array) -> Array:
    """Root path ``(T, 3)`` at ``time`` that follows the sightings, and the inertial path between them.

    ``p_world_pelvis`` ``(T, 3)`` is the inertial path in the axes of the camera's world.
    """
    poses = camera.at(sightings.time)
    p_filmed = poses.p_world_camera + np.einsum("tij,tj->ti", poses.R_world_camera, sightings.p_camera_pelvis)
    p_estimated = interpolate_points(time, p_world_pelvis, sightings.time)
    shift = running_median(p_filmed - p_estimated, sightings.time)
    return p_world_pelvis + interpolate_points(sightings.time, shift, time)


HEADINGS = np.deg2rad(np.arange(0.0, 360.0, 0.5))


def camera_mounting(R_world_camera: Array, R_inertial_imu: Array) -> tuple[Array, float]:
    """Estimate ``R_camera_imu`` ``(3, 3)`` and the IMU's heading in radians, robustly.

    With ``C`` the camera's rotations from PnP and ``S`` the IMU's, ``C R_camera_imu = Rz(γ) S`` in every frame. For a
    heading ``γ`` the mounting is the mean of ``Cᵀ Rz(γ) S`` (Wahba's problem). Their sum is linear in ``cos γ``,
    ``sin γ`` and 1, so all headings are tried.

    If the camera only turns about the vertical, mounting and heading are not determined separately.

    ``R_world_camera`` and ``R_inertial_imu`` are ``(n, 3, 3)`` at the same instants, the world's z up.
    """
    scale = np.deg2rad(10.0)  # Cauchy scale: usual error of PnP on an inertial skeleton
    weights = np.ones(len(R_world_camera))
    mounting, heading = np.eye(3), 0.0
    for _ in range(MEAN_ROUNDS):
        mounting, heading = _weighted(R_world_camera, R_inertial_imu, weights)
        off = angle_between(R_world_camera @ mounting, rotation_z(heading) @ R_inertial_imu)
        weights = 1 / (1 + (off / scale) ** 2)
    return mounting, heading


def _weighted(C: Array, S: Array, weights: Array) -> tuple[Array, float]:
    """Mounting and heading with the largest weighted agreement."""
    horizontal, turned = np.diag([1.0, 1.0, 0.0]), np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    cosine, sine, vertical = (
        np.einsum("n,nij->ij", weights, transpose(C) @ basis @ S)
        for basis in (horizontal, turned, np.diag([0, 0, 1.0]))
    )
    sums = np.cos(HEADINGS)[:, None, None] * cosine + np.sin(HEADINGS)[:, None, None] * sine + vertical
    U, size, Vt = np.linalg.svd(sums)
    signs = np.ones((len(sums), 3))
    signs[:, 2] = np.sign(np.linalg.det(U) * np.linalg.det(Vt))
    index = int(np.argmax(np.sum(signs * size, axis=1)))
    return (U[index] * signs[index]) @ Vt[index], float(HEADINGS[index])


def in_camera_axes(camera: Camera, rough_path: CameraPath) -> Camera:
    """The camera with its odometry in OpenCV's camera axes, judged by rough poses of the camera ``(T,)``.

    ARKit and OpenGL point a camera's y axis up and its z axis backwards: turns about these axes and shifts along them
    then have the opposite sign.
    """
    odometry = camera.timed_odometry
    if odometry is None or camera.odometry is None or len(rough_path) < 2:
        return camera
    span = min(max(1, int(np.searchsorted(rough_path.time, rough_path.time[0] + COMPARED_S))), len(rough_path) - 1)
    motions = []  # turns and shifts over the span (2, T − span, 2): y and z in the camera's axes
    for path in (odometry.at(rough_path.time), rough_path):
        R, p = path.R_world_camera, path.p_world_camera
        turns = log(transpose(R[:-span]) @ R[span:])
        motions.append(np.stack([turns, np.einsum("tji,tj->ti", R[:-span], p[span:] - p[:-span])])[:, :, 1:])
    measured, expected = motions
    norms = np.linalg.norm(measured, axis=2) * np.linalg.norm(expected, axis=2)
    agreement = np.sum(np.einsum("kti,kti->kt", measured, expected) / np.maximum(norms, 1e-12))
    if agreement >= 0:
        return camera
    R_world_camera = camera.odometry.R_world_camera @ np.diag([1.0, -1.0, -1.0])
    return replace(camera, odometry=replace(camera.odometry, R_world_camera=R_world_camera))


def along_odometry(path: CameraPath, odometry: Odometry, rough_path: CameraPath) -> tuple[CameraPath, float]:
    """A path from odometry aligned with rough poses ``(T,)`` in the world of the wearers, and its scale.

    Each stretch between two gaps or resets is aligned by itself; where the odometry has no poses, the rough ones stay.
    The scale is 1 where it is known.
    """
    path = path.at(rough_path.time)
    ends = np.flatnonzero(~odometry.valid) + 1
    stretches = [slice(int(start), int(end)) for start, end in itertools.pairwise([0, *ends]) if end > start + 1]
    R_world_camera, p_world_camera = rough_path.R_world_camera.copy(), rough_path.p_world_camera.copy()
    if not stretches:
        return rough_path, 1.0
    longest = max(stretches, key=lambda stretch: stretch.stop - stretch.start)
    scale = 1.0
    if odometry.is_scale_free:  # by least squares
        segment, target = path.frames(longest), rough_path.frames(longest)
        turn = robust_mean_rotation(target.R_world_camera @ transpose(segment.R_world_camera))
        centred, expected = (p - p.mean(axis=0) for p in (segment.p_world_camera @ turn.T, target.p_world_camera))
        scale = max(float(np.sum(centred * expected) / max(np.sum(centred**2), 1e-12)), 1e-3)
    for stretch in stretches:
        segment, target = path.frames(stretch), rough_path.frames(stretch)
        turn = robust_mean_rotation(target.R_world_camera @ transpose(segment.R_world_camera))
        p_turned = scale * segment.p_world_camera @ turn.T
        R_world_camera[stretch] = turn @ segment.R_world_camera
        p_world_camera[stretch] = p_turned + np.median(target.p_world_camera - p_turned, axis=0)
    return CameraPath(rough_path.time, R_world_camera, p_world_camera), scale
