"""How a camera moves that films people: on a tripod, in the hands of somebody who stands, or who follows them.

Every component is smooth (twice differentiable paths), so that an IMU on the camera feels finite accelerations. The
result is a body of one bone: the simulated sensors of people work on it unchanged.
"""

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter, lfiltic
from scipy.spatial.transform import Rotation, RotationSpline

from vip_factors.body.skeleton import JOINT_COUNT, Skeleton
from vip_factors.geometry.quaternions import interpolate_points
from vip_factors.geometry.rotations import Array, exp, transpose
from vip_factors.simulate.dense import DenseMotion
from vip_factors.simulate.noise import smooth_process
from vip_factors.simulate.scene_settings import SceneSettings

GRID_HZ = 120.0  # of the nodes of the splines
AIM_HEIGHT_M = 0.95  # of the middle of a standing person
TRIPOD_HEIGHT_M = 1.4  # of a tripod drawn out
HAND_HEIGHT_M = 1.45  # of a phone held before the chest or the chin
FILL = 0.6  # share of the image's height that a person may fill before the camera steps back
MARGIN_M = 0.5  # beside the outermost pelvis, for arms
NEAREST_M, FARTHEST_M = 2.5, 7.0  # where one stands to film people indoors; wider action leaves the image
CLEARANCE_M = 1.5  # from a standing camera to anybody's pelvis

# Sway of a standing person: about 5 mm RMS at the centre of mass in quiet stance (Winter 1995, Gait & Posture 3), and
# as an inverted pendulum half as much again at the chin; arms that hold a phone double it.
SWAY_M, SWAY_TIME_S = 0.015, 1.2
# Tremor of arms that hold something: ours, 1 mm with 5 σ/τ² = 0.13 m/s² RMS each axis, about what a phone in the hand
# of somebody who stands reads beside its noise.
HAND_M, HAND_TIME_S = 0.001, 0.2
# Pointing of a hand-held camera: a slow part (the operator's aim) and a fast one. The fast one's angular rate of
# 0.25·1.3/0.25 = 1.3 deg/s RMS is a calm hand; hand-held phone videos show 1–5 deg/s.
AIM_DEG, AIM_TIME_S = 2.0, 1.5
TREMOR_DEG, TREMOR_TIME_S = 0.25, 0.25
LAG_S = 0.3  # of the operator's following, three times in a row: about a second behind
# Walking: bounce of the trunk, 2–4 cm from lowest to highest, twice per stride; sway to the sides once (Inman 1981).
WALK_STEP_HZ, BOUNCE_M, LATERAL_M, WALK_SPEED = 1.8, 0.015, 0.02, 1.2
CIRCLE_DEG, CIRCLE_TIME_S = 35.0, 6.0  # how far somebody who follows goes round the people


def camera_motion(
    people: Array, time: Array, settings: SceneSettings, random: np.random.Generator, others: Array | None = None
) -> DenseMotion:
    """The path of the camera from the first to the last instant, as a body whose bone 0 is the camera.

    Args:
        people: ``(P, T, 3)`` metres, the pelves of whom the camera films, in the world.
        time: ``(T,)`` seconds, evenly spaced.
        settings: the kind of camera and its lens.
        random: where sway, tremor and the side to film from come from.
        others: ``(Q, T, 3)`` pelves of people whom a standing camera must not run into, NaN where absent.
    """
    grid = np.linspace(time[0], time[-1], max(8, int(np.ceil((time[-1] - time[0]) * GRID_HZ)) + 1))
    middle = interpolate_points(time, people.mean(axis=0), grid)
    azimuth = 2 * np.pi * random.random() if settings.azimuth_deg is None else np.deg2rad(settings.azimuth_deg)
    if settings.camera == "walking":
        p = _following(middle, azimuth, grid, settings, random)
    else:
        everybody = people if others is None else np.concatenate([people, others])
        p = np.repeat(_stand(people, everybody, azimuth, settings)[None], len(grid), axis=0)
    if settings.camera == "fixed":
        aim = np.repeat(_middle_of(people)[None], len(grid), axis=0)
    else:
        p = p + _noise(random, grid, SWAY_M, SWAY_TIME_S) * [1, 1, 0.3] + _noise(random, grid, HAND_M, HAND_TIME_S)
        aim = _lagging(middle, grid)
    aim = np.concatenate([aim[:, :2], np.full((len(grid), 1), AIM_HEIGHT_M)], axis=1)
    R = looking_at(p, aim)
    if settings.camera != "fixed":
        shake = _noise(random, grid, AIM_DEG, AIM_TIME_S) + _noise(random, grid, TREMOR_DEG, TREMOR_TIME_S)
        R = R @ exp(np.deg2rad(shake))
    return camera_body(grid, R, p)


