"""The skeleton of a user's own SMPL, SMPL-H or SMPL-X model file. Nothing of the model ships with this package.

Reading a SMPL ``.pkl`` without chumpy, and without running anything that stands in it.

Only plain containers and stand-ins for objects of NumPy, chumpy and scipy.sparse can be made; any other class in the
file is refused before it is looked up.
"""

import pickle
import re
from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import coo_array, csc_array, csr_array

from vip_factors.body.npz_file import read_npz
from vip_factors.body.skeleton import JOINT_COUNT, JOINT_NAMES, PARENTS, Landmark, Skeleton, joint_index
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import Array

MOST_ENTRIES = 10**8  # of a matrix: SMPL-X has 55 joints and 10,475 vertices
NEEDED = ("v_template", "shapedirs", "J_regressor")
# Models with fingers have no joint in the palm; the knuckle of the middle finger stands in, left and right.
KNUCKLES = {24: (22, 23), 52: (25, 40), 55: (28, 43)}  # SMPL, SMPL-H, SMPL-X


@dataclass(frozen=True)
class SmplBody:
    """A model's skeleton, with landmarks from the skin, and where its pelvis lies in the model's own frame, ``(3,)``
    metres: SMPL's ``trans`` moves the model's origin, ``p_world_pelvis = trans + p_model_pelvis``.
    """

    skeleton: Skeleton
    p_model_pelvis: Array


def skeleton_from_smpl(path: str | Path, betas: Sequence[float] | Array | None = None) -> Skeleton:
    """The skeleton of a SMPL model file of these shape coefficients (the mean shape if none).

    Raises:
        FileFormatError: if the file is not such a model.
        InputError: for more coefficients than the model has.
    """
    return smpl_body(path, betas).skeleton


def smpl_body(path: str | Path, betas: Sequence[float] | Array | None = None) -> SmplBody:
    """As :func:`skeleton_from_smpl`, with the pelvis's place in the model's frame."""
    path = Path(path)
    v_template, shapedirs, J_regressor = _model_arrays(path)
    shape = np.zeros(0) if betas is None else np.asarray(betas, dtype=float).ravel()
    if len(shape) > shapedirs.shape[2] or not np.all(np.isfinite(shape)):
        raise InputError(f"{path}: {len(shape)} betas: expected at most {shapedirs.shape[2]} finite numbers")
    vertices = v_template + shapedirs[:, :, : len(shape)] @ shape
    chosen = [*range(22), *KNUCKLES[len(J_regressor)]]
    joints = (J_regressor @ vertices)[chosen]
    offsets = joints - joints[np.array(PARENTS)]
    offsets[0] = 0.0
    source = f"{path.name}, {len(shape)} betas" if len(shape) else f"{path.name}, mean shape"
    return SmplBody(Skeleton(offsets, _landmarks(vertices, joints), source), joints[0])


def _model_arrays(path: Path) -> tuple[Array, Array, Array]:
    if path.suffix.lower() == ".pkl":
        content: dict[str, Any] = read_smpl_pickle(path)
    elif path.suffix.lower() == ".npz":
        content = read_npz(path, "not a SMPL model npz", NEEDED)
    else:
        raise FileFormatError(f"{path}: expected a SMPL model, .npz or .pkl")
    missing = [name for name in NEEDED if name not in content]
    if missing:
        raise FileFormatError(f"{path}: lacks {', '.join(missing)}; expected a SMPL model file")
    v_template, shapedirs, J_regressor = (dense(content[name], name, path) for name in NEEDED)
    vertices = v_template.shape[0] if v_template.ndim else 0
    if v_template.shape != (vertices, 3) or shapedirs.shape[:2] != (vertices, 3) or shapedirs.ndim != 3:
        raise FileFormatError(
            f"{path}: v_template {v_template.shape} and shapedirs {shapedirs.shape}: expected (V, 3) and (V, 3, B)"
        )
    if J_regressor.shape not in [(count, vertices) for count in KNUCKLES]:
        raise FileFormatError(
            f"{path}: J_regressor {J_regressor.shape}: expected ({JOINT_COUNT}, {vertices}) of SMPL, or 52 or 55 rows "
            "of SMPL-H or SMPL-X"
        )
    return v_template, shapedirs, J_regressor


def _landmarks(vertices: Array, joints: Array) -> dict[str, Landmark]:
    """Points of the skin, in the T-pose: the highest, the hindmost and foremost of each foot, the outermost."""
    at = {name: joints[index] for index, name in enumerate(JOINT_NAMES)}
    points = {"head_top": ("head", vertices[np.argmax(vertices[:, 1])])}
    for side, x in (("left", 1.0), ("right", -1.0)):
        points[f"{side}_fingertip"] = (f"{side}_hand", vertices[np.argmax(x * vertices[:, 0])])
        foot = vertices[(x * vertices[:, 0] > 0) & (vertices[:, 1] < at[f"{side}_ankle"][1])]
        if len(foot) == 0:
            continue
        sole = foot[:, 1].min()  # heel and toes at the height of the sole, as they stand on the floor
        for name, bone, z in (("heel", "ankle", -1.0), ("toe_tip", "foot", 1.0)):
            extreme = foot[np.argmax(z * foot[:, 2])]
            points[f"{side}_{name}"] = (f"{side}_{bone}", np.array([extreme[0], sole, extreme[2]]))
    return {name: Landmark(joint_index(bone), point - at[bone]) for name, (bone, point) in points.items()}


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
