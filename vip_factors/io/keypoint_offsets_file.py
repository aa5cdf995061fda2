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
from typing import Any

import numpy as np

from vip_factors.atomic import atomic_open
from vip_factors.body.keypoints import KEYPOINT_SETS, OFFSET_KEYPOINTS, KeypointOffsets, PooledOffsets
from vip_factors.errors import InputError
from vip_factors.io.toml_values import known_keys, number_at, numbers_at, read_toml, table_at, text_at, toml_text

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


def read_keypoint_offsets(path: Path) -> KeypointOffsetsFile:
    """Read the file.

    Raises:
        FileFormatError: if it is no TOML file.
        InputError: for a value that is not what it has to be.
    """
    table = dict(read_toml(path, "a file of keypoint offsets, as vip-factors train keypoints writes it"))
    provenance = text_at(path, "provenance", table.pop("provenance", ""))
    known_keys(path, "", table, KEYPOINT_SETS)
    return KeypointOffsetsFile({name: _pooled(path, name, value) for name, value in table.items()}, provenance)


def _pooled(path: Path, name: str, value: Any) -> PooledOffsets:
    table = table_at(path, name, value)
    known_keys(path, name, table, ("people", "offsets"))
    people = int(number_at(path, f"{name}.people", table.get("people", 0)))
    offsets = table_at(path, f"{name}.offsets", table.get("offsets"))
    known_keys(path, f"{name}.offsets", offsets, OFFSET_KEYPOINTS)
    mean, sigma = [], []
    for keypoint in OFFSET_KEYPOINTS:
        where = f"{name}.offsets.{keypoint}"
        one = table_at(path, where, offsets.get(keypoint))
        known_keys(path, where, one, ("mean_m", "sigma_m"))
        mean.append(numbers_at(path, f"{where}.mean_m", one.get("mean_m"), 3))
        sigma.append(numbers_at(path, f"{where}.sigma_m", one.get("sigma_m"), 3))
        if np.abs(mean[-1]).max() > FARTHEST or not 0 < sigma[-1].min() <= sigma[-1].max() <= WIDEST:
            raise InputError(
                f"{path}: {where}: mean {toml_text(mean[-1])} and sigma {toml_text(sigma[-1])} m: expected means up to "
                f"{FARTHEST:g} m and sigmas above zero, up to {WIDEST:g} m"
            )
    return PooledOffsets(KeypointOffsets(np.array(mean), np.array(sigma)), people)
