"""Cameras as Pose2Sim's calibration has them: one TOML file with a table for each camera of a lab.

A table holds ``size``, ``matrix``, ``distortions`` (OpenCV's), and ``rotation`` (a rotation vector) and
``translation`` (metres), which take points from the world, whose z is up and whose floor is at 0, to the camera.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array, exp
from vip_factors.io.toml_values import nearest, number_at, numbers_at, table_at
from vip_factors.sensors.camera_model import CameraModel

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
