"""Pickles of plain data: containers, numbers, text and NumPy arrays. Whatever else a pickle asks for is refused."""

import pickle
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from vip_factors.errors import FileFormatError


def _encode(text: str, encoding: str = "latin1") -> bytes:
    """How Python 3 writes bytes in old protocols; only this one encoding is plain data."""
    if encoding not in ("latin1", "latin-1"):
        raise pickle.UnpicklingError(f"encoding '{encoding}'")
    return text.encode("latin1")


def _allowed() -> dict[tuple[str, str], Callable[..., Any]]:
    from numpy._core import multiarray, numeric

    allowed: dict[tuple[str, str], Callable[..., Any]] = {
        ("numpy", "ndarray"): _NoArrayYet,
        ("numpy", "dtype"): np.dtype,
        ("_codecs", "encode"): _encode,
    }
    for core in ("numpy.core", "numpy._core"):  # the name before and after NumPy 2
        allowed |= {
            (f"{core}.multiarray", "_reconstruct"): _reconstruct,
            (f"{core}.multiarray", "scalar"): multiarray.scalar,
            (f"{core}.numeric", "_frombuffer"): numeric._frombuffer,  # type: ignore[attr-defined]
        }
    return allowed


class _NoArrayYet:
    """What stands for the class of arrays: it cannot be called with a size that is not in the file."""


def _reconstruct(*_: Any) -> Any:
    """An empty array, which gets its size with its content."""
    from numpy._core import multiarray

    return multiarray._reconstruct(np.ndarray, (0,), b"b")


class PlainUnpickler(pickle._Unpickler):
    """An unpickler that knows arrays and nothing else, so that a file can run no code.

    The one in Python: that in C makes room for as many objects as a damaged file announces, up to 64 GB.
    """

    def find_class(self, module: str, name: str) -> Any:
        """What the pickle asks for, if it is an array or plain data."""
        allowed = _allowed()
        if (module, name) not in allowed:
            raise pickle.UnpicklingError(f"it asks for {module}.{name}, which is neither an array nor plain data")
        return allowed[module, name]


def load_plain_pickle(path: Path) -> Any:
    """The content of a pickle, also of Python 2's (text as Latin-1), if it is plain data and arrays.

    Raises:
        FileFormatError: if it is no pickle, breaks off, or holds anything else, which is never executed.
    """
    try:
        return PlainUnpickler(BytesIO(path.read_bytes()), encoding="latin1").load()
    except OSError:
        raise
    except Exception as error:  # of damaged pickles, pickle and NumPy raise a dozen kinds
        raise FileFormatError(f"{path}: not a readable pickle of arrays: {error or 'it breaks off'}") from error
