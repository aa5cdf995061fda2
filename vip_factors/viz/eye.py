"""Where a picture is seen from: a lens and a pose, and how to find one from which everybody is seen well."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.ndimage import gaussian_filter1d

from vip_factors.body.kinematics import Motion
from vip_factors.geometry.rotations import Array, rotation_x, rotation_z
from vip_factors.sensors.camera_model import CameraModel


@dataclass(frozen=True)
class Eye:
    """One view of the world.

    Attributes:
        model: in pixels of the picture that is drawn (see :func:`scaled`).
        R_world_camera: ``(3, 3)``, camera axes (x right, y down, z forward).
        p_world_camera: ``(3,)`` metres.
    """

    model: CameraModel
    R_world_camera: Array
    p_world_camera: Array

    def project(self, p_world: Array) -> tuple[Array, Array]:
        """Pixels ``(..., 2)`` and depths ``(...)`` in metres, negative behind the eye, of points ``(..., 3)``."""
        p_camera = (p_world - self.p_world_camera) @ self.R_world_camera
        return self.model.project(p_camera), p_camera[..., 2]


class Lens:
    """The rays of a picture's pixels, found once: an undistorted grid costs more than a frame."""

    def __init__(self, model: CameraModel) -> None:
        self.model = model

    @cached_property
    def rays(self) -> tuple[Array, Array]:
        """Right and down ``(H, W)`` float32, of rays that go one metre forward."""
        x, y = np.meshgrid(np.arange(self.model.width), np.arange(self.model.height))
        flat = self.model.normalise(np.stack([x, y], axis=-1).astype(float)).astype(np.float32)
        return np.ascontiguousarray(flat[..., 0]), np.ascontiguousarray(flat[..., 1])


def scaled(model: CameraModel, width: int, height: int) -> CameraModel:
    """The same lens over a picture of another size; pixel centres are whole numbers in both."""
    by = np.array([width / model.width, height / model.height])
    focal = by * np.array(model.focal)
    centre = by * (np.array(model.centre) + 0.5) - 0.5
    return CameraModel(
        width, height, (float(focal[0]), float(focal[1])), (float(centre[0]), float(centre[1])), model.distortion
    )


def looking_at(p_world_camera: Array, target: Array, model: CameraModel) -> Eye:
    """An eye at a point that has another in the middle of its picture, upright."""
    forward = (target - p_world_camera) / np.linalg.norm(target - p_world_camera)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right = right / np.linalg.norm(right)
    return Eye(model, np.stack([right, np.cross(forward, right), forward], axis=1), p_world_camera)


R_FRONT_WORLD = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])  # an eye that looks along −x
DISTANCE_M = 9.0  # far enough for nearly parallel lines


def distant_eye(
    size: tuple[int, int], yaw: float, pitch: float, pixel: tuple[float, float], scale: float,
    p_world: Array | tuple[float, float, float] = (0.0, 0.0, 0.0), distance: float = DISTANCE_M,
) -> Eye:  # fmt: skip
    """An eye that sees a point at a pixel of a picture of ``size`` (width, height), ``scale`` pixels a metre there.

    ``yaw`` (rad) 0 sees the front of who faces x, positive from their left; ``pitch`` (rad) is from above.
    """
    R = rotation_x(pitch) @ R_FRONT_WORLD @ rotation_z(-yaw)
    model = CameraModel(*size, (scale * distance, scale * distance), pixel)
    return Eye(model, R.T, np.asarray(p_world) - distance * R[2])


FIELD_DEG = 30.0  # of view, upright: as of a portrait lens, bodies look like themselves
PITCH = np.deg2rad(13.0)  # down onto the scene: the floor is seen, and faces are not lost
BODY_M = 0.18  # of skin around joints
AROUND = 1.04  # room beside what moves
LONGEST_M = 4.5  # a way that is longer is followed
FOLLOW_S = 1.2  # how smoothly
DIRECTIONS = 36
CENTRINGS = 6  # what is nearer takes more room: the middle of the picture is found in steps
SAMPLES = 60
FRONT_QUARTER = np.deg2rad(30.0)  # away from straight ahead: depth is seen there, and the face too


def room_model(width: int, height: int) -> CameraModel:
    """The lens through which rooms are seen."""
    focal = height / 2 / np.tan(np.deg2rad(FIELD_DEG) / 2)
    return CameraModel(width, height, (focal, focal), ((width - 1) / 2, (height - 1) / 2))


