"""Single frames of a scene's video as pictures, wherever they are stored."""

from collections.abc import Iterable, Iterator, Sequence

import cv2
import numpy as np

from vip_factors.sensors.scene import Video


def video_frames(video: Video | None, wanted: Iterable[int]) -> dict[int, np.ndarray]:
    """Images ``(height, width, 3)``, blue green red, of those wanted frames that exist and can be decoded."""
    wanted = sorted(set(wanted))
    if video is None:
        return {}
    found = {}
    for index in wanted:
        if index in video.images:
            image = cv2.imdecode(np.frombuffer(video.images[index], np.uint8), cv2.IMREAD_COLOR)
            if image is not None:
                found[index] = image
    if video.path is not None and video.path.is_file() and len(found) < len(wanted):
        found = _from_file(str(video.path), [index for index in wanted if index not in found]) | found
    return found


def video_stream(video: Video | None, wanted: Sequence[int]) -> Iterator[np.ndarray | None]:
    """One by one, increasing, the images of :func:`video_frames`; None for a frame that is not there."""
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


def _from_file(path: str, wanted: list[int]) -> dict[int, np.ndarray]:
    """Read on from frame to frame: seeking is not exact in every container."""
    reader, found, at = cv2.VideoCapture(path), {}, 0
    try:
        for index in wanted:
            while at < index and reader.grab():
                at += 1
            good, image = reader.read()
            if not good:
                break
            found[index], at = image, at + 1
    finally:
        reader.release()
    return found
