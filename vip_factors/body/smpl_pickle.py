"""Reading a SMPL ``.pkl`` without chumpy, and without running anything that stands in it.

Only plain containers and stand-ins for objects of NumPy, chumpy and scipy.sparse can be made; any other class in the
file is refused before it is looked up.
"""

import pickle
import re
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import coo_array, csc_array, csr_array

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


class _Kind:
    """A ``numpy.dtype`` of numbers or text. NumPy's own, filled from a damaged file, can end the program."""

    def __init__(self, code: str, *_: Any) -> None:
        if not re.fullmatch(r"[biufSU]\d{1,3}", code):
            raise pickle.UnpicklingError(f"an array of '{code[:20]}'")
        self.dtype = np.dtype(code)

    def __setstate__(self, state: Any) -> None:
        _, order, *_ = state
        if order in ("<", ">"):
            self.dtype = self.dtype.newbyteorder(order)


class _Plain:
    """A ``numpy.ndarray``, likewise: it has the size that its content in the file has."""

    def __setstate__(self, state: Any) -> None:
        *_, shape, kind, by_column, content = state
        content = content.encode("latin1") if isinstance(content, str) else bytes(content)
        self._array = np.frombuffer(content, kind.dtype).reshape(shape, order="F" if by_column else "C")

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.array(self._array, dtype)


def _scalar(kind: _Kind, content: bytes) -> Any:
    (found,) = np.frombuffer(content, kind.dtype)
    return found


def _latin1(text: str, encoding: str = "latin1") -> bytes:
    """What ``_codecs.encode`` does for bytes in a pickle of protocol 2."""
    return text.encode("latin1" if encoding in ("latin1", "latin-1") else "ascii")


def _new_object(cls: type, *_: Any) -> Any:
    """What ``copyreg._reconstructor`` does, for our stand-ins alone."""
    if not (isinstance(cls, type) and issubclass(cls, _StandIn)):
        raise pickle.UnpicklingError(f"an object of {cls}")
    return cls()


_ALLOWED: dict[tuple[str, str], Any] = {
    ("numpy", "ndarray"): _Plain,
    ("numpy", "dtype"): _Kind,
    ("_codecs", "encode"): _latin1,
    ("collections", "OrderedDict"): dict,
    **{(f"numpy.{core}.multiarray", "_reconstruct"): lambda *_: _Plain() for core in ("core", "_core")},
    **{(f"numpy.{core}.multiarray", "scalar"): _scalar for core in ("core", "_core")},
    **{(module, "_reconstructor"): _new_object for module in ("copy_reg", "copyreg")},
    **{(module, "object"): object for module in ("__builtin__", "builtins")},
}


class RestrictedUnpickler(pickle._Unpickler):
    """Makes plain data and stand-ins only.

    The one in Python: that in C makes room for as many objects as a damaged file announces.
    """

    def find_class(self, module: str, name: str) -> Any:
        """What a pickle asks for, if SMPL files need it; UnpicklingError otherwise."""
        if (module, name) in _ALLOWED:
            return _ALLOWED[module, name]
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
        content = RestrictedUnpickler(BytesIO(path.read_bytes()), encoding="latin1").load()
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
    height, width = (int(size) for size in getattr(value, "_shape", None) or value.shape)
    shape = height, width
    if height * width > MOST_ENTRIES:
        raise ValueError(f"a matrix of {height} x {width}")
    data = np.asarray(value.data, dtype=float)
    if hasattr(value, "row"):
        return coo_array((data, (np.asarray(value.row, int), np.asarray(value.col, int))), shape).toarray()
    if height == width:
        raise ValueError("a square sparse matrix, of which rows and columns cannot be told apart")
    ends, indices = np.asarray(value.indptr, dtype=int), np.asarray(value.indices, dtype=int)
    matrix = (csc_array if len(ends) - 1 == width else csr_array)((data, indices, ends), shape)
    matrix.check_format(full_check=True)
    return matrix.toarray()
