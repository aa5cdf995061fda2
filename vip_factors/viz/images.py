"""Images: frames of a video wherever they are stored, 2D poses drawn over them, and bytes of image files."""

from collections.abc import Iterator, Sequence

import cv2
import numpy as np

from vip_factors.body.keypoints import LIMBS, KeypointSet
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.scene import Video
from vip_factors.viz.colours import wearer_colour

# Where a set has a neck, the head hangs on it; otherwise it would float above the shoulders.
_MORE = (("neck", "nose"), ("neck", "head_top"))


def limb_pairs(keypoints: KeypointSet) -> np.ndarray:
    """Indices ``(L, 2)`` of the keypoints to join by lines."""
    names = keypoints.keypoints
    found = [[names.index(a), names.index(b)] for a, b in (*LIMBS, *_MORE) if a in names and b in names]
    return np.array(found, dtype=int).reshape(-1, 2)


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


def video_stream(video: Video | None, wanted: Sequence[int]) -> Iterator[np.ndarray | None]:
    """One by one, increasing, images ``(height, width, 3)``, blue green red; None for one that cannot be decoded.

    Files are read on from frame to frame: seeking is not exact in every container.
    """
    reader, at = None, 0
    if video is not None and video.path is not None and video.path.is_file():
        reader = cv2.VideoCapture(str(video.path))
    try:
        for index in wanted:
            image = None
            if video is not None and index in video.images:
                image = cv2.imdecode(np.frombuffer(video.images[index], np.uint8), cv2.IMREAD_COLOR)
            elif reader is not None:
                while at < index and reader.grab():
                    at += 1
                good, image = reader.read() if at == index else (False, None)
                at += int(good)
            yield image
    finally:
        if reader is not None:
            reader.release()


def png_bytes(image: np.ndarray) -> bytes:
    """An image ``(height, width, 3)``, blue green red, as PNG: for drawings."""
    return bytes(cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 6])[1].tobytes())


def jpeg_bytes(image: np.ndarray, quality: int = 82) -> bytes:
    """The same as JPEG: for photographs."""
    return bytes(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes())
