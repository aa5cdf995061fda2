"""A small TOML file that says what a camera is like, and where it stood over the floor if that is known.

::

    width = 1920
    height = 1080
    fx = 1480.2
    fy = 1479.6
    cx = 961.3
    cy = 538.8
    distortion = [0.05, -0.12, 0.0, 0.0, 0.0]

    [floor]
    R_floor_camera = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
    p_floor_camera = [0, 0, 1.5]

    [calibration]
    rms_px = 0.21

The floor's frame has its z axis up, against gravity; the camera's axes are OpenCV's. The table ``[calibration]`` says
how the numbers were found and is read by people only. OpenCV's own files (``camera_matrix``) are read too, and of
Pose2Sim's calibration, a table for each camera of a lab, the one that is named after a colon: ``Calib.toml:cam_01``.
"""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vip_factors.atomic import atomic_open
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import Array, exp, nearest_rotation
from vip_factors.io.toml_values import (
    known_keys,
    nearest,
    number_at,
    numbers_at,
    read_text,
    read_toml,
    table_at,
    toml_text,
)
from vip_factors.sensors.camera_model import CameraModel

NUMBERS = ("width", "height", "fx", "fy", "cx", "cy")
KNOWN = (*NUMBERS, "distortion", "floor", "calibration")
FLOOR = ("R_floor_camera", "p_floor_camera")
POSE2SIM = ("size", "matrix", "distortions", "rotation", "translation")
ROTATION_TOLERANCE = 1e-2  # of RᵀR from the identity: numbers rounded by hand to two places still pass
OPENCV_SUFFIXES = (".yaml", ".yml", ".xml", ".json")
MATRIX = ("camera_matrix", "Camera_Matrix", "cameraMatrix", "mtx", "K")
DISTORTION = ("dist_coeffs", "distortion_coefficients", "Distortion_Coefficients", "distCoeffs", "dist", "D")
WIDTH, HEIGHT = ("image_width", "image_Width", "width"), ("image_height", "image_Height", "height")
SIZE = ("image_size", "img_size", "imageSize")  # width, height
USED_COEFFICIENTS = 8  # beyond them OpenCV has thin prisms and tilted sensors
FARTHEST_PIXEL = 1e6  # a million pixels wide is no image


def read_camera_file(path: str | Path) -> CameraModel:
    """Intrinsics from a camera file: TOML, one of OpenCV's by its suffix (.yaml, .yml, .xml, .json), or Pose2Sim's.

    Raises:
        FileFormatError: if it cannot be read or parsed.
        InputError: for a field that is missing, unknown or of the wrong kind; the file and the field are named.
    """
    path = Path(path)
    if path.suffix.lower() in OPENCV_SUFFIXES:
        return _opencv_model(path)
    path, content, name = _toml(path)
    if name is not None:
        table = _pose2sim(path, content, name)
        size, K = numbers_at(path, f"{name}.size", table["size"], 2), _matrix(path, f"{name}.matrix", table["matrix"])
        return _model(f"{path}: {name}", size, K, numbers_at(path, f"{name}.distortions", table["distortions"]))
    for key in NUMBERS:
        if key not in content:
            raise InputError(f"{path}: {key} is missing: expected {', '.join(NUMBERS)}, in pixels")
    width, height, fx, fy, cx, cy = (number_at(path, key, content[key]) for key in NUMBERS)
    for key, value in (("width", width), ("height", height)):
        if value != round(value) or value <= 0:
            raise InputError(f"{path}: {key} is {content[key]!r}: expected a whole number of pixels")
    K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    distortion = numbers_at(path, "distortion", content.get("distortion", []))
    return _model(str(path), np.array([width, height]), K, distortion)


