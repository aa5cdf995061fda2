"""The skeleton of a user's own SMPL, SMPL-H or SMPL-X model file. Nothing of the model ships with this package."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vip_factors.body.npz_file import read_npz
from vip_factors.body.skeleton import JOINT_COUNT, JOINT_NAMES, PARENTS, Landmark, Skeleton, joint_index
from vip_factors.body.smpl_pickle import dense, read_smpl_pickle
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import Array

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
