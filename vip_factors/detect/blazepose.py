"""BlazePose's two models: a person detector over an image, and 33 landmarks of the person in a square.

The detector was trained on faces and on the circle around a whole person, centred at the middle of the hips. Its
outputs are relative to anchors in MediaPipe's published layout: an image of 224 pixels, layers of stride 8, 16 and
three times 32, two anchors a cell and layer, all of size one. Decoding follows MediaPipe's published graph: landmarks
are refined by the heat maps around them, and two auxiliary ones determine the next square.
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

MARGIN = 1.25  # MediaPipe's ratio of the square to the circle around the person


@dataclass(frozen=True)
class Square:
    """Square with its centre and side in pixels, and its clockwise rotation in the image in radians.

    Frames: ``crop`` has its origin in the square's upper left corner, ``image`` in the image's.
    """

    x: float
    y: float
    side: float
    angle: float = 0.0

    @property
    def centre(self) -> Array:
        """Centre ``(2,)`` in pixels of the image."""
        return np.array([self.x, self.y])

    def affine(self, size: int) -> Array:
        """Affine map ``(2, 3)`` from pixels of a ``size`` by ``size`` crop to those of the image."""
        cos, sin = np.cos(self.angle), np.sin(self.angle)
        linear = self.side / size * np.array([[cos, -sin], [sin, cos]])
        return np.column_stack([linear, self.centre - linear @ np.full(2, size / 2)])

    def to_image(self, points: Array, size: int) -> Array:
        """Map points ``(..., 2)`` of a ``size`` by ``size`` crop to pixels of the image."""
        matrix = self.affine(size)
        return points @ matrix[:, :2].T + matrix[:, 2]

    def crop(self, image: np.ndarray, size: int) -> np.ndarray:
        """Crop ``(size, size, 3)`` of bytes; black beyond the image."""
        import cv2

        # warpAffine has its origin in the middle of the first pixel, this class in its corner.
        matrix = self.affine(size)
        matrix[:, 2] += matrix[:, :2] @ np.full(2, 0.5) - 0.5
        return cv2.warpAffine(image, matrix, (size, size), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)


def square_of(hip: Array, top: Array) -> Square:
    """The square around a person, from the middle of the hips ``(2,)`` and a point ``(2,)`` of the circle around the
    whole person, in the trunk's direction.
    """
    x, y = top - hip
    return Square(float(hip[0]), float(hip[1]), 2 * MARGIN * float(np.hypot(x, y)), float(np.arctan2(x, -y)))


Model = Callable[[np.ndarray], list[np.ndarray]]
"""A model: its outputs, in the order of the file, for ``(1, height, width, 3)`` floats."""


def check_interpreter() -> None:
    """Check that the library is installed."""
    if find_spec("ai_edge_litert") is None:
        raise InputError("BlazePose needs ai-edge-litert, which is not installed: pip install 'vip-factors[detect]'")


class LiteModel:
    """A ``.tflite`` file run on some threads of the CPU; :class:`FileFormatError` if the file is no such model."""

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

    def __call__(self, image: np.ndarray) -> list[np.ndarray]:
        """Outputs for ``(1, height, width, 3)`` floats."""
        self._interpreter.set_tensor(self._input, image.astype(np.float32, copy=False))
        self._interpreter.invoke()
        return [self._interpreter.get_tensor(output) for output in self._outputs]


@contextmanager
def _silent() -> Iterator[None]:
    """Silence the library, which writes to stderr past Python and its own log settings."""
    stderr, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(stderr, 2)
        os.close(stderr)
        os.close(nowhere)


DETECTOR_INPUT = 224  # pixels, width and height


def anchor_centres() -> Array:
    """Centres ``(2254, 2)`` as fractions of the image, x and y, in the order of the model's outputs.

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
    """A person's square in the image, and the detector's score in (0, 1)."""

    square: Square
    score: float


class PersonDetector:
    """Finds people in a square part of an image.

    The model takes ``(1, 224, 224, 3)`` in [−1, 1] and gives ``(1, 2254, 12)`` and ``(1, 2254, 1)``.
    """

    def __init__(self, model: Model) -> None:
        self._model, self._anchors = model, anchor_centres()

    def find(self, image: np.ndarray, region: Square) -> list[DetectedPerson]:
        """People in an upright square region of an image ``(height, width, 3)``, red first, bytes; best first."""
        least_score = 0.5  # MediaPipe's threshold
        image_input = _shrunk(image, region).astype(np.float32) / 127.5 - 1
        raw, logit = self._model(image_input[None])
        rows, score = decode(raw, logit, self._anchors)
        sure = score >= least_score
        people = []
        # A box, then four points, two of the whole body.
        for row, best_score in merge_overlapping(rows[sure], score[sure]):
            square = square_of(region.to_image(row[4:6], 1), region.to_image(row[6:8], 1))
            people += [DetectedPerson(square, best_score)] if square.side > 0 else []
        return people