def read_floor(path: str | Path) -> tuple[Array, Array] | None:
    """The camera's pose over the floor: ``R_floor_camera (3, 3)`` and ``p_floor_camera (3,)`` metres, None if unknown.

    Raises:
        FileFormatError: if the file cannot be read or parsed.
        InputError: if the table ``[floor]`` holds no pose.
    """
    path = Path(path)
    if path.suffix.lower() in OPENCV_SUFFIXES:
        return None
    path, content, name = _toml(path)
    if name is not None:
        table = _pose2sim(path, content, name)
        R_camera_floor = exp(numbers_at(path, f"{name}.rotation", table["rotation"], 3))
        t = numbers_at(path, f"{name}.translation", table["translation"], 3)
        return R_camera_floor.T, -R_camera_floor.T @ t
    floor = content.get("floor")
    if floor is None:
        return None
    if not isinstance(floor, Mapping) or any(key not in floor for key in FLOOR):
        raise InputError(f"{path}: [floor] is incomplete: expected a table with {' and '.join(FLOOR)}")
    known_keys(path, "floor", floor, FLOOR)
    R = _matrix(path, "floor.R_floor_camera", floor["R_floor_camera"])
    if np.abs(R.T @ R - np.eye(3)).max() > ROTATION_TOLERANCE or np.linalg.det(R) < 0:
        raise InputError(f"{path}: floor.R_floor_camera is not a rotation matrix")
    return nearest_rotation(R), numbers_at(path, "floor.p_floor_camera", floor["p_floor_camera"], 3)


def write_camera_file(
    path: str | Path,
    model: CameraModel,
    floor: tuple[Array, Array] | None = None,
    calibration: Mapping[str, str | float | int] | None = None,
    overwrite: bool = False,
) -> None:
    """Write a camera file, whole or not at all.

    Args:
        path: of the file, usually ``.toml``.
        model: the intrinsics.
        floor: ``R_floor_camera (3, 3)`` and ``p_floor_camera (3,)`` metres, if known.
        calibration: how the numbers were found: for people.
        overwrite: whether an existing file may be replaced.

    Raises:
        InputError: if the file exists, or its folder is missing or read-only.
    """
    if Path(path).suffix.lower() in OPENCV_SUFFIXES:
        raise InputError(f"{path}: expected a name that ends in .toml; OpenCV's files are only read")
    numbers = (model.width, model.height, *model.focal, *model.centre)
    lines = [f"{name} = {value}" for name, value in zip(NUMBERS, map(toml_text, numbers), strict=True)]
    lines.append(f"distortion = {toml_text(model.distortion)}")
    if floor is not None:
        lines += ["", "[floor]", *(f"{name} = {toml_text(value)}" for name, value in zip(FLOOR, floor, strict=True))]
    if calibration:
        lines += ["", "[calibration]", *(f"{name} = {toml_text(value)}" for name, value in calibration.items())]
    with atomic_open(path, "w", overwrite) as file:
        file.write("\n".join(lines) + "\n")


def _toml(path: Path) -> tuple[Path, Mapping[str, Any], str | None]:
    """The file, its content, and the name of the camera in it if it is one of Pose2Sim's."""
    name: str | None = None
    if not path.is_file() and ":" in path.name:
        stem, _, name = path.name.rpartition(":")
        path = path.with_name(stem)
    content = read_toml(path, "a camera file (TOML with fx, fy, cx, cy …)")
    cameras = [key for key, table in content.items() if isinstance(table, Mapping) and "matrix" in table]
    if not cameras:
        if name is not None:
            raise InputError(f"{path} holds a single camera: leave out ':{name}'")
        known_keys(path, "", content, KNOWN)
        return path, content, None
    if name is None and len(cameras) > 1:
        raise InputError(
            f"{path}: holds the cameras {', '.join(cameras)}: name the one you mean, such as {path}:{cameras[0]}"
        )
    if name is not None and name not in cameras:
        raise InputError(f"{path}: no camera '{name}'{nearest(name, cameras)}")
    return path, content, name or cameras[0]


