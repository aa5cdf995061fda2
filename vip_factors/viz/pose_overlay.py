"""2D poses drawn over an image: limbs, keypoints, and the number of each person."""

import cv2
import numpy as np

from vip_factors.body.keypoints import KeypointSet
from vip_factors.geometry.rotations import Array
from vip_factors.viz.image_limbs import limb_pairs
from vip_factors.viz.wearer_colours import wearer_colour

LEAST_CONFIDENCE = 0.1  # below it the reconstruction uses no keypoint (reprojection.least_confidence)
FAINT = 0.5  # keypoints of less confidence are drawn hollow, limbs thin
SUB, SHIFT = 8, 3  # OpenCV draws at eighths of pixels, given as integers


def draw_pose(
    image: np.ndarray, keypoints: KeypointSet, pixels: Array, confidence: Array, index: int, label: str
) -> None:
    """Draw one person into an image.

    Args:
        image: ``(height, width, 3)``, red first, bytes; it is changed.
        keypoints: of the pose.
        pixels: ``(K, 2)`` in the image.
        confidence: ``(K,)`` in [0, 1].
        index: of the colour: that of the wearer with this index.
        label: written above the person.
    """
    shown = confidence >= LEAST_CONFIDENCE
    if not np.any(shown):
        return
    colour = wearer_colour(index)
    width = max(1, round(image.shape[0] / 360))
    points = np.round(np.nan_to_num(pixels) * SUB).astype(int)
    for a, b in limb_pairs(keypoints):
        if shown[a] and shown[b]:
            thick = width if min(confidence[a], confidence[b]) >= FAINT else max(1, width // 2)
            cv2.line(image, points[a].tolist(), points[b].tolist(), colour, thick, cv2.LINE_AA, SHIFT)
    for at in np.flatnonzero(shown):
        filled = -1 if confidence[at] >= FAINT else 1
        cv2.circle(image, points[at].tolist(), (width + 1) * SUB, (255, 255, 255), filled, cv2.LINE_AA, SHIFT)
        cv2.circle(image, points[at].tolist(), width * SUB, colour, filled, cv2.LINE_AA, SHIFT)
    _label(image, pixels[shown], label, colour)


def _label(image: np.ndarray, points: Array, label: str, colour: tuple[int, int, int]) -> None:
    size = image.shape[0] / 1000
    x = int(points[:, 0].mean() - 8 * size * len(label))
    y = int(max(points[:, 1].min() - 30 * size, 28 * size))
    for ink, thick in (((20, 20, 20), 5), (colour, 2)):
        cv2.putText(image, label, (x, y), cv2.FONT_HERSHEY_SIMPLEX, size, ink, max(1, round(thick * size)), cv2.LINE_AA)
