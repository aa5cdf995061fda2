"""Safe reading of array archives (.npz), which may be damaged."""

import math
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from vip_factors.errors import FileFormatError


def read_npz(path: Path, expected: str, names: Iterable[str] | None = None) -> dict[str, Any]:
    """Read the arrays of an archive, all or those in ``names``; ``expected`` begins the error message.

    Raises:
        FileFormatError: if it is not an archive of arrays, or damaged.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            wanted = [name for name in file.files if names is None or name in set(names)]
            for name in wanted:
                _check_size(file, name)
            return {name: _checked_text(name, file[name]) for name in wanted}
    except Exception as error:  # NumPy, zipfile, zlib and tokenize raise a dozen kinds
        raise FileFormatError(f"{path}: {expected} ({error or 'it is truncated'})") from error


def _checked_text(name: str, value: Any) -> Any:
    """Refuse text with invalid code points, which fails later in Python."""
    if value.dtype.kind == "U" and value.size:
        codes = np.ascontiguousarray(value).reshape(-1).view(np.dtype("u4").newbyteorder(value.dtype.byteorder))
        if codes.max() > sys.maxunicode:
            raise ValueError(f"{name} is not valid text")
    return value


def _check_size(file: Any, name: str) -> None:
    """Refuse an array that claims to be larger than its file in the archive, before memory is allocated."""
    with file.zip.open(f"{name}.npy") as array_file:
        version = np.lib.format.read_magic(array_file)
        read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, kind = read_header(array_file)
    if math.prod(shape) * kind.itemsize > file.zip.getinfo(f"{name}.npy").file_size:
        raise ValueError(f"{name} has the shape {shape} in its header, for which the file is too short")
