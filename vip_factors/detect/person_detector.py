"""BlazePose's person detector: where in an image people are, how large and how upright.

It was trained on faces and on the circle around a whole person whose centre is the middle of the hips. Decoding follows
MediaPipe's published description of its graph.
"""

from dataclasses import dataclass

import numpy as np

from vip_factors.detect.anchors import INPUT, anchor_centres
from vip_factors.detect.interpreter import Model
from vip_factors.detect.square import Square, square_of
from vip_factors.geometry.rotations import Array

HIP, TOP = slice(4, 6), slice(6, 8)  # of a row: after the box come four points, these two of the whole body


@dataclass(frozen=True)
class FoundPerson:
    """A person's square, in pixels of the image, and how sure the detector is, in (0, 1)."""

    square: Square
    score: float


class PersonDetector:
    """Finds people in a square part of an image.

    Args:
        model: takes ``(1, 224, 224, 3)`` in [−1, 1] and gives ``(1, 2254, 12)`` and ``(1, 2254, 1)``.
        least_score: people that it is less sure of are left out.
        overlap: of boxes that show one person (intersection over union).
    """

    def __init__(self, model: Model, least_score: float, overlap: float) -> None:
        self._model, self._least_score, self._overlap = model, least_score, overlap
        self._anchors = anchor_centres()

    def find(self, image: np.ndarray, part: Square) -> list[FoundPerson]:
        """People in an upright square part of an image ``(height, width, 3)``, red first, bytes; best first."""
        given = _shrunk(image, part).astype(np.float32) / 127.5 - 1
        raw, logit = self._model(given[None])
        rows, score = decoded(raw, logit, self._anchors)
        sure = score >= self._least_score
        found = []
        for row, best in merged(rows[sure], score[sure], self._overlap):
            hip, top = (part.to_image(row[one], 1) for one in (HIP, TOP))
            found.append(FoundPerson(square_of(hip, top), best))
        return [one for one in found if one.square.side > 0]


def _shrunk(image: np.ndarray, part: Square) -> np.ndarray:
    """The part as the detector's input; black beyond the image. Averaged, so that small people do not fall between."""
    import cv2

    side = max(1, round(part.side))
    left, upper = round(part.x - side / 2), round(part.y - side / 2)
    height, width = image.shape[:2]
    inside = image[max(upper, 0) : upper + side, max(left, 0) : left + side]
    over = (max(-upper, 0), max(upper + side - height, 0), max(-left, 0), max(left + side - width, 0))
    if any(over):
        inside = cv2.copyMakeBorder(inside, *over, cv2.BORDER_CONSTANT)
    return cv2.resize(inside, (INPUT, INPUT), interpolation=cv2.INTER_AREA)


def decoded(raw: np.ndarray, logit: np.ndarray, anchors: Array) -> tuple[Array, Array]:
    """Rows ``(A, 12)`` in fractions of the part, and scores ``(A,)``.

    A row is a box (centre x, y, width, height) and four points: middle of the hips, where the circle around the whole
    body is met, middle of the shoulders, where that around the upper body is met.
    """
    rows = raw[0].astype(float) / INPUT
    rows[:, 0:2] += anchors
    rows[:, 4:] += np.tile(anchors, 4)
    return rows, 1 / (1 + np.exp(-np.clip(logit[0, :, 0].astype(float), -100, 100)))


def merged(rows: Array, score: Array, overlap: float) -> list[tuple[Array, float]]:
    """Weighted suppression of what is found twice: overlapping rows become their mean, weighed by score; best first."""
    left = np.argsort(-score, kind="stable")
    found = []
    while len(left):
        same = intersection_over_union(rows[left[0]], rows[left]) > overlap
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
