"""Motion files: BVH (a hierarchy of joints, then one line of numbers a frame), and AMASS (npz with SMPL's poses)."""

import math
import sys
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.kinematics import Motion
from vip_factors.body.lengths import stature_of
from vip_factors.body.skeleton import JOINT_COUNT, LONGEST_BONE_M, Skeleton
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import Array, exp, rotation_x, rotation_y, rotation_z
from vip_factors.io.motions.retarget import retarget, without_rest_frames
from vip_factors.io.motions.skeleton_maps import SourceClip, source_kinematics
from vip_factors.io.typed_files import MOST_MOTION_BYTES, read_text

TURNS = {"xrotation": rotation_x, "yrotation": rotation_y, "zrotation": rotation_z}
SHIFTS = {"xposition": 0, "yposition": 1, "zposition": 2}


@dataclass
class _Node:
    name: str
    parent: int  # number of a node before, −1 for a root
    offset: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    channels: list[str] = field(default_factory=list)


def read_bvh(path: str | Path) -> Motion:
    """Read a BVH file as a motion of our skeleton: Z up, metres.

    Joint names determine the skeleton's family, its rest pose up and left, its stature the unit. A rest pose that an
    exporter put before the take (MVN, cgspeed) is left out.

    Args:
        path: the file. A file cut short gives the frames it holds whole.

    Raises:
        FileFormatError: for a malformed file.
        InputError: for a skeleton that is not a known one or not a body.
    """
    return retarget(without_rest_frames(read_bvh_clip(path)))


def read_bvh_clip(path: str | Path) -> SourceClip:
    """Read a BVH file with its own skeleton, axes and unit."""
    path = Path(path)
    lines = read_text(path, "a BVH file", most_bytes=MOST_MOTION_BYTES).splitlines()
    numbered = iter(enumerate(lines, start=1))
    nodes = _parse_hierarchy(numbered, path)
    frame_time, values = _parse_motion(lines, numbered, sum(len(node.channels) for node in nodes), path)
    offsets = np.array([node.offset for node in nodes])
    names, parents = tuple(node.name for node in nodes), tuple(node.parent for node in nodes)
    R_parent_node, p_parent_node = _local_poses([node.channels for node in nodes], offsets, values)
    R_world, p_world = source_kinematics(parents, p_parent_node, R_parent_node)
    upright = np.broadcast_to(np.eye(3), (1, len(offsets), 3, 3))
    _, p_rest = source_kinematics(parents, offsets[None], upright)
    return SourceClip(names, parents, p_rest[0], R_world, p_world, _rate(frame_time), path.stem, str(path))


def _rate(frame_time: float) -> float:
    """Frames per second; a frame time written with few digits (0.016667) means the whole number beside it."""
    rate = 1.0 / frame_time
    return float(round(rate)) if abs(rate - round(rate)) < 1e-4 * rate else rate


def _parse_hierarchy(numbered: Iterator[tuple[int, str]], path: Path) -> list[_Node]:
    """Everything before the line ``MOTION``, which is consumed."""
    nodes: list[_Node] = []
    stack: list[int] = []
    for number, line in numbered:
        words = line.replace("{", " { ").replace("}", " } ").split()
        while words:
            word = words.pop(0).upper()
            if word in ("ROOT", "JOINT", "END"):
                parent = stack[-1] if stack else -1
                name = " ".join(words).partition("{")[0].strip()
                if word == "END":
                    name = f"{nodes[parent].name}/end" if parent >= 0 else "/end"
                stack.append(len(nodes))
                nodes.append(_Node(name, parent))
                words = words[words.index("{") :] if "{" in words else []
            elif word in ("OFFSET", "CHANNELS") and not nodes:
                raise FileFormatError(f"{path}, line {number}: {word} before the first ROOT")
            elif word == "OFFSET":
                nodes[-1].offset = _floats(words[:3], 3, number, path)
                words = words[3:]
            elif word == "CHANNELS":
                count = int(words[0]) if words and words[0].isdigit() else -1
                channels = [channel.lower() for channel in words[1 : count + 1]]
                if len(channels) != count or set(channels) - TURNS.keys() - SHIFTS.keys():
                    raise FileFormatError(
                        f"{path}, line {number}: '{line.strip()}': expected CHANNELS, their number, and that many "
                        "of Xposition … Zrotation"
                    )
                nodes[-1].channels = channels
                words = words[count + 1 :]
            elif word == "}" and stack:
                stack.pop()
            elif word == "MOTION":
                if not nodes or stack:
                    raise FileFormatError(f"{path}, line {number}: MOTION before the hierarchy is complete")
                return nodes
            elif word not in ("{", "HIERARCHY"):
                raise FileFormatError(
                    f"{path}, line {number}: '{line.strip()[:60]}': expected HIERARCHY, ROOT, JOINT, End Site, OFFSET "
                    "or CHANNELS; is this a BVH file?"
                )
    raise FileFormatError(f"{path}: no line MOTION: this is not a BVH file, or it is cut off in its hierarchy")


