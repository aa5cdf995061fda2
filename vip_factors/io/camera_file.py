"""Camera files: TOML files with a camera's intrinsics, and its pose over the floor if that is known.

::

    width = 1920
    height = 1080
    fx = 1480.2
    fy = 1479.6
    cx = 961.3
    cy = 538.8
    distortion = [0.05, -0.12, 0.0, 0.0, 0.0]
    focal_sigma = 0.25

    [floor]
    R_floor_camera = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
    p_floor_camera = [0, 0, 1.5]

    [calibration]
    rms_px = 0.21

``focal_sigma`` is the relative standard deviation of a focal length that was not calibrated; without it the lens is
calibrated. The floor's frame has its z axis up, against gravity; the camera's axes are OpenCV's. People alone read
``[calibration]``. OpenCV's files (``camera_matrix``) are read too, and one camera of Pose2Sim's calibration, named
after a colon: ``Calib.toml:cam_01``.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np

from vip_factors.atomic import atomic_open
from vip_factors.errors import FileFormatError, InputError, nearest
from vip_factors.geometry.quaternions import Order, matrix_from_quaternion
from vip_factors.geometry.rotations import Array, exp, nearest_rotation
from vip_factors.io.typed_files import (
    MOST_MOTION_BYTES,
    Matrix,
    Number,
    Vector,
    convert,
    read_json,
    read_text,
    read_toml,
    toml_text,
)
from vip_factors.sensors.camera import CameraModel, CameraPath

OPENCV_SUFFIXES = (".yaml", ".yml", ".xml", ".json")
MATRIX = ("camera_matrix", "Camera_Matrix", "cameraMatrix", "mtx", "K")
DISTORTION = ("dist_coeffs", "distortion_coefficients", "Distortion_Coefficients", "distCoeffs", "dist", "D")
WIDTH, HEIGHT = ("image_width", "image_Width", "width"), ("image_height", "image_Height", "height")
SIZE = ("image_size", "img_size", "imageSize")  # width, height
Pixels = Annotated[int, msgspec.Meta(gt=0, lt=1_000_000)]


class _Floor(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    R_floor_camera: Matrix
    p_floor_camera: Vector


class _Camera(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Content of a camera file of ours."""

    width: Pixels
    height: Pixels
    fx: Number
    fy: Number
    cx: Number
    cy: Number
    distortion: tuple[Number, ...] = ()
    focal_sigma: Annotated[float, msgspec.Meta(ge=0, le=1)] = 0.0
    floor: _Floor | None = None
    calibration: dict[str, object] = {}


class _Pose2SimCamera(msgspec.Struct, frozen=True):
    """Table of a camera in a calibration of Pose2Sim's.

    Attributes:
        size: width and height.
        matrix: intrinsics.
        distortions: as OpenCV's.
        rotation: rotation vector from the world, whose z is up and whose floor is at 0, to the camera.
        translation: metres, with it.
        fisheye: whether the distortion is that of a fisheye lens.
    """

    size: tuple[Number, Number]
    matrix: Matrix
    distortions: tuple[Number, ...]
    rotation: Vector
    translation: Vector
    fisheye: bool = False


@dataclass(frozen=True)
class CameraFile:
    """Content of a camera file.

    Attributes:
        model: the intrinsics.
        focal_sigma: standard deviation of the focal length's logarithm; 0 of a calibrated lens.
        floor: the pose over the floor, ``R_floor_camera (3, 3)`` and ``p_floor_camera (3,)`` m; None if unknown.
    """

    model: CameraModel
    focal_sigma: float = 0.0
    floor: tuple[Array, Array] | None = None


