"""BlazePose's two models: a person detector over an image, and 33 landmarks of the person in a square.

The detector was trained on faces and on the circle around a whole person whose centre is the middle of the hips. Its
answers are counted from anchors in MediaPipe's published layout: an image of 224 pixels, layers of stride 8, 16 and
three times 32, two anchors a cell and layer, all of size one. Decoding follows MediaPipe's published description of its
graph: landmarks are refined by the heat maps around them, two auxiliary ones tell the next square.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from vip_factors.errors import FileFormatError, InputError
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


Model = Callable[[np.ndarray], list[np.ndarray]]
"""A model: its outputs, in the order of the file, for ``(1, height, width, 3)`` floats."""


def check_interpreter() -> None:
    """Make sure that the library is installed, before models are fetched for it."""
    if find_spec("ai_edge_litert") is None:
        raise InputError("BlazePose needs ai-edge-litert, which is not installed: pip install 'vip-factors[detect]'")


class LiteModel:
    """A ``.tflite`` file, run on some threads of the CPU; a :class:`FileFormatError` if the file is no such model."""

    def __init__(self, path: Path, threads: int) -> None:
        from ai_edge_litert.interpreter import Interpreter

        try:
            with _silent():
                self._interpreter = Interpreter(model_path=str(path), num_threads=threads)
                self._interpreter.allocate_tensors()
        except (ValueError, RuntimeError) as error:
            raise FileFormatError(f"{path}: expected a TensorFlow Lite model ({error})") from error
        self._input = self._interpreter.get_input_details()[0]["index"]
        self._outputs = [output["index"] for output in self._interpreter.get_output_details()]

    def __call__(self, given: np.ndarray) -> list[np.ndarray]:
        """Outputs for ``(1, height, width, 3)`` floats."""
        self._interpreter.set_tensor(self._input, given.astype(np.float32, copy=False))
        self._interpreter.invoke()
        return [self._interpreter.get_tensor(output) for output in self._outputs]


@contextmanager
def _silent() -> Iterator[None]:
    """The library says on stderr which delegate it made, past Python and whatever is asked of its log."""
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


DETECTOR_INPUT = 224  # pixels, both ways


def anchor_centres() -> Array:
    """Centres ``(2254, 2)`` as fractions of the image, x and y, in the order of the model's answers.

    Layers of the same stride follow one another within a cell.
    """
    per_cell = 2  # of each layer
    strides = (8, 16, 32, 32, 32)
    centres = []
    for stride in dict.fromkeys(strides):
        cells = -(-DETECTOR_INPUT // stride)
        row, column = np.divmod(np.arange(cells * cells), cells)
        cell = np.column_stack([column + 0.5, row + 0.5]) / cells
        centres.append(np.repeat(cell, per_cell * strides.count(stride), axis=0))
    return np.concatenate(centres)


@dataclass(frozen=True)
class DetectedPerson:
    """A person's square, in pixels of the image, and how sure the detector is, in (0, 1)."""

    square: Square
    score: float


class PersonDetector:
    """Finds people in a square part of an image.

    Args:
        model: takes ``(1, 224, 224, 3)`` in [−1, 1] and gives ``(1, 2254, 12)`` and ``(1, 2254, 1)``.
    """

    def __init__(self, model: Model) -> None:
        self._model, self._anchors = model, anchor_centres()

    def find(self, image: np.ndarray, region: Square) -> list[DetectedPerson]:
        """People in an upright square part of an image ``(height, width, 3)``, red first, bytes; best first."""
        least_score = 0.5  # MediaPipe's own, for the landmark model to look at somebody
        given = _shrunk(image, region).astype(np.float32) / 127.5 - 1
        raw, logit = self._model(given[None])
        rows, score = decoded(raw, logit, self._anchors)
        sure = score >= least_score
        people = []
        for row, best in merged(rows[sure], score[sure]):  # after the box come four points, two of the whole body
            square = square_of(region.to_image(row[4:6], 1), region.to_image(row[6:8], 1))
            people += [DetectedPerson(square, best)] if square.side > 0 else []
        return people


def _shrunk(image: np.ndarray, region: Square) -> np.ndarray:
    """A region as the detector's input; black beyond the image. Averaged, so that small people do not fall between."""
    import cv2

    side = max(1, round(region.side))
    left, upper = round(region.x - side / 2), round(region.y - side / 2)
    height, width = image.shape[:2]
    inside = image[max(upper, 0) : upper + side, max(left, 0) : left + side]
    over = (max(-upper, 0), max(upper + side - height, 0), max(-left, 0), max(left + side - width, 0))
    if any(over):
        inside = cv2.copyMakeBorder(inside, *over, cv2.BORDER_CONSTANT)
    return cv2.resize(inside, (DETECTOR_INPUT, DETECTOR_INPUT), interpolation=cv2.INTER_AREA)


