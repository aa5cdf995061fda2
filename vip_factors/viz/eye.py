"""Where a picture is seen from: a camera's lens and pose, in pixels of the picture that is drawn."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vip_factors.geometry.rotations import Array
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