def viewpoints(motions: Sequence[Motion], floor: float, times: Array, model: CameraModel) -> list[Eye]:
    """An eye for each time: one for all where everybody stays near, else one that follows.

    Args:
        motions: of everybody, in the world.
        floor: height in metres.
        times: ``(T,)`` seconds.
        model: of the picture.
    """
    joints = np.stack([_joints_at(motion, times) for motion in motions], axis=1)
    way = 0.5 * (joints[:, :, 0].min(axis=1) + joints[:, :, 0].max(axis=1))
    if np.ptp(way[:, :2], axis=0).max() <= LONGEST_M or len(times) < 2:
        low, high = joints.min(axis=(0, 1, 2)), joints.max(axis=(0, 1, 2))
        middle = np.tile((low + high) / 2, (len(times), 1))
    else:
        middle = gaussian_filter1d(way, FOLLOW_S * len(times) / max(float(np.ptp(times)), 1e-3), axis=0, mode="nearest")
    middle[:, 2] = floor + 0.5 * (np.max(joints[..., 2]) + BODY_M - floor)
    direction = _direction(motions, joints, times)
    points = _around(joints - middle[:, None, None], floor - middle[0, 2])
    shift, distance = _fitted(points.reshape(-1, 3), direction, model)
    return [looking_at(one + shift + distance * direction, one + shift, model) for one in middle]


def _joints_at(motion: Motion, times: Array) -> Array:
    frames = np.clip(np.round((times - motion.start) * motion.rate), 0, len(motion) - 1).astype(int)
    return motion.state.p_world_joint[frames]


def _direction(motions: Sequence[Motion], joints: Array, times: Array) -> Array:
    """Unit vector ``(3,)`` from the scene to the eye: the best of some around it."""
    some = np.unique(np.linspace(0, len(times) - 1, min(SAMPLES, len(times))).astype(int))
    forward = []
    for motion in motions:
        frames = np.clip(np.round((times[some] - motion.start) * motion.rate), 0, len(motion) - 1).astype(int)
        forward.append(motion.state.R_world_bone[frames, 0, :2, 2])
    facing = np.stack(forward, axis=1)
    facing /= np.maximum(np.linalg.norm(facing, axis=-1, keepdims=True), 1e-9)
    yaws = np.linspace(0, 2 * np.pi, DIRECTIONS, endpoint=False)
    scores = []
    for yaw in yaws:
        eye, right = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
        off = np.arccos(np.clip(facing @ eye, -1, 1))
        score = float(np.mean(np.cos(off - FRONT_QUARTER)))
        side = np.sort(joints[some][:, :, 0, :2] @ right, axis=1)
        if side.shape[1] > 1:  # nobody behind another
            score += 2.0 * float(np.mean(np.clip(np.diff(side, axis=1).min(axis=1) / 0.7, 0, 1)))
        scores.append(score)
    best = yaws[int(np.argmax(scores))]
    return np.array([np.cos(PITCH) * np.cos(best), np.cos(PITCH) * np.sin(best), np.sin(PITCH)])


def _around(joints: Array, floor: float) -> Array:
    """The joints with their skin, and the feet on the floor: points ``(..., 3)``."""
    down = joints.copy()
    down[..., 2] = floor
    sides = BODY_M * np.array([[0, 0, 1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    return np.concatenate([*(joints + side for side in sides), down], axis=-2)


def _fitted(points: Array, direction: Array, model: CameraModel) -> tuple[Array, float]:
    """What to look at beside the origin ``(3,)``, and from how far, for points ``(N, 3)`` to fill the picture."""
    R = looking_at(direction, np.zeros(3), model).R_world_camera
    p = points @ R
    half = np.array([model.width / 2 / model.focal[0], model.height / 2 / model.focal[1]])
    shift = np.zeros(3)
    for _ in range(CENTRINGS):
        off = p - shift
        distance = float(np.max(AROUND * np.abs(off[:, :2]) / half - off[:, 2:3]))
        seen = off[:, :2] / (off[:, 2:3] + distance)
        shift[:2] += distance * (seen.min(axis=0) + seen.max(axis=0)) / 2
    off = p - shift
    return R @ shift, float(np.max(AROUND * np.abs(off[:, :2]) / half - off[:, 2:3]))
