"""Images as bytes of a file."""

import cv2
import numpy as np


def png_bytes(image: np.ndarray) -> bytes:
    """An image ``(height, width, 3)``, blue green red, as PNG: for drawings."""
    return bytes(cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 6])[1].tobytes())


def jpeg_bytes(image: np.ndarray, quality: int = 82) -> bytes:
    """The same as JPEG: for photographs."""
    return bytes(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes())
