"""BlazePose's landmark model: 33 points of the person in a square, and the square to look at next.

Decoding follows MediaPipe's published description of its graph: landmarks are refined by the heat maps around them, two
auxiliary ones tell the next square.
"""

from dataclasses import dataclass

import numpy as np

from vip_factors.detect.interpreter import Model
from vip_factors.detect.square import Square, square_of
from vip_factors.geometry.rotations import Array

INPUT = 256  # pixels, both ways
BODY = 33  # landmarks of the body, before the auxiliary ones
HIP, TOP = 33, 34  # auxiliary: middle of the hips, and where the circle around the person is met
WINDOW = 3  # cells of the heat map to each side of a landmark that refine it
SURE_CELL = 0.5  # of a heat map: less does not move a landmark


@dataclass(frozen=True)
class PersonLandmarks:
    """What the landmark model says of one square.

    Attributes:
        pixels: ``(33, 2)`` in the image, also beyond its border.
        confidence: ``(33,)`` in [0, 1]: that the point is within the square and not hidden.
        presence: in [0, 1], that there is a person at all.
        square: that was looked at.
        following: the square to look at in the next frame.
    """

    pixels: Array
    confidence: Array
    presence: float
    square: Square
    following: Square


class LandmarkModel:
    """Finds landmarks of the one person in a square.

    Args:
        model: takes ``(1, 256, 256, 3)`` in [0, 1]; outputs are told by their sizes.
    """

    def __init__(self, model: Model) -> None:
        self._model = model

    def look(self, image: np.ndarray, square: Square) -> PersonLandmarks:
        """Landmarks of the person in a square of an image ``(height, width, 3)``, red first, bytes."""
        outputs = self._model(square.crop(image, INPUT)[None].astype(np.float32) / 255)
        points = next(one for one in outputs if one.size == 39 * 5).reshape(39, 5).astype(float)
        presence = float(next(one for one in outputs if one.size == 1).ravel()[0])
        heat = next((one[0] for one in outputs if one.ndim == 4 and one.shape[3] == 39), None)
        place = points[:, :2] if heat is None else refined(points[:, :2], heat)
        pixels = square.to_image(place, INPUT)
        shown, present = (_sigmoid(points[:BODY, column]) for column in (3, 4))
        return PersonLandmarks(pixels[:BODY], shown * present, presence, square, square_of(pixels[HIP], pixels[TOP]))


def refined(points: Array, heat: np.ndarray) -> Array:
    """Landmarks ``(39, 2)``, in pixels of the crop, moved to the centre of the heat ``(64, 64, 39)`` around them."""
    rows, columns = heat.shape[:2]
    cell = np.floor(points * np.array([columns, rows]) / INPUT).astype(int)
    offset = np.arange(-WINDOW, WINDOW + 1)
    x, y = cell[:, 0, None, None] + offset[None, None, :], cell[:, 1, None, None] + offset[None, :, None]
    inside = (x >= 0) & (x < columns) & (y >= 0) & (y < rows)
    which = np.arange(len(points))[:, None, None]
    warm = _sigmoid(heat[np.clip(y, 0, rows - 1), np.clip(x, 0, columns - 1), which].astype(float)) * inside
    total, hottest = warm.sum(axis=(1, 2)), warm.max(axis=(1, 2))
    mean = np.stack([(warm * x).sum(axis=(1, 2)), (warm * y).sum(axis=(1, 2))], axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        moved = mean / total[:, None] * INPUT / np.array([columns, rows])
    in_map = np.all((cell >= 0) & (cell < [columns, rows]), axis=1)
    return np.where((in_map & (hottest >= SURE_CELL) & (total > 0))[:, None], moved, points)


def _sigmoid(values: Array) -> Array:
    return 1 / (1 + np.exp(-np.clip(values, -50, 50)))