def _floats(words: list[str], count: int, number: int, path: Path) -> list[float]:
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) != count:
        raise FileFormatError(f"{path}, line {number}: '{' '.join(words)}': expected {count} number(s)")
    return values


def _parse_motion(lines: list[str], numbered: Iterator[tuple[int, str]], width: int, path: Path) -> tuple[float, Array]:
    """Frame time in seconds and the numbers ``(T, width)`` of all whole frames."""
    frame_time, number = 0.0, len(lines)
    for number, line in numbered:
        key, _, value = line.partition(":")
        if key.strip().lower() == "frame time":
            frame_time = _floats(value.split()[:1], 1, number, path)[0]
            break
    if not frame_time > 0:
        raise FileFormatError(f"{path}: no line 'Frame Time: seconds' with a positive number after MOTION")
    rows = [(line_number, line) for line_number, line in enumerate(lines[number:], start=number + 1) if line.strip()]
    if rows and len(rows[-1][1].split()) < width:
        rows.pop()  # a last line cut off in writing
    if not rows:
        raise FileFormatError(f"{path}: no frame of {width} numbers after line {number}; expected at least one")
    try:
        values = np.loadtxt([line for _, line in rows], dtype=float, comments=None, ndmin=2)
    except ValueError:
        values = np.empty((0, 0))
    if values.shape[1] != width or not np.all(np.isfinite(values)):
        for line_number, line in rows:
            row = _floats(line.split(), width, line_number, path)
            if not np.all(np.isfinite(row)):
                raise FileFormatError(f"{path}, line {line_number}: a number is not finite")
    return frame_time, values


def _local_poses(channels_of_node: list[list[str]], offsets: Array, values: Array) -> tuple[Array, Array]:
    """``R_parent_node`` ``(T, N, 3, 3)`` and ``p_parent_node`` ``(T, N, 3)``; turns are degrees, applied in order."""
    R = np.broadcast_to(np.eye(3), (len(values), len(offsets), 3, 3)).copy()
    p = np.broadcast_to(offsets, (len(values), *offsets.shape)).copy()
    column = 0
    for node, channels in enumerate(channels_of_node):
        for channel in channels:
            if channel in SHIFTS:
                p[:, node, SHIFTS[channel]] = values[:, column]
            else:
                R[:, node] = R[:, node] @ TURNS[channel](np.radians(values[:, column]))
            column += 1
    return R, p


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
    file = _read_npz(path, names)
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


def _read_npz(path: Path, names: Collection[str]) -> dict[str, Any]:
    """Those of the arrays ``names`` that are in an archive, which may be damaged."""
    try:
        with np.load(path, allow_pickle=False) as file:
            names = [name for name in file.files if name in names]
            for name in names:
                _check_size(file, name)
            return {name: _checked_text(name, file[name]) for name in names}
    except Exception as error:  # NumPy, zipfile, zlib and tokenize raise a dozen kinds
        raise FileFormatError(f"{path}: not an AMASS npz ({error or 'it is truncated'})") from error


def _check_size(file: Any, name: str) -> None:
    """Refuse an array that claims to be larger than its file in the archive, before memory is allocated."""
    with file.zip.open(f"{name}.npy") as array_file:
        version = np.lib.format.read_magic(array_file)
        read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, kind = read_header(array_file)
    if math.prod(shape) * kind.itemsize > file.zip.getinfo(f"{name}.npy").file_size:
        raise ValueError(f"{name} has the shape {shape} in its header, for which the file is too short")


def _checked_text(name: str, value: Any) -> Any:
    """Refuse text with invalid code points, which fails later in Python."""
    if value.dtype.kind == "U" and value.size:
        codes = np.ascontiguousarray(value).reshape(-1).view(np.dtype("u4").newbyteorder(value.dtype.byteorder))
        if codes.max() > sys.maxunicode:
            raise ValueError(f"{name} is not valid text")
    return value


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
