"""A turned square of the image around a person: what the landmark model looks at."""

from dataclasses import dataclass

import numpy as np

from vip_factors.geometry.rotations import Array

MARGIN = 1.25  # MediaPipe's: the square is wider than the circle around the person by this


@dataclass(frozen=True)
class Square:
    """Its centre in pixels, its side in pixels, and by how much its upright is turned clockwise in the image, radians.

    Frames: ``crop`` counts pixels from the square's own upper left corner, ``image`` from the image's.
    """

    x: float
    y: float
    side: float
    angle: float = 0.0

    @property
    def centre(self) -> Array:
        """``(2,)`` in pixels of the image."""
        return np.array([self.x, self.y])

    def affine(self, size: int) -> Array:
        """``(2, 3)`` from pixels of a crop of ``size`` by ``size`` to those of the image."""
        cos, sin = np.cos(self.angle), np.sin(self.angle)
        linear = self.side / size * np.array([[cos, -sin], [sin, cos]])
        return np.column_stack([linear, self.centre - linear @ np.full(2, size / 2)])

    def to_image(self, points: Array, size: int) -> Array:
        """Points ``(..., 2)`` of a crop of ``size`` by ``size`` pixels, in pixels of the image."""
        matrix = self.affine(size)
        return points @ matrix[:, :2].T + matrix[:, 2]

    def crop(self, image: np.ndarray, size: int) -> np.ndarray:
        """``(size, size, 3)`` bytes; black beyond the image."""
        import cv2

        # warpAffine counts from the middle of the first pixel, we from its corner.
        matrix = self.affine(size)
        matrix[:, 2] += matrix[:, :2] @ np.full(2, 0.5) - 0.5
        return cv2.warpAffine(image, matrix, (size, size), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)


def square_of(hip: Array, top: Array) -> Square:
    """The square around a person.

    Args:
        hip: ``(2,)`` middle of the hips.
        top: ``(2,)`` where the circle around the whole person, centred at the hips, is met in the trunk's direction.
    """
    x, y = top - hip
    return Square(float(hip[0]), float(hip[1]), 2 * MARGIN * float(np.hypot(x, y)), float(np.arctan2(x, -y)))
