"""Grey images out of a video or a folder, evenly spread, one at a time."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vip_factors.errors import FileFormatError, InputError

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
BLIND_STEP = 8  # frames, where a video does not say how many it has: about four looks a second


@dataclass(frozen=True)
class CalibrationImage:
    """One image: its name for people, its number in the video or folder, how much of all is done, grey bytes."""

    name: str
    number: int
    done: float
    grey: np.ndarray


def calibration_images(source: Path, most: int) -> Iterator[CalibrationImage]:
    """At most about ``most`` images of a folder (by name) or a video (in time).

    Raises:
        InputError: if there is no such file, or no image in the folder; or the images differ in size.
        FileFormatError: if a video or an image cannot be read.
    """
    if not source.exists():
        raise InputError(f"{source}: there is no such file or folder: expected a video or a folder of images")
    size = None
    for image in _of_folder(source, most) if source.is_dir() else _of_video(source, most):
        size = size or image.grey.shape
        if image.grey.shape != size:
            (height, width), (h, w) = size, image.grey.shape
            raise InputError(
                f"{source}: image {image.name} has {w} x {h} pixels and those before it {width} x {height}: "
                "expected images of one camera, all of the same size"
            )
        yield image


def one_image(source: Path, number: int) -> CalibrationImage:
    """The image with a number, counted from 0.

    Raises:
        InputError, FileFormatError: as :func:`calibration_images`, and if there are fewer images.
    """
    if source.is_dir():
        files = _files(source)
        if not 0 <= number < len(files):
            raise InputError(f"{source} holds {len(files)} images: there is no image {number}, counted from 0")
        return CalibrationImage(files[number].name, number, 1.0, _grey(files[number]))
    for index, image in enumerate(_of_video(source, most=0)):
        if index == number:
            return image
    raise InputError(f"{source}: there is no frame {number}, counted from 0")


def image_file(path: Path) -> CalibrationImage:
    """A single image.

    Raises:
        InputError, FileFormatError: if there is none, or it cannot be read.
    """
    if not path.is_file():
        raise InputError(f"{path}: there is no such image")
    return CalibrationImage(path.name, 0, 1.0, _grey(path))


def _files(folder: Path) -> list[Path]:
    files = sorted(path for path in folder.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES)
    if not files:
        raise InputError(f"{folder}: there is no image in this folder: expected {', '.join(IMAGE_SUFFIXES)}")
    return files


def _grey(path: Path) -> np.ndarray:
    import cv2

    grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)  # turned as its file asks for, as videos are too
    if grey is None:
        raise FileFormatError(f"{path}: OpenCV cannot read this image")
    return grey


def _of_folder(folder: Path, most: int) -> Iterator[CalibrationImage]:
    files = _files(folder)
    step = -(-len(files) // most)
    for number in range(0, len(files), step):
        yield CalibrationImage(files[number].name, number, number / len(files), _grey(files[number]))


def _of_video(path: Path, most: int) -> Iterator[CalibrationImage]:
    """Every frame if ``most`` is 0."""
    import cv2

    video = cv2.VideoCapture(str(path))
    try:
        if not video.isOpened():
            raise FileFormatError(f"{path}: OpenCV cannot open it: expected a video or a folder of images")
        total = int(video.get(cv2.CAP_PROP_FRAME_COUNT))
        step = 1 if most == 0 else -(-total // most) if total > 0 else BLIND_STEP
        number = 0
        while video.grab():
            if number % step == 0:
                read, frame = video.retrieve()
                if read:
                    grey = frame if frame.ndim == 2 else cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
                    yield CalibrationImage(f"frame {number}", number, number / total if total > 0 else 0.0, grey)
            number += 1
        if number == 0:
            raise FileFormatError(f"{path}: OpenCV finds no frame in it: expected a video or a folder of images")
    finally:
        video.release()
