"""Camera intrinsics as OpenCV's and ROS's calibration programs write them: YAML, XML or JSON with ``camera_matrix``."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.camera_model import CameraModel

OPENCV_SUFFIXES = (".yaml", ".yml", ".xml", ".json")
MATRIX = ("camera_matrix", "Camera_Matrix", "cameraMatrix", "mtx", "K")
DISTORTION = ("dist_coeffs", "distortion_coefficients", "Distortion_Coefficients", "distCoeffs", "dist", "D")
WIDTH, HEIGHT = ("image_width", "image_Width", "width"), ("image_height", "image_Height", "height")
SIZE = ("image_size", "img_size", "imageSize")  # width, height
USED_COEFFICIENTS = 8  # beyond them OpenCV has thin prisms and tilted sensors
FARTHEST_PIXEL = 1e6  # a million pixels wide is no image


def read_opencv_camera(path: Path) -> CameraModel:
    """Intrinsics from a file with a ``camera_matrix`` and, if there, ``dist_coeffs``.

    Raises:
        FileFormatError: if it cannot be read or parsed.
        InputError: if the matrix or the image's size is missing or of the wrong shape.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read ({error.strerror}): expected a camera file") from error
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{path}: {error}: expected a camera file (TOML, or OpenCV's YAML)") from error
    found = _from_json(path, text) if path.suffix.lower() == ".json" else _from_storage(path, text)
    K = found.get("matrix")
    if K is None or K.size != 9:
        raise InputError(
            f"{path}: there is no camera_matrix of three by three numbers: expected fx 0 cx, 0 fy cy, 0 0 1"
        )
    size = found.get("size")
    if size is None or size.size != 2:
        raise InputError(f"{path}: the image's size is missing: expected image_width and image_height, in pixels")
    K, (width, height) = K.reshape(3, 3), size.ravel()
    if not (0 < width < FARTHEST_PIXEL and 0 < height < FARTHEST_PIXEL):
        raise InputError(f"{path}: the image is {width:g} by {height:g} pixels: expected numbers above zero")
    bent = found.get("distortion", np.zeros(0)).ravel()
    if np.any(bent[USED_COEFFICIENTS:]):
        raise InputError(f"{path}: {len(bent)} distortion coefficients: expected at most eight that are not zero")
    bent = bent[:USED_COEFFICIENTS]
    try:
        focal, centre = (float(K[0, 0]), float(K[1, 1])), (float(K[0, 2]), float(K[1, 2]))
        return CameraModel(int(width), int(height), focal, centre, tuple(float(one) for one in bent))
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _from_json(path: Path, text: str) -> dict[str, Array]:
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise FileFormatError(f"{path}: {error}: expected JSON syntax") from error
    if not isinstance(content, Mapping):
        raise FileFormatError(f"{path}: expected a JSON object with camera_matrix")
    if isinstance(content.get("opencv_storage"), Mapping):
        content = content["opencv_storage"]

    def numbers(names: tuple[str, ...]) -> Array | None:
        value: Any = next((content[name] for name in names if name in content), None)
        value = value.get("data") if isinstance(value, Mapping) else value
        if value is None:
            return None
        try:
            return np.array(value, dtype=float)
        except (TypeError, ValueError, OverflowError) as error:
            raise InputError(f"{path}: {names[0]} is {value!r}: expected numbers") from error

    return _gathered(numbers)


def _from_storage(path: Path, text: str) -> dict[str, Array]:
    import cv2

    if path.suffix.lower() != ".xml" and not text.lstrip().startswith("%YAML"):
        text = "%YAML:1.0\n---\n" + text.replace("---\n", "", 1)  # ROS writes no header, and OpenCV insists on one
    try:
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
    except (cv2.error, SystemError) as error:
        raise FileFormatError(
            f"{path}: OpenCV cannot parse it: expected a YAML or XML file with camera_matrix"
        ) from error

    def numbers(names: tuple[str, ...]) -> Array | None:
        for name in names:
            node = storage.getNode(name)
            if node.isMap() and not node.getNode("data").empty():
                data = node.getNode("data")
                return np.array([data.at(index).real() for index in range(data.size())])
            if node.isSeq():
                return np.array([node.at(index).real() for index in range(node.size())])
            if node.isReal() or node.isInt():
                return np.array([node.real()])
        return None

    try:
        return _gathered(numbers)
    except cv2.error as error:
        raise FileFormatError(f"{path}: OpenCV finds a text or a list where camera_matrix should be") from error
    finally:
        storage.release()


def _gathered(numbers: Any) -> dict[str, Array]:
    """Matrix, distortion and size, as far as ``numbers(names)`` finds them."""
    found = {"matrix": numbers(MATRIX), "distortion": numbers(DISTORTION), "size": numbers(SIZE)}
    width, height = numbers(WIDTH), numbers(HEIGHT)
    if width is not None and height is not None and width.size and height.size:
        found["size"] = np.array([width.ravel()[0], height.ravel()[0]])
    return {name: value for name, value in found.items() if value is not None}
