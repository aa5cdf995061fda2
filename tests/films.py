"""Small videos."""

from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np


def write_video(path: Path, images: Iterable[np.ndarray], rate: float = 10.0) -> Path:
    """Of images ``(height, width, 3)``, blue green red, in the format of the suffix (.mp4, .avi)."""
    first, *others = images
    code = cv2.VideoWriter.fourcc(*("mp4v" if path.suffix == ".mp4" else "MJPG"))
    writer = cv2.VideoWriter(str(path), code, rate, first.shape[1::-1])
    for image in (first, *others):
        writer.write(image)
    writer.release()
    return path
