"""Reading a SMPL ``.pkl`` without chumpy or SciPy, and without running anything that stands in it.

Only NumPy arrays, plain containers and stand-ins for chumpy and scipy.sparse objects can be made; any other class in
the file is refused before it is looked up.
"""

import math
import pickle
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from vip_factors.errors import FileFormatError
from vip_factors.geometry.rotations import Array

MOST_ENTRIES = 10**8  # of a matrix: SMPL-X has 55 joints and 10,475 vertices


class _StandIn:
    """An object of a library that is not imported: its state only."""

    def __init__(self, *_: Any) -> None: ...

    def __setstate__(self, state: Any) -> None:
        if isinstance(state, dict):
            self.__dict__.update(state)


class _Chumpy(_StandIn):
    """Any chumpy object: ``x`` of an array, or ``a`` and ``idxs`` of a selection from one."""


class _Sparse(_StandIn):
    """Any compressed scipy.sparse matrix: ``data``, ``indices``, ``indptr`` and its shape."""


def _numpy_allowed() -> dict[tuple[str, str], Any]:
    from numpy._core.multiarray import scalar

    found: dict[tuple[str, str], Any] = {("numpy", "ndarray"): _NoArrayYet, ("numpy", "dtype"): np.dtype}
    for module in ("numpy.core.multiarray", "numpy._core.multiarray"):
        found |= {(module, "_reconstruct"): _empty, (module, "scalar"): scalar}
    return found


class _NoArrayYet:
    """What stands for the class of arrays: it cannot be called with a size that is not in the file."""


def _empty(*_: Any) -> Any:
    """An array without entries, which gets its size with its content."""
    from numpy._core.multiarray import _reconstruct

    return _reconstruct(np.ndarray, (0,), b"b")


def _latin1(text: str, encoding: str = "latin1") -> bytes:
    """What ``_codecs.encode`` does for bytes in a pickle of protocol 2."""
    return text.encode("latin1" if encoding in ("latin1", "latin-1") else "ascii")


def _new_object(cls: type, *_: Any) -> Any:
    """What ``copyreg._reconstructor`` does, for our stand-ins alone."""
    if not (isinstance(cls, type) and issubclass(cls, _StandIn)):
        raise pickle.UnpicklingError(f"an object of {cls}")
    return cls()


class _RestrictedUnpickler(pickle._Unpickler):
    """The one in Python: that in C makes room for as many objects as a damaged file announces."""

    def find_class(self, module: str, name: str) -> Any:
        known = _numpy_allowed() | {
            ("_codecs", "encode"): _latin1,
            ("copy_reg", "_reconstructor"): _new_object,
            ("copyreg", "_reconstructor"): _new_object,
            ("__builtin__", "object"): object,
            ("builtins", "object"): object,
            ("collections", "OrderedDict"): dict,
        }
        if (module, name) in known:
            return known[module, name]
        if module.partition(".")[0] == "chumpy":
            return _Chumpy
        if module.startswith("scipy.sparse"):
            return _Sparse
        raise pickle.UnpicklingError(f"the class {module}.{name}, which no SMPL file needs")


def read_smpl_pickle(path: Path) -> dict[str, Any]:
    """The dictionary in a SMPL pickle, its arrays still as they stand there (see :func:`dense`).

    Raises:
        FileFormatError: for anything that is not a dictionary of arrays, or holds a class it should not.
    """
    try:
        content = _RestrictedUnpickler(BytesIO(path.read_bytes()), encoding="latin1").load()
    except Exception as error:  # of damaged pickles, pickle and NumPy raise a dozen kinds
        reason = error or "it breaks off"
        raise FileFormatError(f"{path}: not a SMPL model pickle ({reason}); expected a model's .pkl or .npz") from error
    if not isinstance(content, dict):
        raise FileFormatError(f"{path}: holds a {type(content).__name__}; expected the dictionary of a SMPL model")
    return content


def dense(value: Any, name: str, path: Path) -> Array:
    """A plain array of what a SMPL file holds under ``name``: an array, a chumpy object or a sparse matrix."""
    try:
        if isinstance(value, _Chumpy):
            return _dense_chumpy(value)
        if isinstance(value, _Sparse):
            return _dense_sparse(value)
        return np.asarray(value, dtype=float)
    except (AttributeError, KeyError, ValueError, TypeError, IndexError) as error:
        raise FileFormatError(f"{path}: '{name}' cannot be read as an array of numbers ({error})") from error


def _dense_chumpy(value: Any) -> Array:
    if hasattr(value, "x"):
        return np.asarray(_dense_chumpy(value.x) if isinstance(value.x, _Chumpy) else value.x, dtype=float)
    source = _dense_chumpy(value.a) if isinstance(value.a, _Chumpy) else np.asarray(value.a, dtype=float)
    return source.ravel()[np.asarray(value.idxs, dtype=int)].reshape(value.preferred_shape)


def _dense_sparse(value: Any) -> Array:
    shape = tuple(int(size) for size in getattr(value, "_shape", None) or value.shape)
    if math.prod(shape) > MOST_ENTRIES:
        raise ValueError(f"a matrix of {' x '.join(map(str, shape))}")
    full = np.zeros(shape)
    if hasattr(value, "row"):
        np.add.at(full, (value.row, value.col), value.data)
        return full
    major = np.repeat(np.arange(len(value.indptr) - 1), np.diff(value.indptr))
    by_column = len(value.indptr) - 1 == shape[1]
    if shape[0] == shape[1]:
        raise ValueError("a square sparse matrix, of which rows and columns cannot be told apart")
    rows, columns = (value.indices, major) if by_column else (major, value.indices)
    np.add.at(full, (rows, columns), value.data)
    return full
