"""Alignment of a path from visual odometry with the world of the wearers."""

import itertools
from dataclasses import replace

import numpy as np

from vip_factors.geometry.rotations import Array, log, nearest_rotation, transpose
from vip_factors.initialise.camera import robust_mean_rotation
from vip_factors.sensors.camera import CameraPath
from vip_factors.sensors.odometry import Odometry
from vip_factors.sensors.scene import Camera

COMPARED_S = 1.0  # over which motions are compared: rough poses jitter from frame to frame


def in_camera_axes(camera: Camera, rough: CameraPath) -> Camera:
    """The camera with its odometry in OpenCV's camera axes, judged by rough poses of the camera ``(T,)``.

    ARKit and OpenGL point a camera's y axis up and its z axis backwards: turns about these axes and shifts along them
    then have the opposite sign.
    """
    odometry = camera.timed_odometry
    if odometry is None or camera.odometry is None or len(rough) < 2:
        return camera
    span = min(max(1, int(np.searchsorted(rough.time, rough.time[0] + COMPARED_S))), len(rough) - 1)
    measured, expected = (_motions(path, span) for path in (odometry.at(rough.time), rough))
    norms = np.linalg.norm(measured, axis=2) * np.linalg.norm(expected, axis=2)
    agreement = np.sum(np.einsum("kti,kti->kt", measured, expected) / np.maximum(norms, 1e-12))
    if agreement >= 0:
        return camera
    R_world_camera = camera.odometry.R_world_camera @ np.diag([1.0, -1.0, -1.0])
    return replace(camera, odometry=replace(camera.odometry, R_world_camera=R_world_camera))


def _motions(path: CameraPath, span: int) -> Array:
    """Turns and shifts over ``span`` instants ``(2, T − span, 2)``, their y and z components in the camera's axes."""
    R, p = path.R_world_camera, path.p_world_camera
    turns = log(transpose(R[:-span]) @ R[span:])
    shifts = np.einsum("tji,tj->ti", R[:-span], p[span:] - p[:-span])
    return np.stack([turns, shifts])[:, :, 1:]


def along_odometry(odometry: Odometry, rough: CameraPath) -> tuple[CameraPath, float]:
    """Rough poses ``(T,)`` replaced by the path that the odometry describes, laid over them, and that path's scale.

    Each stretch between two gaps or resets is laid over them by itself; the scale is 1 where it is known.
    """
    ends = np.flatnonzero(~odometry.valid) + 1
    stretches = [slice(int(start), int(end)) for start, end in itertools.pairwise([0, *ends]) if end > start]
    paths = [_integrated(odometry, stretch) for stretch in stretches]
    scale = 1.0
    if odometry.is_scale_free:
        number = int(np.argmax([len(p) for _, p in paths]))
        scale = _scale(*paths[number], rough.frames(stretches[number]))
    R_world_camera, p_world_camera = rough.R_world_camera.copy(), rough.p_world_camera.copy()
    for stretch, (R, p) in zip(stretches, paths, strict=True):
        segment = rough.frames(stretch)
        turn = robust_mean_rotation(segment.R_world_camera @ R.swapaxes(1, 2))
        p_turned = scale * p @ turn.T
        R_world_camera[stretch] = turn @ R
        p_world_camera[stretch] = p_turned + np.median(segment.p_world_camera - p_turned, axis=0)
    return CameraPath(rough.time, R_world_camera, p_world_camera), scale


def _integrated(odometry: Odometry, stretch: slice) -> tuple[Array, Array]:
    """Rotations ``(n, 3, 3)`` and positions ``(n, 3)`` of a stretch of frames, from its first one."""
    R, p = [np.eye(3)], [np.zeros(3)]
    for t in range(stretch.start, stretch.stop - 1):
        p.append(p[-1] + R[-1] @ odometry.p_camera_next[t])
        R.append(R[-1] @ odometry.R_camera_next[t])
    return nearest_rotation(np.array(R)), np.array(p)


def _scale(R: Array, p: Array, rough: CameraPath) -> float:
    """Least squares scale of a path of known rotations to rough poses; at least a thousandth."""
    turn = robust_mean_rotation(rough.R_world_camera @ R.swapaxes(1, 2))
    centred, target = (points - points.mean(axis=0) for points in (p @ turn.T, rough.p_world_camera))
    return max(float(np.sum(centred * target) / max(np.sum(centred**2), 1e-12)), 1e-3)
