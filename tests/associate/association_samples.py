"""A small scene of people who make the package's gestures at different moments, seen by a moving camera."""

from dataclasses import dataclass, replace

import numpy as np

from vip_factors.associate.hypothesis import wearer_points
from vip_factors.body.keypoints import keypoint_set
from vip_factors.body.kinematics import Motion
from vip_factors.geometry.rotations import Array, exp, rotation_z
from vip_factors.sensors.camera import CameraModel, CameraPath
from vip_factors.sensors.detections import Detections
from vip_factors.simulate.gestures import gestures

MODEL = CameraModel(1280, 720, (900.0, 900.0), (640.0, 360.0), (-0.1, 0.02, 0.001, -0.001))
RATE = 30.0


@dataclass(frozen=True)
class Sample:
    detections: Detections
    motions: tuple[Motion, ...]
    wearer: np.ndarray
    camera: CameraPath


def person(late: float, seconds: float, yaw: float, x: float, y: float) -> Motion:
    """Somebody who makes the gestures from a moment on, at a place."""
    motion = gestures(late + seconds + 1, rate=60.0).frames(slice(round(late * 60), round((late + seconds) * 60) + 1))
    R = motion.R_parent_child.copy()
    R[:, 0] = rotation_z(yaw) @ R[:, 0]
    p = motion.p_world_pelvis @ rotation_z(yaw).T
    p = p - [*p[0, :2], 0.0] + [x, y, 0.0]
    return replace(motion, R_parent_child=R, p_world_pelvis=p, start=0.0, name=f"person{late:g}")


def camera_path(time: Array) -> CameraPath:
    """From five metres off, looking along −y, swaying."""
    R_level = np.array([[-1.0, 0, 0], [0, 0, -1.0], [0, -1.0, 0]])  # columns: camera axes in the world
    sway = np.stack([0.03 * np.sin(time), 0.1 * np.sin(0.5 * time), 0.02 * np.cos(time)], axis=1)
    p = np.stack([0.3 * np.sin(0.4 * time), 5.5 + 0.2 * np.cos(time), np.full(len(time), 1.4)], axis=1)
    return CameraPath(time, R_level @ exp(sway), p)


def scene(
    wearers: int = 2, seconds: float = 4.0, noise_px: float = 3.0, seed: int = 0, keypoints: str = "coco17",
    common_world: bool = False,
) -> Sample:  # fmt: skip
    """Wearers and three bystanders; in each frame their detections come in random order."""
    random = np.random.default_rng(seed)
    people = [
        person(late, seconds, yaw, x, y)
        for late, yaw, x, y in ((3.2, 0.3, -0.6, 0.2), (9.8, 2.0, 0.9, -0.2), (13.1, -0.5, -1.5, -0.8),
                                (15.3, 2.5, 1.9, -1.0), (6.5, 1.2, 0.2, -1.5))
    ]  # fmt: skip
    time = np.arange(round(seconds * RATE)) / RATE
    camera, names = camera_path(time), keypoint_set(keypoints)
    points = np.stack([wearer_points(person, names, time).p_world_keypoint for person in people])
    pixels = np.stack([MODEL.project(camera.to_camera(point)) for point in points], axis=1)
    pixels = pixels + noise_px * random.standard_normal(pixels.shape)
    order = np.argsort(random.random((len(time), len(people))), axis=1)
    frame = np.repeat(np.arange(len(time)), len(people))
    mixed = pixels[frame, order.ravel()]
    confidence = np.where(np.isfinite(mixed[..., 0]), 0.8, 0.0)
    owner = np.where(order.ravel() < wearers, order.ravel(), -1)
    turns = np.zeros(wearers) if common_world else random.uniform(-3, 3, wearers)
    motions = tuple(in_another_world(one, turn) for one, turn in zip(people, turns, strict=False))
    return Sample(Detections(names, time, frame, mixed, confidence), motions, owner, camera)


def in_another_world(motion: Motion, turn: float) -> Motion:
    """The motion as a tracker with another heading, and no idea of places, would have it."""
    if turn == 0.0:
        return motion
    R = motion.R_parent_child.copy()
    R[:, 0] = rotation_z(turn) @ R[:, 0]
    return replace(motion, R_parent_child=R, p_world_pelvis=motion.p_world_pelvis * [0.0, 0.0, 1.0])
