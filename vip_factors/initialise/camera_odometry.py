"""Alignment of a path from visual odometry with the world of the wearers."""

import itertools
from dataclasses import replace

import numpy as np

from vip_factors.geometry.rotations import Array, log, transpose
from vip_factors.initialise.camera import robust_mean_rotation
from vip_factors.sensors.camera import CameraPath
from vip_factors.sensors.odometry import Odometry
from vip_factors.sensors.scene import Camera

COMPARED_S = 1.0  # over which motions are compared: rough poses jitter from frame to frame


def in_camera_axes(camera: Camera, rough_path: CameraPath) -> Camera:
    """The camera with its odometry in OpenCV's camera axes, judged by rough poses of the camera ``(T,)``.

    ARKit and OpenGL point a camera's y axis up and its z axis backwards: turns about these axes and shifts along them
    then have the opposite sign.
    """
    odometry = camera.timed_odometry
    if odometry is None or camera.odometry is None or len(rough_path) < 2:
        return camera
    span = min(max(1, int(np.searchsorted(rough_path.time, rough_path.time[0] + COMPARED_S))), len(rough_path) - 1)
    measured, expected = (_motions(path, span) for path in (odometry.at(rough_path.time), rough_path))
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
    scale = _scale(path.frames(longest), rough_path.frames(longest)) if odometry.is_scale_free else 1.0
    for stretch in stretches:
        segment, target = path.frames(stretch), rough_path.frames(stretch)
        turn = robust_mean_rotation(target.R_world_camera @ transpose(segment.R_world_camera))
        p_turned = scale * segment.p_world_camera @ turn.T
        R_world_camera[stretch] = turn @ segment.R_world_camera
        p_world_camera[stretch] = p_turned + np.median(target.p_world_camera - p_turned, axis=0)
    return CameraPath(rough_path.time, R_world_camera, p_world_camera), scale


def _scale(path: CameraPath, target: CameraPath) -> float:
    """Least squares scale of a path to poses at the same instants; at least a thousandth."""
    turn = robust_mean_rotation(target.R_world_camera @ transpose(path.R_world_camera))
    centred, expected = (p - p.mean(axis=0) for p in (path.p_world_camera @ turn.T, target.p_world_camera))
    return max(float(np.sum(centred * expected) / max(np.sum(centred**2), 1e-12)), 1e-3)