def _pose2sim(path: Path, content: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """The table of a camera of Pose2Sim's, which holds all that it needs.

    That is ``size``, ``matrix``, ``distortions`` (OpenCV's), and ``rotation`` (a rotation vector) and ``translation``
    (metres), which take points from the world, whose z is up and whose floor is at 0, to the camera.
    """
    table = table_at(path, name, content[name])
    for key in POSE2SIM:
        if key not in table:
            raise InputError(f"{path}: {name}.{key} is missing: expected {', '.join(POSE2SIM)}")
    if table.get("fisheye"):
        raise InputError(f"{path}: {name} is a fisheye camera: expected one whose distortion is OpenCV's usual")
    return table


def _matrix(path: Path, where: str, rows: Any) -> Array:
    if not isinstance(rows, list) or len(rows) != 3:
        raise InputError(f"{path}: {where} is {rows!r}: expected three rows of three numbers")
    return np.stack([numbers_at(path, where, row, 3) for row in rows])


def _model(where: str, size: Array, K: Array, distortion: Array) -> CameraModel:
    focal, centre = (float(K[0, 0]), float(K[1, 1])), (float(K[0, 2]), float(K[1, 2]))
    try:
        return CameraModel(round(size[0]), round(size[1]), focal, centre, tuple(distortion.tolist()))
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


def _opencv_model(path: Path) -> CameraModel:
    """Intrinsics as OpenCV's and ROS's programs write them: a ``camera_matrix`` and, if there, ``dist_coeffs``."""
    text = read_text(path, "a camera file (TOML, or OpenCV's YAML)", strict=True)
    numbers = _json_numbers(path, text) if path.suffix.lower() == ".json" else _storage_numbers(path, text)
    K, distortion, size, width, height = (numbers(names) for names in (MATRIX, DISTORTION, SIZE, WIDTH, HEIGHT))
    if K is None or K.size != 9:
        raise InputError(
            f"{path}: there is no camera_matrix of three by three numbers: expected fx 0 cx, 0 fy cy, 0 0 1"
        )
    if width is not None and height is not None and width.size and height.size:
        size = np.array([width.ravel()[0], height.ravel()[0]])
    if size is None or size.size != 2:
        raise InputError(f"{path}: the image's size is missing: expected image_width and image_height, in pixels")
    size = size.ravel()
    if not np.all((size > 0) & (size < FARTHEST_PIXEL)):
        raise InputError(f"{path}: the image is {size[0]:g} by {size[1]:g} pixels: expected numbers above zero")
    bent = np.zeros(0) if distortion is None else distortion.ravel()
    if np.any(bent[USED_COEFFICIENTS:]):
        raise InputError(f"{path}: {len(bent)} distortion coefficients: expected at most eight that are not zero")
    return _model(str(path), np.floor(size), K.reshape(3, 3), bent[:USED_COEFFICIENTS])


Numbers = Callable[[tuple[str, ...]], Array | None]
"""The numbers under the first of some names that is there."""


def _json_numbers(path: Path, text: str) -> Numbers:
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise FileFormatError(f"{path}: {error}: expected JSON syntax") from error
    if not isinstance(content, Mapping):
        raise FileFormatError(f"{path}: expected a JSON object with camera_matrix")
    inner = content.get("opencv_storage", content)
    content = inner if isinstance(inner, Mapping) else content

    def numbers(names: tuple[str, ...]) -> Array | None:
        value: Any = next((content[name] for name in names if name in content), None)
        value = value.get("data") if isinstance(value, Mapping) else value
        try:
            return None if value is None else np.array(value, dtype=float)
        except (TypeError, ValueError, OverflowError) as error:
            raise InputError(f"{path}: {names[0]} is {value!r}: expected numbers") from error

    return numbers


def _storage_numbers(path: Path, text: str) -> Numbers:
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
        try:
            for node in map(storage.getNode, names):
                data = node.getNode("data") if node.isMap() else node
                if data.isSeq() and (data.size() or not node.isMap()):
                    return np.array([data.at(index).real() for index in range(data.size())])
                if data.isReal() or data.isInt():
                    return np.array([data.real()])
        except cv2.error as error:
            raise FileFormatError(f"{path}: OpenCV finds a text or a list where camera_matrix should be") from error
        return None

    return numbers
