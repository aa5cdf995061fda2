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
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vip_factors.atomic import atomic_open
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import Array, exp, nearest_rotation
from vip_factors.io.toml_values import known_keys, nearest, number_at, numbers_at, read_toml, table_at, toml_text
from vip_factors.sensors.camera_model import CameraModel

NUMBERS = ("width", "height", "fx", "fy", "cx", "cy")
KNOWN = (*NUMBERS, "distortion", "floor", "calibration")
FLOOR = ("R_floor_camera", "p_floor_camera")
ROTATION_TOLERANCE = 1e-2  # of RᵀR from the identity: numbers rounded by hand to two places still pass


def read_camera_file(path: str | Path) -> CameraModel:
    """Intrinsics from a camera file: TOML, one of OpenCV's by its suffix (.yaml, .yml, .xml, .json), or Pose2Sim's.

    Raises:
        FileFormatError: if it cannot be read or parsed.
        InputError: for a field that is missing, unknown or of the wrong kind; the file and the field are named.
    """
    path = Path(path)
    if path.suffix.lower() in OPENCV_SUFFIXES:
        return read_opencv_camera(path)
    if (several := _pose2sim(path)) is not None:
        return several[0]
    content = _content(path)
    for name in NUMBERS:
        if name not in content:
            raise InputError(f"{path}: {name} is missing: expected {', '.join(NUMBERS)}, in pixels")
    width, height = (_whole(path, name, content[name]) for name in ("width", "height"))
    fx, fy, cx, cy = (number_at(path, name, content[name]) for name in ("fx", "fy", "cx", "cy"))
    distortion = content.get("distortion", [])
    if not isinstance(distortion, list):
        raise InputError(f"{path}: distortion is {distortion!r}: expected a list of 0, 4, 5 or 8 numbers, as OpenCV's")
    bent = tuple(number_at(path, "distortion", one) for one in distortion)
    try:
        return CameraModel(width, height, (fx, fy), (cx, cy), bent)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def read_floor(path: str | Path) -> tuple[Array, Array] | None:
    """The camera's pose over the floor: ``R_floor_camera (3, 3)`` and ``p_floor_camera (3,)`` metres, None if unknown.

    Raises:
        FileFormatError: if the file cannot be read or parsed.
        InputError: if the table ``[floor]`` holds no pose.
    """
    path = Path(path)
    if path.suffix.lower() in OPENCV_SUFFIXES:
        return None
    if (several := _pose2sim(path)) is not None:
        return several[1]
    floor = _content(path).get("floor")
    if floor is None:
        return None
    if not isinstance(floor, Mapping) or any(name not in floor for name in FLOOR):
        raise InputError(f"{path}: [floor] is incomplete: expected a table with {' and '.join(FLOOR)}")
    known_keys(path, "floor", floor, FLOOR)
    rows = floor["R_floor_camera"]
    if not isinstance(rows, list) or len(rows) != 3:
        raise InputError(f"{path}: floor.R_floor_camera is {rows!r}: expected three rows of three numbers")
    R = np.stack([_vector(path, "floor.R_floor_camera", row) for row in rows])
    if np.abs(R.T @ R - np.eye(3)).max() > ROTATION_TOLERANCE or np.linalg.det(R) < 0:
        raise InputError(f"{path}: floor.R_floor_camera is not a rotation matrix")
    return nearest_rotation(R), _vector(path, "floor.p_floor_camera", floor["p_floor_camera"])


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


def _pose2sim(path: Path) -> tuple[CameraModel, tuple[Array, Array]] | None:
    """The camera of one of Pose2Sim's files; None of a file of our own."""
    name: str | None = None
    if not path.is_file() and ":" in path.name:
        stem, _, name = path.name.rpartition(":")
        path = path.with_name(stem)
    content = read_toml(path, "a camera file (TOML with fx, fy, cx, cy …)")
    if name is not None and not cameras_in(content):
        raise InputError(f"{path} holds a single camera: leave out ':{name}'")
    return read_pose2sim_camera(path, content, name) if cameras_in(content) else None


def _content(path: Path) -> Mapping[str, Any]:
    content = read_toml(path, "a camera file (TOML with fx, fy, cx, cy …)")
    known_keys(path, "", content, KNOWN)
    return content


def _whole(path: Path, where: str, value: Any) -> int:
    number = number_at(path, where, value)
    if number != round(number) or number <= 0:
        raise InputError(f"{path}: {where} is {value!r}: expected a whole number of pixels")
    return int(number)


def _vector(path: Path, where: str, value: Any) -> Array:
    if not isinstance(value, list) or len(value) != 3:
        raise InputError(f"{path}: {where} holds {value!r}: expected three numbers")
    return np.array([number_at(path, where, one) for one in value])


_NEEDED = ("size", "matrix", "distortions", "rotation", "translation")


def cameras_in(content: Mapping[str, Any]) -> list[str]:
    """Names of the tables that are cameras; none in a camera file of our own."""
    return [name for name, table in content.items() if isinstance(table, Mapping) and "matrix" in table]


def read_pose2sim_camera(
    path: Path, content: Mapping[str, Any], name: str | None
) -> tuple[CameraModel, tuple[Array, Array]]:
    """Intrinsics of a camera, and ``R_floor_camera (3, 3)`` and ``p_floor_camera (3,)`` metres.

    Args:
        path: of the file, for complaints.
        content: of the file.
        name: of the camera's table; may be None if there is but one.

    Raises:
        InputError: if no camera has that name, none is named among several, or a value is missing or wrong.
    """
    cameras = cameras_in(content)
    if name is None and len(cameras) > 1:
        raise InputError(
            f"{path}: holds the cameras {', '.join(cameras)}: name the one you mean, such as {path}:{cameras[0]}"
        )
    name = cameras[0] if name is None else name
    if name not in cameras:
        raise InputError(f"{path}: no camera '{name}'{nearest(name, cameras)}")
    table = table_at(path, name, content[name])
    for key in _NEEDED:
        if key not in table:
            raise InputError(f"{path}: {name}.{key} is missing: expected {', '.join(_NEEDED)}")
    if table.get("fisheye"):
        raise InputError(f"{path}: {name} is a fisheye camera: expected one whose distortion is OpenCV's usual")
    width, height = numbers_at(path, f"{name}.size", table["size"], 2)
    rows = table["matrix"]
    if not isinstance(rows, list) or len(rows) != 3:
        raise InputError(f"{path}: {name}.matrix is {rows!r}: expected three rows of three numbers")
    K = np.stack([numbers_at(path, f"{name}.matrix", row, 3) for row in rows])
    bent = table["distortions"]
    if not isinstance(bent, list):
        raise InputError(f"{path}: {name}.distortions is {bent!r}: expected a list of numbers")
    distortion = tuple(number_at(path, f"{name}.distortions", one) for one in bent)
    focal, centre = (float(K[0, 0]), float(K[1, 1])), (float(K[0, 2]), float(K[1, 2]))
    try:
        model = CameraModel(round(width), round(height), focal, centre, distortion)
    except InputError as error:
        raise InputError(f"{path}: {name}: {error}") from error
    R_camera_floor = exp(numbers_at(path, f"{name}.rotation", table["rotation"], 3))
    t = numbers_at(path, f"{name}.translation", table["translation"], 3)
    return model, (R_camera_floor.T, -R_camera_floor.T @ t)


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