def camera_body(time: Array, R_world_camera: Array, p_world_camera: Array) -> DenseMotion:
    """Splines through camera poses, as a body whose bone 0 is the camera."""
    turns = RotationSpline(time, Rotation.from_matrix(R_world_camera))
    path = make_interp_spline(time, p_world_camera, 5)
    body = Skeleton(np.zeros((JOINT_COUNT, 3)), source="camera")
    return DenseMotion(body, (turns,), path, float(time[0]), float(time[-1]), "camera")


def looking_at(p_world_camera: Array, p_world_aim: Array) -> Array:
    """``R_world_camera`` ``(T, 3, 3)`` of a level camera (x right, y down, z forward) that looks at a point."""
    forward = p_world_aim - p_world_camera
    forward = forward / np.linalg.norm(forward, axis=1, keepdims=True)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    return transpose(np.stack([right, np.cross(forward, right), forward], axis=1))


def _middle_of(people: Array) -> Array:
    """Middle ``(3,)`` of where people spend their time."""
    low, high = np.quantile(people.reshape(-1, 3), [0.02, 0.98], axis=0)
    return (low + high) / 2


def _distance(people: Array, azimuth: float, settings: SceneSettings) -> float:
    """From where the camera sees most of the action, or as far back as it can go."""
    if settings.distance_m is not None:
        return settings.distance_m
    toward = np.array([np.cos(azimuth), np.sin(azimuth)])
    away = (people.reshape(-1, 3) - _middle_of(people))[:, :2]
    across, depth = away @ [-toward[1], toward[0]], away @ toward
    focal = settings.model.focal[0]
    wide = depth + (np.abs(across) + MARGIN_M) * 2 * focal / settings.width
    tall = 1.75 * focal / (FILL * settings.height)
    return float(np.clip(max(np.quantile(wide, 0.95), tall), NEAREST_M, FARTHEST_M))


def _stand(people: Array, everybody: Array, azimuth: float, settings: SceneSettings) -> Array:
    """Where ``(3,)`` a standing camera is: at its distance, or as much farther as people need to pass."""
    toward = np.array([np.cos(azimuth), np.sin(azimuth)])
    middle = _middle_of(people)[:2]
    height = TRIPOD_HEIGHT_M if settings.camera == "fixed" else HAND_HEIGHT_M
    ground = everybody.reshape(-1, 3)[:, :2]
    distance = _distance(people, azimuth, settings)
    while (
        settings.distance_m is None
        and np.nanmin(np.linalg.norm(ground - middle - distance * toward, axis=1)) < CLEARANCE_M
        and distance < 2 * FARTHEST_M
    ):
        distance += 0.25
    return np.array([*(middle + distance * toward), height])


def _following(
    middle: Array, azimuth: float, grid: Array, settings: SceneSettings, random: np.random.Generator
) -> Array:
    """Path ``(T, 3)`` of somebody who walks along at a distance and round the people now and then."""
    distance = settings.distance_m or 1.75 * settings.model.focal[0] / (FILL * settings.height)
    around = azimuth + np.deg2rad(_noise(random, grid, CIRCLE_DEG, CIRCLE_TIME_S)[:, 0])
    around += azimuth - around[0]
    path = _lagging(middle, grid) + distance * np.stack([np.cos(around), np.sin(around), 0 * around], axis=1)
    velocity = np.gradient(path, grid, axis=0)
    step = grid[1] - grid[0]
    pace = gaussian_filter1d(np.linalg.norm(velocity[:, :2], axis=1), 0.5 / step, mode="nearest") / WALK_SPEED
    pace = np.minimum(pace, 1.5)
    phase = 2 * np.pi * WALK_STEP_HZ * grid
    side = np.stack([-np.sin(around), np.cos(around)], axis=1)
    path[:, :2] += (LATERAL_M * pace * np.sin(phase / 2))[:, None] * side
    path[:, 2] = HAND_HEIGHT_M + BOUNCE_M * pace * np.sin(phase)
    return path


def _lagging(path: Array, grid: Array) -> Array:
    """The path as somebody follows it: three first-order lags, in equilibrium at the start."""
    keep = np.exp(-(grid[1] - grid[0]) / LAG_S)
    for _ in range(3):
        state = np.stack([lfiltic([1 - keep], [1, -keep], [first]) for first in path[0]], axis=1)
        path, _ = lfilter([1 - keep], [1, -keep], path, axis=0, zi=state)
    return path


def _noise(random: np.random.Generator, grid: Array, sigma: float, time_constant: float) -> Array:
    return smooth_process(random, len(grid), float(grid[1] - grid[0]), sigma, time_constant)