def read_camera_file(path: str | Path) -> CameraFile:
    """Read a camera file: TOML, OpenCV's by its suffix (.yaml, .yml, .xml, .json), or Pose2Sim's."""
    path = Path(path)
    if path.suffix.lower() in OPENCV_SUFFIXES:
        return CameraFile(_opencv_model(path))
    where, camera = _toml_camera(path)
    if isinstance(camera, _Pose2SimCamera):
        model = _model(where, list(map(round, camera.size)), np.array(camera.matrix), camera.distortions)
        R_camera_floor = exp(np.array(camera.rotation))
        return CameraFile(model, 0.0, (R_camera_floor.T, -R_camera_floor.T @ np.array(camera.translation)))
    K = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    model = _model(where, (camera.width, camera.height), K, camera.distortion)
    if camera.floor is None:
        return CameraFile(model, camera.focal_sigma)
    R = np.array(camera.floor.R_floor_camera)
    rounding = 1e-2  # numbers rounded by hand to two places still pass
    if np.abs(R.T @ R - np.eye(3)).max() > rounding or np.linalg.det(R) < 0:
        raise InputError(f"{where}: floor.R_floor_camera is not a rotation matrix")
    return CameraFile(model, camera.focal_sigma, (nearest_rotation(R), np.array(camera.floor.p_floor_camera)))


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
    """
    if Path(path).suffix.lower() in OPENCV_SUFFIXES:
        raise InputError(f"{path}: expected a name that ends in .toml; OpenCV's files are only read")
    (fx, fy), (cx, cy) = model.focal, model.centre
    table = {"width": model.width, "height": model.height, "fx": fx, "fy": fy, "cx": cx, "cy": cy}
    lines = [f"{name} = {toml_text(value)}" for name, value in table.items()]
    lines.append(f"distortion = {toml_text(model.distortion)}")
    if floor is not None:
        R, p = map(toml_text, floor)
        lines += ["", "[floor]", f"R_floor_camera = {R}", f"p_floor_camera = {p}"]
    if calibration:
        lines += ["", "[calibration]", *(f"{name} = {toml_text(value)}" for name, value in calibration.items())]
    with atomic_open(path, "w", overwrite) as file:
        file.write("\n".join(lines) + "\n")


def read_camera_path(path: Path) -> CameraPath:
    """Read poses ``T_world_camera`` in increasing order of time from a TUM file, as SLAM programs write.

    Its rows are ``time x y z qx qy qz qw``, seconds and metres; lines that begin with ``#`` are comments.

    Raises:
        FileFormatError: for a row of another form, or fewer than two poses.
        InputError: for a quaternion that is not of unit length.
    """
    columns, rows = "time x y z qx qy qz qw", list[list[float]]()
    text = read_text(path, "a camera's path (TUM)", most_bytes=MOST_MOTION_BYTES)
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split("#")[0].replace(",", " ").split()
        if not words:
            continue
        try:
            rows.append(list(map(float, words)))
        except ValueError:
            rows.append([])
        if len(rows[-1]) != 8 or not np.all(np.isfinite(rows[-1])):
            raise FileFormatError(f"{path}, line {number}: expected eight numbers: {columns}")
    poses = np.array(rows).reshape(-1, 8)
    time, first_rows = np.unique(poses[:, 0], return_index=True)
    if len(time) < 2:
        raise FileFormatError(f"{path}: {len(time)} poses: expected the camera's path, one row a pose: {columns}")
    R_world_camera = matrix_from_quaternion(poses[first_rows, 4:], Order.XYZW)
    return CameraPath(time, R_world_camera, poses[first_rows, 1:4])


def _toml_camera(path: Path) -> tuple[str, _Camera | _Pose2SimCamera]:
    """Read the camera of a TOML file, and its name in messages."""
    name = ""
    if not path.is_file() and ":" in path.name:
        stem, _, name = path.name.rpartition(":")
        path = path.with_name(stem)
    content = read_toml(path, dict[str, object], "a camera file (TOML with fx, fy, cx, cy …)")
    cameras = [key for key, table in content.items() if isinstance(table, Mapping) and "matrix" in table]
    if not cameras:
        if name:
            raise InputError(f"{path} holds a single camera: leave out ':{name}'")
        return str(path), convert(path, "", content, _Camera)
    if not name and len(cameras) > 1:
        raise InputError(
            f"{path}: holds the cameras {', '.join(cameras)}: name the one you mean, such as {path}:{cameras[0]}"
        )
    name = name or cameras[0]
    if name not in cameras:
        raise InputError(f"{path}: no camera '{name}'{nearest(name, cameras)}")
    camera = convert(path, name, content[name], _Pose2SimCamera)
    if camera.fisheye:
        raise InputError(f"{path}: {name} is a fisheye camera: expected one whose distortion is OpenCV's usual")
    return f"{path}: {name}", camera


def _model(where: str, size: Sequence[float], K: Array, distortion: Sequence[float]) -> CameraModel:
    if not all(0 < pixels < 1e6 for pixels in size):
        raise InputError(f"{where}: the image is {size[0]:g} by {size[1]:g} pixels: expected numbers above zero")
    try:
        fx, _, cx, _, fy, cy, *_ = K.ravel().tolist()
        return CameraModel(int(size[0]), int(size[1]), (fx, fy), (cx, cy), tuple(distortion))
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


def _opencv_model(path: Path) -> CameraModel:
    """Intrinsics as OpenCV's and ROS's programs write them: a ``camera_matrix`` and, if there, ``dist_coeffs``."""
    numbers = _json_numbers(path) if path.suffix.lower() == ".json" else _storage_numbers(path)
    K, distortion, size, width, height = (numbers(names) for names in (MATRIX, DISTORTION, SIZE, WIDTH, HEIGHT))
    if K is None or K.size != 9:
        raise InputError(
            f"{path}: there is no camera_matrix of three by three numbers: expected fx 0 cx, 0 fy cy, 0 0 1"
        )
    if width is not None and height is not None and width.size and height.size:
        size = np.array([width.ravel()[0], height.ravel()[0]])
    if size is None or size.size != 2:
        raise InputError(f"{path}: the image's size is missing: expected image_width and image_height, in pixels")
    coefficients = [] if distortion is None else distortion.ravel().tolist()
    if any(coefficients[8:]):  # beyond them OpenCV has thin prisms and tilted sensors
        raise InputError(
            f"{path}: {len(coefficients)} distortion coefficients: expected at most eight that are not zero"
        )
    return _model(str(path), size.ravel().tolist(), K, coefficients[:8])


Numbers = Callable[[tuple[str, ...]], Array | None]
"""The numbers under the first of some names that is there."""


def _json_numbers(path: Path) -> Numbers:
    content = read_json(path, dict[str, object], "a JSON object with camera_matrix")
    inner = content.get("opencv_storage", content)
    table = inner if isinstance(inner, Mapping) else content

    def numbers(names: tuple[str, ...]) -> Array | None:
        value = next((table[name] for name in names if name in table), None)
        value = value.get("data") if isinstance(value, Mapping) else value
        try:
            return None if value is None else np.array(value, dtype=float)
        except (TypeError, ValueError, OverflowError) as error:
            raise InputError(f"{path}: {names[0]}: expected numbers") from error

    return numbers


def _storage_numbers(path: Path) -> Numbers:
    import cv2

    text = read_text(path, "a camera file (TOML, or OpenCV's YAML)", strict=True)
    # Beyond some 20,000 levels of lists, tables or elements OpenCV's recursive parser crashes: brackets and tags are
    # counted, and YAML's nesting in one line without brackets.
    lines = "\n".join(line for line in text.splitlines() if not line.lstrip().startswith("#"))
    most_in_line = max(piece.count(":") + piece.count("-") for piece in re.split(r"[,\[\]{}\n]", lines))
    if sum(map(text.count, "[{<")) > 2000 or most_in_line > 50:
        raise FileFormatError(f"{path}: too many lists or tables in one another: expected a camera_matrix")
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
                if data.isSeq() and data.size() > 100:  # reading each takes as long as all before it
                    raise InputError(f"{path}: {data.size()} numbers where camera_matrix and the like should be")
                if data.isSeq() and (data.size() or not node.isMap()):
                    return np.array([data.at(index).real() for index in range(data.size())])
                if data.isReal() or data.isInt():
                    return np.array([data.real()])
        except cv2.error as error:
            raise FileFormatError(f"{path}: OpenCV finds a text or a list where camera_matrix should be") from error
        return None

    return numbers
