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


def draw_pose(
    image: np.ndarray, limbs: np.ndarray, pixels: Array, confidence: Array, index: int, label: str, broad: float = 1.0
) -> None:
    """Draw one person into an image.

    Args:
        image: ``(height, width, 3)``, red first, bytes; it is changed.
        limbs: ``(L, 2)`` which points to join (:func:`limb_pairs`).
        pixels: ``(K, 2)`` in the image.
        confidence: ``(K,)`` in [0, 1].
        index: of the colour: that of the wearer with this index.
        label: written above the person.
        broad: how broad lines are, as a multiple of the usual.
    """
    least_confidence = 0.1  # below it the reconstruction uses no keypoint (reprojection.least_confidence)
    shown = confidence >= least_confidence
    if not np.any(shown):
        return
    colour = wearer_colour(index)
    width = max(1, round(broad * min(image.shape[:2]) / 360))
    sub, shift = 8, 3  # OpenCV draws at eighths of pixels, given as integers
    points = np.round(np.nan_to_num(pixels) * sub).astype(int)
    faint = 0.5  # keypoints of less confidence are drawn hollow, limbs thin
    for a, b in limbs:
        if shown[a] and shown[b]:
            thick = width if min(confidence[a], confidence[b]) >= faint else max(1, width // 2)
            cv2.line(image, points[a].tolist(), points[b].tolist(), colour, thick, cv2.LINE_AA, shift)
    for at in np.flatnonzero(shown):
        filled = -1 if confidence[at] >= faint else 1
        cv2.circle(image, points[at].tolist(), (width + 1) * sub, (255, 255, 255), filled, cv2.LINE_AA, shift)
        cv2.circle(image, points[at].tolist(), width * sub, colour, filled, cv2.LINE_AA, shift)
    _label(image, pixels[shown], label, colour)


def _label(image: np.ndarray, points: Array, label: str, colour: tuple[int, int, int]) -> None:
    size = image.shape[0] / 1000
    x = int(points[:, 0].mean() - 8 * size * len(label))
    y = int(max(points[:, 1].min() - 30 * size, 28 * size))
    thick, off = max(1, round(2 * size)), max(1, round(1.5 * size))
    for right, down in ((-off, -off), (off, -off), (-off, off), (off, off), (0, 0)):  # broader letters would be wider
        ink = colour if not right else (20, 20, 20)
        cv2.putText(image, label, (x + right, y + down), cv2.FONT_HERSHEY_SIMPLEX, size, ink, thick, cv2.LINE_AA)


def frames_left(video: Video | None, count: int) -> np.ndarray:
    """Which of a video's ``count`` frames there are: all of a file, and of one of which no image is left either."""
    if video is None or len(video.images) < 2 or (video.path is not None and video.path.is_file()):
        return np.arange(count)
    return np.array([index for index in sorted(video.images) if index < count], dtype=int)


def video_stream(video: Video | None, wanted: Sequence[int]) -> Iterator[np.ndarray | None]:
    """One by one, increasing, images ``(height, width, 3)``, blue green red; None for one that cannot be decoded.

    Embedded ones if all are there, which is quick, else those of the file: not now one, now the other. Files are read
    on from frame to frame, as seeking is not exact in every container.
    """
    reader, at = None, 0
    whole = video is not None and all(index in video.images for index in wanted)
    if video is not None and video.path is not None and video.path.is_file() and not whole:
        reader = cv2.VideoCapture(str(video.path))
    try:
        for index in wanted:
            image = None
            if reader is not None:
                while at < index and reader.grab():
                    at += 1
                good, image = reader.read() if at == index else (False, None)
                at += int(good)
            elif video is not None and index in video.images:
                image = cv2.imdecode(np.frombuffer(video.images[index], np.uint8), cv2.IMREAD_COLOR)
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
