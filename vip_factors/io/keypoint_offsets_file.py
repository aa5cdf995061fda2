"""A small TOML file that holds where detectors put their keypoints: ``vip-factors train keypoints`` writes it.

::

    provenance = "vip-factors train keypoints walk.mcap run.mcap"

    [body25]                       # a keypoint set, as its detector writes it
    people = 2

    [body25.offsets]               # metres in bone axes, of the left side: x to the left, y up, z forward
    shoulder = { mean_m = [0.0, -0.012, 0.004], sigma_m = [0.008, 0.009, 0.008] }
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from vip_factors.atomic import atomic_open
from vip_factors.body.keypoints import KEYPOINT_SETS, OFFSET_KEYPOINTS, KeypointOffsets, PooledOffsets
from vip_factors.errors import InputError, nearest
from vip_factors.io.typed_files import Vector, convert, convert_entries, read_toml, toml_text

FARTHEST, WIDEST = 0.15, 0.2  # m: beyond which it is no keypoint of that joint


@dataclass(frozen=True)
class KeypointOffsetsFile:
    """Content of such a file: ``sets`` by the name of the keypoint set, and one line on where it comes from."""

    sets: Mapping[str, PooledOffsets]
    provenance: str = ""


def write_keypoint_offsets(path: str | Path, content: KeypointOffsetsFile, overwrite: bool = False) -> None:
    """Write the file, whole or not at all; micrometres.

    Raises:
        InputError: if the file exists, or its folder is missing or read-only.
    """
    lines = [f"provenance = {toml_text(content.provenance)}"]
    for name, pooled in content.sets.items():
        mean, sigma = np.round(pooled.offsets.mean, 6) + 0.0, np.round(pooled.offsets.sigma, 6)
        lines += ["", f"[{name}]", f"people = {pooled.people}", "", f"[{name}.offsets]"]
        lines += [
            f"{keypoint} = {{ mean_m = {toml_text(mean[k])}, sigma_m = {toml_text(sigma[k])} }}"
            for k, keypoint in enumerate(OFFSET_KEYPOINTS)
        ]
    with atomic_open(path, overwrite=overwrite) as file:
        file.write("\n".join(lines) + "\n")


class _Offset(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    mean_m: Vector
    sigma_m: Vector


class _Set(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    offsets: dict[str, object]
    people: int = 0


def read_keypoint_offsets(path: Path) -> KeypointOffsetsFile:
    """Read the file.

    Raises:
        FileFormatError: if it is no TOML file.
        InputError: for a value that is not what it has to be.
    """
    content = read_toml(path, dict[str, object], "a file of keypoint offsets, as vip-factors train keypoints writes it")
    provenance = convert(path, "provenance", content.pop("provenance", ""), str)
    for name in content:
        if name not in KEYPOINT_SETS:
            raise InputError(f"{path}: unknown key '{name}'{nearest(name, KEYPOINT_SETS)}")
    tables = convert_entries(path, "", content, _Set)
    return KeypointOffsetsFile({name: _pooled(path, name, table) for name, table in tables.items()}, provenance)


def _pooled(path: Path, name: str, table: _Set) -> PooledOffsets:
    where = f"{name}.offsets"
    offsets = convert_entries(path, where, table.offsets, _Offset)
    if (wrong := sorted(set(OFFSET_KEYPOINTS) ^ set(offsets))) != []:
        state = "unknown" if wrong[0] in offsets else "missing"
        raise InputError(f"{path}: {where}.{wrong[0]} is {state}: expected all of {', '.join(OFFSET_KEYPOINTS)}")
    mean = np.array([offsets[keypoint].mean_m for keypoint in OFFSET_KEYPOINTS])
    sigma = np.array([offsets[keypoint].sigma_m for keypoint in OFFSET_KEYPOINTS])
    if np.abs(mean).max() > FARTHEST or not 0 < sigma.min() <= sigma.max() <= WIDEST:
        raise InputError(
            f"{path}: {where}: expected means up to {FARTHEST:g} m and sigmas above zero, up to {WIDEST:g} m"
        )
    return PooledOffsets(KeypointOffsets(mean, sigma), table.people)
