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
Pose2Sim's calibration the camera that is named after a colon: ``Calib.toml:cam_01``.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vip_factors.atomic import atomic_open
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array, nearest_rotation
from vip_factors.io.opencv_camera_file import OPENCV_SUFFIXES, read_opencv_camera
from vip_factors.io.pose2sim_camera import cameras_in, read_pose2sim_camera
from vip_factors.io.toml_values import known_keys, number_at, read_toml, toml_text
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
