"""Archives of arrays (.npz), which may be damaged or claim sizes that they do not have."""

import math
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from vip_factors.errors import FileFormatError


def read_npz(path: Path, expected: str, names: Iterable[str] | None = None) -> dict[str, Any]:
    """The arrays of an archive by name, of those that are wanted; ``expected``, what it should be, is for the
    complaint.

    Raises:
        FileFormatError: if it is no archive of arrays, or damaged.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            wanted = [name for name in file.files if names is None or name in set(names)]
            for name in wanted:
                _check_size(file, name)
            return {name: _checked_text(name, file[name]) for name in wanted}
    except Exception as error:  # of damaged archives NumPy, zipfile, zlib and tokenize raise a dozen kinds
        raise FileFormatError(f"{path}: {expected} ({error or 'it breaks off'})") from error


def _checked_text(name: str, value: Any) -> Any:
    """Refuse text with numbers that are no characters: Python fails at it later, wherever it is used."""
    if value.dtype.kind == "U" and value.size:
        codes = np.ascontiguousarray(value).reshape(-1).view(np.dtype("u4").newbyteorder(value.dtype.byteorder))
        if codes.max() > sys.maxunicode:
            raise ValueError(f"{name} is no text")
    return value


def _check_size(file: Any, name: str) -> None:
    """Refuse an array that claims to be larger than its part of the archive, before room is made for it."""
    with file.zip.open(f"{name}.npy") as part:
        version = np.lib.format.read_magic(part)
        read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, kind = read_header(part)
    if math.prod(shape) * kind.itemsize > file.zip.getinfo(f"{name}.npy").file_size:
        raise ValueError(f"{name} claims to have the shape {shape}, for which the file is too short")