def _shrunk(image: np.ndarray, region: Square) -> np.ndarray:
    """Region as the detector's input; black beyond the image. Pixels are averaged, so that small people remain."""
    import cv2

    side = max(1, round(region.side))
    left_edge, upper = round(region.x - side / 2), round(region.y - side / 2)
    height, width = image.shape[:2]
    inside = image[max(upper, 0) : upper + side, max(left_edge, 0) : left_edge + side]
    over = (max(-upper, 0), max(upper + side - height, 0), max(-left_edge, 0), max(left_edge + side - width, 0))
    if any(over):
        inside = cv2.copyMakeBorder(inside, *over, cv2.BORDER_CONSTANT)
    return cv2.resize(inside, (DETECTOR_INPUT, DETECTOR_INPUT), interpolation=cv2.INTER_AREA)


def decode(raw: np.ndarray, logit: np.ndarray, anchors: Array) -> tuple[Array, Array]:
    """Decode rows ``(A, 12)`` in fractions of the region, and scores ``(A,)``.

    A row is a box (centre x, y, width, height) and four points: middle of the hips, a point of the circle around the
    whole body, middle of the shoulders, a point of the circle around the upper body.
    """
    rows = raw[0].astype(float) / DETECTOR_INPUT
    rows[:, 0:2] += anchors
    rows[:, 4:] += np.tile(anchors, 4)
    return rows, 1 / (1 + np.exp(-np.clip(logit[0, :, 0].astype(float), -100, 100)))


def merge_overlapping(rows: Array, score: Array) -> list[tuple[Array, float]]:
    """Non-maximum suppression: overlapping rows are averaged with their scores as weights; by decreasing score."""
    box_overlap = 0.3  # intersection over union of two boxes of one person; MediaPipe's value
    remaining = np.argsort(-score, kind="stable")
    people = []
    while len(remaining):
        best, others = rows[remaining[0]], rows[remaining]
        low = np.maximum(best[:2] - best[2:4] / 2, others[:, :2] - others[:, 2:4] / 2)
        high = np.minimum(best[:2] + best[2:4] / 2, others[:, :2] + others[:, 2:4] / 2)
        common = np.prod(np.clip(high - low, 0, None), axis=1)
        union = np.prod(best[2:4]) + np.prod(others[:, 2:4], axis=1) - common
        same = (union > 0) & (common > box_overlap * union)
        same[0] = True  # of a box without an area as well
        members = remaining[same]
        people.append((np.average(rows[members], axis=0, weights=score[members]), float(score[remaining[0]])))
        remaining = remaining[~same]
    return people


INPUT = 256  # pixels, width and height
BODY = 33  # landmarks of the body, before the auxiliary ones


@dataclass(frozen=True)
class PersonLandmarks:
    """Output of the landmark model for one square.

    Attributes:
        pixels: ``(33, 2)`` in the image, possibly beyond its border.
        confidence: ``(33,)`` in [0, 1], that the point is within the square and not hidden.
        presence: in [0, 1], that there is a person.
        square: the square.
        following: the square for the next frame.
    """

    pixels: Array
    confidence: Array
    presence: float
    square: Square
    following: Square


class LandmarkModel:
    """Finds landmarks of the one person in a square.

    The model takes ``(1, 256, 256, 3)`` in [0, 1]; its outputs are identified by their sizes.
    """

    def __init__(self, model: Model) -> None:
        self._model = model

    def look(self, image: np.ndarray, square: Square) -> PersonLandmarks:
        """Landmarks of the person in a square of an image ``(height, width, 3)``, red first, bytes."""
        hip, top = 33, 34  # auxiliary: middle of the hips, and a point of the circle around the person
        outputs = self._model(square.crop(image, INPUT)[None].astype(np.float32) / 255)
        points = next(output for output in outputs if output.size == 39 * 5).reshape(39, 5).astype(float)
        presence = float(next(output for output in outputs if output.size == 1).ravel()[0])
        heat = next((output[0] for output in outputs if output.ndim == 4 and output.shape[3] == 39), None)
        place = points[:, :2] if heat is None else refine(points[:, :2], heat)
        pixels = square.to_image(place, INPUT)
        shown, present = (_sigmoid(points[:BODY, column]) for column in (3, 4))
        return PersonLandmarks(pixels[:BODY], shown * present, presence, square, square_of(pixels[hip], pixels[top]))


def refine(points: Array, heat: np.ndarray) -> Array:
    """Move landmarks ``(39, 2)``, in pixels of the crop, to the centre of the heat ``(64, 64, 39)`` around them."""
    sure_cell = 0.5  # least heat that moves a landmark
    window = 3  # cells of the heat map to each side of a landmark
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
