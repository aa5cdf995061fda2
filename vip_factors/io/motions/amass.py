"""AMASS npz (SMPL-H or SMPL-X pose vectors and root path, Z up), and the skeleton of a user's own SMPL, SMPL-H or
SMPL-X model file: nothing of the model ships with this package.

A model's ``.pkl`` is read without chumpy, and without running anything that stands in it: only plain containers and
stand-ins for objects of NumPy, chumpy and scipy.sparse can be made; any other class in the file is refused before it is
looked up.
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

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.kinematics import Motion
from vip_factors.body.lengths import stature_of
from vip_factors.body.npz_file import read_npz
from vip_factors.body.skeleton import JOINT_COUNT, JOINT_NAMES, LONGEST_BONE_M, PARENTS, Landmark, Skeleton, joint_index
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import Array, exp

MOST_ENTRIES = 10**8  # of a matrix: SMPL-X has 55 joints and 10,475 vertices
NEEDED = ("v_template", "shapedirs", "J_regressor")
# Models with fingers have no joint in the palm; the knuckle of the middle finger stands in, left and right.
KNUCKLES = {24: (22, 23), 52: (25, 40), 55: (28, 43)}  # SMPL, SMPL-H, SMPL-X
BODY_JOINTS = 22  # pelvis and joints 1 … 21 are the same in SMPL, SMPL-H and SMPL-X
POSE_WIDTHS = (72, 156, 165)
RATE_NAMES = ("mocap_framerate", "mocap_frame_rate", "fps")
# Where no model file tells: round statures of European adults, and the pelvis of the mean SMPL shape.
STATURE_M = {"male": 1.78, "female": 1.65, None: 1.71}
P_MODEL_PELVIS = np.array([0.0, -0.23, 0.03])


def read_amass(
    path: str | Path, model: str | Path | None = None, stature_m: float | None = None, rate: float | None = None
) -> Motion:
    """An AMASS file as a motion of our skeleton. Hands are kept rigid with the wrists.

    Args:
        path: npz with ``poses`` ``(T, 156)`` or ``(T, 165)`` (or SMPL's 72), ``trans`` and a frame rate.
        model: a SMPL model file, from which with the file's ``betas`` the skeleton is made exactly.
        stature_m: the person's height, where no model file is at hand; else the skeleton that this package's export
            puts beside the poses, or a round figure by the file's ``gender``.
        rate: frames per second, where the file does not say.

    Raises:
        FileFormatError: if the file is not of that form.
        InputError: for a file without a frame rate and none given.
    """
    path = Path(path)
    content = _read(path)
    poses, trans = content["poses"], content["trans"]
    T = len(poses) if poses.ndim else 0
    if poses.ndim != 2 or poses.shape[1] not in POSE_WIDTHS or trans.shape != (T, 3) or not T:
        raise FileFormatError(
            f"{path}: poses {poses.shape} and trans {trans.shape}: expected (T, 156) or (T, 165), and (T, 3)"
        )
    if not (np.all(np.isfinite(poses)) and np.all(np.isfinite(trans))):
        raise FileFormatError(f"{path}: poses or trans hold numbers that are not finite")
    offsets = content["joint_offsets"]
    if offsets is not None and not np.all(np.abs(offsets) < LONGEST_BONE_M):
        raise FileFormatError(f"{path}: joint_offsets hold numbers beyond {LONGEST_BONE_M:g} m: is it damaged?")
    rate = rate or content["rate"]
    if rate is None:
        raise InputError(f"{path}: none of {', '.join(RATE_NAMES)} in the file: give the rate")
    R_parent_child = np.broadcast_to(np.eye(3), (T, JOINT_COUNT, 3, 3)).copy()
    R_parent_child[:, :BODY_JOINTS] = exp(poses[:, : 3 * BODY_JOINTS].reshape(T, BODY_JOINTS, 3))
    skeleton, p_model_pelvis = _body(content, model, stature_m)
    return Motion(skeleton, R_parent_child, trans + p_model_pelvis, rate, name=path.stem)


def _body(content: dict[str, Any], model: str | Path | None, stature_m: float | None) -> tuple[Skeleton, Array]:
    if model is not None:
        body = smpl_body(model, content["betas"])
        return body.skeleton, body.p_model_pelvis
    if content["joint_offsets"] is not None and stature_m is None:
        bare = Skeleton(content["joint_offsets"])
        landmarks = skeleton_from_stature(stature_of(bare)).landmarks
        return Skeleton(bare.p_parent_joint, landmarks, "joint offsets of the file"), P_MODEL_PELVIS
    sex = content["gender"] if content["gender"] in ("male", "female") else None
    return skeleton_from_stature(stature_m or STATURE_M[sex], sex), P_MODEL_PELVIS


def _read(path: Path) -> dict[str, Any]:
    names = ("poses", "trans", "betas", "gender", "joint_offsets", *RATE_NAMES)
    file = read_npz(path, "not an AMASS npz", names)
    missing = [name for name in ("poses", "trans") if name not in file]
    if missing:
        raise FileFormatError(f"{path}: lacks {', '.join(missing)}; expected a motion file of AMASS")
    try:
        rates = [float(file[name].ravel()[0]) for name in RATE_NAMES if name in file]
        return {
            "poses": np.asarray(file["poses"], dtype=float),
            "trans": np.asarray(file["trans"], dtype=float),
            "betas": np.asarray(file["betas"], dtype=float).ravel() if "betas" in file else None,
            "gender": _text(file["gender"]) if "gender" in file else "",
            "rate": rates[0] if rates else None,
            "joint_offsets": np.asarray(file["joint_offsets"], dtype=float) if "joint_offsets" in file else None,
        }
    except (IndexError, TypeError, ValueError) as error:  # empty, or no numbers
        raise FileFormatError(f"{path}: not an AMASS npz ({error})") from error


def _text(value: Array) -> str:
    """``male``, however the file stores it: text, bytes, or the text of bytes."""
    item = np.asarray(value).ravel()[0]
    text = item.decode() if isinstance(item, bytes) else str(item)
    return text.removeprefix("b'").strip("'").lower()


@dataclass(frozen=True)
class SmplBody:
    """A model's skeleton, with landmarks from the skin, and where its pelvis lies in the model's own frame, ``(3,)``
    metres: SMPL's ``trans`` moves the model's origin, ``p_world_pelvis = trans + p_model_pelvis``.
    """

    skeleton: Skeleton
    p_model_pelvis: Array


def smpl_body(path: str | Path, betas: Sequence[float] | Array | None = None) -> SmplBody:
    """The body of a SMPL model file of these shape coefficients (the mean shape if none).

    Raises:
        FileFormatError: if the file is not such a model.
        InputError: for more coefficients than the model has.
    """
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