def decoded(raw: np.ndarray, logit: np.ndarray, anchors: Array) -> tuple[Array, Array]:
    """Rows ``(A, 12)`` in fractions of the part, and scores ``(A,)``.

    A row is a box (centre x, y, width, height) and four points: middle of the hips, where the circle around the whole
    body is met, middle of the shoulders, where that around the upper body is met.
    """
    rows = raw[0].astype(float) / DETECTOR_INPUT
    rows[:, 0:2] += anchors
    rows[:, 4:] += np.tile(anchors, 4)
    return rows, 1 / (1 + np.exp(-np.clip(logit[0, :, 0].astype(float), -100, 100)))


def merged(rows: Array, score: Array) -> list[tuple[Array, float]]:
    """Weighted suppression of what is found twice: overlapping rows become their mean, weighed by score; best first."""
    box_overlap = 0.3  # MediaPipe's own: intersection over union of two boxes of one person
    left = np.argsort(-score, kind="stable")
    found = []
    while len(left):
        same = intersection_over_union(rows[left[0]], rows[left]) > box_overlap
        same[0] = True  # of a box without an area, too
        members = left[same]
        found.append((np.average(rows[members], axis=0, weights=score[members]), float(score[left[0]])))
        left = left[~same]
    return found


def intersection_over_union(row: Array, rows: Array) -> Array:
    """``(N,)`` of the box of one row with those of ``(N, 12)``."""
    low = np.maximum(row[:2] - row[2:4] / 2, rows[:, :2] - rows[:, 2:4] / 2)
    high = np.minimum(row[:2] + row[2:4] / 2, rows[:, :2] + rows[:, 2:4] / 2)
    common = np.prod(np.clip(high - low, 0, None), axis=1)
    union = np.prod(row[2:4]) + np.prod(rows[:, 2:4], axis=1) - common
    return np.divide(common, union, out=np.zeros(len(rows)), where=union > 0)


INPUT = 256  # pixels, both ways
BODY = 33  # landmarks of the body, before the auxiliary ones


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
        hip, top = 33, 34  # auxiliary: middle of the hips, and where the circle around the person is met
        outputs = self._model(square.crop(image, INPUT)[None].astype(np.float32) / 255)
        points = next(one for one in outputs if one.size == 39 * 5).reshape(39, 5).astype(float)
        presence = float(next(one for one in outputs if one.size == 1).ravel()[0])
        heat = next((one[0] for one in outputs if one.ndim == 4 and one.shape[3] == 39), None)
        place = points[:, :2] if heat is None else refined(points[:, :2], heat)
        pixels = square.to_image(place, INPUT)
        shown, present = (_sigmoid(points[:BODY, column]) for column in (3, 4))
        return PersonLandmarks(pixels[:BODY], shown * present, presence, square, square_of(pixels[hip], pixels[top]))


def refined(points: Array, heat: np.ndarray) -> Array:
    """Landmarks ``(39, 2)``, in pixels of the crop, moved to the centre of the heat ``(64, 64, 39)`` around them."""
    sure_cell = 0.5  # of a heat map: less does not move a landmark
    window = 3  # cells of the heat map to each side of a landmark that refine it
    rows, columns = heat.shape[:2]
    cell = np.floor(points * np.array([columns, rows]) / INPUT).astype(int)
    offset = np.arange(-window, window + 1)
    x, y = cell[:, 0, None, None] + offset[None, None, :], cell[:, 1, None, None] + offset[None, :, None]
    inside = (x >= 0) & (x < columns) & (y >= 0) & (y < rows)
    which = np.arange(len(points))[:, None, None]
    warm = _sigmoid(heat[np.clip(y, 0, rows - 1), np.clip(x, 0, columns - 1), which].astype(float)) * inside
    total, hottest = warm.sum(axis=(1, 2)), warm.max(axis=(1, 2))
    mean = np.stack([(warm * x).sum(axis=(1, 2)), (warm * y).sum(axis=(1, 2))], axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        moved = mean / total[:, None] * INPUT / np.array([columns, rows])
    in_map = np.all((cell >= 0) & (cell < [columns, rows]), axis=1)
    return np.where((in_map & (hottest >= sure_cell) & (total > 0))[:, None], moved, points)


def _sigmoid(values: Array) -> Array:
    return 1 / (1 + np.exp(-np.clip(values, -50, 50)))
