"""Motion files on our skeleton: BVH, and AMASS npz (SMPL-H or SMPL-X pose vectors and root path, Z up)."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.kinematics import Motion
from vip_factors.body.lengths import stature_of
from vip_factors.body.npz_file import read_npz
from vip_factors.body.skeleton import JOINT_COUNT, LONGEST_BONE_M, Skeleton
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import Array, exp
from vip_factors.io.motions.bvh import read_bvh

__all__ = ["MOTION_SUFFIXES", "motion_files", "read_amass", "read_bvh", "read_motion"]

BODY_JOINTS = 22  # pelvis and joints 1 … 21 are the same in SMPL, SMPL-H and SMPL-X
POSE_WIDTHS = (72, 156, 165)
RATE_NAMES = ("mocap_framerate", "mocap_frame_rate", "fps")
# Round statures of European adults, and the pelvis of the mean SMPL shape.
STATURE_M = {"male": 1.78, "female": 1.65, None: 1.71}
P_MODEL_PELVIS = np.array([0.0, -0.23, 0.03])


def read_amass(path: str | Path) -> Motion:
    """Read an AMASS file as a motion of our skeleton, with hands rigid at the wrists.

    The body is the skeleton that this package's export puts beside the poses, or one of usual stature by ``gender``.

    Args:
        path: npz with ``poses`` ``(T, 156)`` or ``(T, 165)`` (or SMPL's 72), ``trans`` and a frame rate.

    Raises:
        FileFormatError: if the file is not of that form.
        InputError: for a file without a frame rate.
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
    if content["rate"] is None:
        raise InputError(f"{path}: expected frames per second as one of {', '.join(RATE_NAMES)}")
    R_parent_child = np.broadcast_to(np.eye(3), (T, JOINT_COUNT, 3, 3)).copy()
    R_parent_child[:, :BODY_JOINTS] = exp(poses[:, : 3 * BODY_JOINTS].reshape(T, BODY_JOINTS, 3))
    return Motion(_skeleton(content), R_parent_child, trans + P_MODEL_PELVIS, content["rate"], name=path.stem)


def _skeleton(content: dict[str, Any]) -> Skeleton:
    if content["joint_offsets"] is not None:
        bare = Skeleton(content["joint_offsets"])
        landmarks = skeleton_from_stature(stature_of(bare)).landmarks
        return Skeleton(bare.p_parent_joint, landmarks, "joint offsets of the file")
    sex = content["gender"] if content["gender"] in ("male", "female") else None
    return skeleton_from_stature(STATURE_M[sex], sex)


def _read(path: Path) -> dict[str, Any]:
    names = ("poses", "trans", "gender", "joint_offsets", *RATE_NAMES)
    file = read_npz(path, "not an AMASS npz", names)
    missing = [name for name in ("poses", "trans") if name not in file]
    if missing:
        raise FileFormatError(f"{path}: lacks {', '.join(missing)}; expected a motion file of AMASS")
    try:
        rates = [float(file[name].ravel()[0]) for name in RATE_NAMES if name in file]
        return {
            "poses": np.asarray(file["poses"], dtype=float),
            "trans": np.asarray(file["trans"], dtype=float),
            "gender": _text(file["gender"]) if "gender" in file else "",
            "rate": rates[0] if rates else None,
            "joint_offsets": np.asarray(file["joint_offsets"], dtype=float) if "joint_offsets" in file else None,
        }
    except (IndexError, TypeError, ValueError) as error:  # empty, or no numbers
        raise FileFormatError(f"{path}: not an AMASS npz ({error})") from error


def _text(value: Array) -> str:
    """``male``, however the file stores it: text, bytes, or the text of bytes."""
    scalar = np.asarray(value).ravel()[0]
    text = scalar.decode() if isinstance(scalar, bytes) else str(scalar)
    return text.removeprefix("b'").strip("'").lower()


READERS: dict[str, Callable[[Path], Motion]] = {".bvh": read_bvh, ".npz": read_amass}
MOTION_SUFFIXES = tuple(READERS)


def read_motion(path: str | Path) -> Motion:
    """Read a motion file of any known kind, by its suffix, on our skeleton, Z up, metres.

    Raises:
        InputError: for an unknown suffix.
        FileFormatError: for a malformed file.
    """
    path = Path(path)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise InputError(f"{path}: expected a motion as BVH (.bvh) or AMASS (.npz)")
    return reader(path)


def motion_files(folder: str | Path) -> list[Path]:
    """All motion files in a folder and below, sorted; AMASS's files of a shape without a motion are not among them."""
    paths = (path for path in Path(folder).rglob("*") if path.suffix.lower() in MOTION_SUFFIXES)
    return sorted(path for path in paths if not (path.suffix == ".npz" and path.stem.endswith(("shape", "stagei"))))
