"""TOML files with offsets of detectors' keypoints from the joints, learnt from recordings of known motion.

::

    provenance = "walk.mcap run.mcap"

    [body25]                       # a keypoint set, as its detector writes it
    people = 2

    [body25.offsets]               # metres in bone axes, of the left side: x to the left, y up, z forward
    shoulder = { mean_m = [0.0, -0.012, 0.004], sigma_m = [0.008, 0.009, 0.008] }
"""

from pathlib import Path

import msgspec
import numpy as np

from vip_factors.body.keypoints import KEYPOINT_SETS, OFFSET_KEYPOINTS
from vip_factors.errors import InputError, nearest
from vip_factors.factor_settings import LearnedOffsets
from vip_factors.io.typed_files import Vector, check_keys, convert, read_toml


class _Offset(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    mean_m: Vector
    sigma_m: Vector


class _Set(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    offsets: dict[str, _Offset]
    people: int = 0


def read_keypoint_offsets(path: Path) -> LearnedOffsets:
    """Read the offsets of the file's keypoint sets.

    Raises:
        FileFormatError: if it is no TOML file.
        InputError: for an invalid value.
    """
    content = read_toml(path, dict[str, object], "a file of keypoint offsets")
    convert(path, "provenance", content.pop("provenance", ""), str)
    for name in content:
        if name not in KEYPOINT_SETS:
            raise InputError(f"{path}: unknown key '{name}'{nearest(name, KEYPOINT_SETS)}")
    tables = convert(path, "", content, dict[str, _Set])
    offsets = {name: _offsets(path, f"{name}.offsets", table.offsets) for name, table in tables.items()}
    return LearnedOffsets(path, offsets)


def _offsets(path: Path, where: str, offsets: dict[str, _Offset]) -> tuple[list[list[float]], list[list[float]]]:
    check_keys(path, where, offsets, OFFSET_KEYPOINTS)
    farthest, widest = 0.15, 0.2  # m: beyond which it is no keypoint of that joint
    mean = np.array([offsets[keypoint].mean_m for keypoint in OFFSET_KEYPOINTS])
    sigma = np.array([offsets[keypoint].sigma_m for keypoint in OFFSET_KEYPOINTS])
    if np.abs(mean).max() > farthest or not 0 < sigma.min() <= sigma.max() <= widest:
        raise InputError(
            f"{path}: {where}: expected means up to {farthest:g} m and sigmas above zero, up to {widest:g} m"
        )
    return mean.tolist(), sigma.tolist()
