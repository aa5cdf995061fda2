"""A camera's path in the TUM format: rows of ``time x y z qx qy qz qw``, seconds and metres, as SLAM programs write."""

from pathlib import Path

import numpy as np

from vip_factors.errors import FileFormatError
from vip_factors.geometry.quaternions import Order, matrix_from_quaternion
from vip_factors.io.typed_files import MOST_MOTION_BYTES, read_text
from vip_factors.sensors.camera import CameraPath

COLUMNS = "time x y z qx qy qz qw"


def read_camera_path(path: Path) -> CameraPath:
    """Poses ``T_world_camera`` in increasing order of time; lines that begin with ``#`` are comments.

    Raises:
        FileFormatError: for a row of another form, or fewer than two poses.
        InputError: for a quaternion that is not of unit length.
    """
    rows = list[list[float]]()
    for number, line in enumerate(
        read_text(path, "a camera's path (TUM)", most_bytes=MOST_MOTION_BYTES).splitlines(), start=1
    ):
        words = line.split("#")[0].replace(",", " ").split()
        if not words:
            continue
        row = _numbers(words)
        if len(row) != 8 or not np.all(np.isfinite(row)):
            raise FileFormatError(f"{path}, line {number}: expected eight numbers: {COLUMNS}")
        rows.append(row)
    poses = np.array(rows).reshape(-1, 8)
    time, first = np.unique(poses[:, 0], return_index=True)
    if len(time) < 2:
        raise FileFormatError(f"{path}: {len(time)} poses: expected the camera's path, one row a pose: {COLUMNS}")
    return CameraPath(time, matrix_from_quaternion(poses[first, 4:], Order.XYZW), poses[first, 1:4])


def _numbers(words: list[str]) -> list[float]:
    """The words as numbers; empty if one of them is none."""
    try:
        return [float(word) for word in words]
    except ValueError:
        return []
