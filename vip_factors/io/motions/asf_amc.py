"""ASF/AMC: a skeleton in one file, its motion in another (Acclaim; the originals of the CMU database)."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import Array, rotation_x, rotation_y, rotation_z
from vip_factors.io.motions.retarget import retarget
from vip_factors.io.motions.skeleton_maps import SourceClip, rest_positions, source_kinematics
from vip_factors.io.typed_files import MOST_MOTION_BYTES, read_text

TURNS = {"x": rotation_x, "y": rotation_y, "z": rotation_z}
ROOT_CHANNELS = ("tx", "ty", "tz", "rx", "ry", "rz")
INCH_M = 0.0254  # CMU's files say "length 0.45": their lengths are inches times 0.45


@dataclass
class AsfBone:
    """One bone: where it points at rest, how long it is, and about which axes it turns."""

    name: str
    direction: Array = field(default_factory=lambda: np.zeros(3))
    length: float = 0.0
    axis: Array = field(default_factory=lambda: np.eye(3))
    dof: tuple[str, ...] = ()

    @property
    def vector(self) -> Array:
        """From the bone's start to its end at rest, in file units."""
        norm = np.linalg.norm(self.direction)
        return self.length * self.direction / (norm if norm > 0 else 1.0)


@dataclass
class AsfSkeleton:
    """Bones by name, ``root`` among them; ``parents`` names each bone's parent, which stands before it."""

    bones: dict[str, AsfBone]
    parents: dict[str, str]
    degrees: bool
    unit_m: float


def rotation_in_order(angles: Array, order: str) -> Array:
    """Rotations ``(..., 3, 3)`` about fixed axes, the first named first: "xyz" is ``Rz Ry Rx``."""
    R = np.broadcast_to(np.eye(3), (*angles.shape[:-1], 3, 3))
    for column, axis in enumerate(order):
        R = TURNS[axis](angles[..., column]) @ R
    return R


def read_asf(path: str | Path) -> AsfSkeleton:
    """The skeleton in an ASF file.

    Raises:
        FileFormatError: for a malformed file, naming the line.
    """
    path = Path(path)
    lines = read_text(path, "an ASF skeleton", most_bytes=MOST_MOTION_BYTES).splitlines()
    skeleton = AsfSkeleton({"root": AsfBone("root", dof=ROOT_CHANNELS)}, {}, True, 1.0)
    section, bone = "", AsfBone("")
    for number, line in enumerate(lines, start=1):
        words = line.partition("#")[0].split()
        if words and words[0].startswith(":"):
            section = words[0].lower()
        elif words:
            try:
                bone = _take_line(skeleton, bone, section, words)
            except (ValueError, IndexError, KeyError) as error:
                raise FileFormatError(f"{path}, line {number}: '{line.strip()[:60]}' in {section}: {error}") from error
    if len(skeleton.parents) < 2:
        raise FileFormatError(f"{path}: no :hierarchy of bones found; expected an ASF skeleton")
    return skeleton


def _take_line(skeleton: AsfSkeleton, bone: AsfBone, section: str, words: list[str]) -> AsfBone:
    """Put a line's content into the skeleton, or into the bone that is being described; the bone of the next line."""
    root = skeleton.bones["root"]
    match section, words[0].lower():
        case ":units", "length":
            length = float(words[1])
            if not 0 < length < np.inf:
                raise ValueError("expected a length above zero")
            skeleton.unit_m = INCH_M / length
        case ":units", "angle":
            skeleton.degrees = words[1].lower().startswith("deg")
        case ":root", "order":
            root.dof = tuple(word.lower() for word in words[1:])
        case ":root", "orientation":
            root.axis = rotation_in_order(_angles(words[1:4], skeleton.degrees), "xyz")
        case ":bonedata", "begin":
            return AsfBone("")
        case ":bonedata", "name":
            bone.name = words[1]
            skeleton.bones[bone.name] = bone
        case ":bonedata", "direction":
            bone.direction = _three_numbers(words[1:4])
        case ":bonedata", "length":
            bone.length = float(words[1])
            if not np.isfinite(bone.length):
                raise ValueError("expected a length")
        case ":bonedata", "axis":
            order = words[4].lower() if len(words) > 4 else "xyz"
            bone.axis = rotation_in_order(_angles(words[1:4], skeleton.degrees), order)
        case ":bonedata", "dof":
            bone.dof = tuple(word.lower() for word in words[1:])
        case ":hierarchy", key if key not in ("begin", "end"):
            _take_children(skeleton, words)
    return bone


def _three_numbers(words: list[str]) -> Array:
    numbers = np.array(words, dtype=float)
    if len(numbers) != 3 or not np.all(np.isfinite(numbers)):
        raise ValueError("expected three numbers")
    return numbers


def _angles(words: list[str], degrees: bool) -> Array:
    numbers = _three_numbers(words)
    return np.radians(numbers) if degrees else numbers


def _take_children(skeleton: AsfSkeleton, words: list[str]) -> None:
    for name in words:
        if name not in skeleton.bones:
            raise KeyError(f"bone '{name}' is not among :bonedata")
    if words[0] != "root" and words[0] not in skeleton.parents:
        raise ValueError(f"bone '{words[0]}' has children before it has a parent")
    for child in words[1:]:
        skeleton.parents[child] = words[0]


CMU_RATE = 120.0  # an AMC file does not say its rate; the CMU database's is this


def read_amc(path: str | Path, asf: str | Path | None = None) -> Motion:
    """An AMC file as a motion of our skeleton, with the bone lengths of its ASF: Z up, metres, 120 Hz.

    Args:
        path: the AMC file. A file cut short gives the frames it holds whole.
        asf: its skeleton; if not given, the file beside it that is named after the subject (``07.asf`` for
            ``07_01.amc``), or the only one there.

    Raises:
        FileFormatError: for a malformed file.
        InputError: if no skeleton is found, or it is not a known one.
    """
    path = Path(path)
    skeleton = read_asf(Path(asf) if asf else _find_asf(path))
    return retarget(_clip(skeleton, _read_frames(path, skeleton), path), skeleton.unit_m)


def _find_asf(path: Path) -> Path:
    named = path.with_name(path.stem.partition("_")[0] + ".asf")
    if named.is_file():
        return named
    beside = sorted(path.parent.glob("*.asf"))
    if len(beside) != 1:
        raise InputError(
            f"{path}: {len(beside)} ASF skeletons beside it and none named {named.name}: give the skeleton's file"
        )
    return beside[0]


def _read_frames(path: Path, skeleton: AsfSkeleton) -> dict[str, Array]:
    """Channel values ``(T, channels)`` of each bone, in the file's unit; the frames that are whole."""
    lines = read_text(path, "an AMC motion", most_bytes=MOST_MOTION_BYTES).splitlines()
    moving = {name: bone.dof for name, bone in skeleton.bones.items() if bone.dof}
    rows: dict[str, list[list[float]]] = {name: [] for name in moving}
    frames = 0
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if not words or words[0][0] in "#:":
            continue
        if len(words) == 1 and words[0].isdigit():
            short = [name for name, found in rows.items() if len(found) != frames]
            if short:
                raise FileFormatError(
                    f"{path}, line {number}: the frame before lacks {', '.join(short[:4])}, or has it twice"
                )
            frames += 1
            continue
        if words[0] not in moving or not frames:
            raise FileFormatError(
                f"{path}, line {number}: '{line.strip()[:60]}': expected a frame number or a moving bone of its ASF"
            )
        values = _numbers(words[1:])
        if len(values) != len(moving[words[0]]):
            if number == len(lines):
                break  # a last line cut off in writing
            raise FileFormatError(
                f"{path}, line {number}: '{line.strip()[:60]}': expected {len(moving[words[0]])} numbers for {words[0]}"
            )
        rows[words[0]].append(values)
    whole = min(map(len, rows.values()))
    if not whole:
        raise FileFormatError(f"{path}: not one whole frame; expected an AMC motion of the skeleton's bones")
    return {name: np.array(found[:whole]) for name, found in rows.items()}


def _numbers(words: list[str]) -> list[float]:
    try:
        values = [float(word) for word in words]
    except ValueError:
        return []
    return values if np.all(np.isfinite(values)) else []


def _clip(skeleton: AsfSkeleton, frames: dict[str, Array], path: Path) -> SourceClip:
    """A node per bone, at the bone's start, and one at the free end of each last bone."""
    order = ["root", *skeleton.parents]
    leaves = [name for name in order[1:] if name not in skeleton.parents.values()]
    names = [*order, *(f"{name}/end" for name in leaves)]
    parents = [-1] + [order.index(skeleton.parents[name]) for name in order[1:]] + [order.index(one) for one in leaves]
    offsets = np.array([np.zeros(3)] + [skeleton.bones[names[parent]].vector for parent in parents[1:]])
    T = len(next(iter(frames.values())))
    R = np.broadcast_to(np.eye(3), (T, len(names), 3, 3)).copy()
    p = np.broadcast_to(offsets, (T, *offsets.shape)).copy()
    for name, values in frames.items():
        if name in order:
            R[:, order.index(name)] = _turns(skeleton.bones[name], values, skeleton.degrees)
    for column, channel in enumerate(skeleton.bones["root"].dof):
        if channel in ("tx", "ty", "tz"):
            p[:, 0, "xyz".index(channel[1])] = frames["root"][:, column]
    R_world, p_world = source_kinematics(parents, p, R)
    return SourceClip(tuple(names), rest_positions(parents, offsets), R_world, p_world, CMU_RATE, path.stem, str(path))


def _turns(bone: AsfBone, values: Array, degrees: bool) -> Array:
    """How a bone turns from rest on its parent, ``(T, 3, 3)``: its channels, about its own axes."""
    columns = [column for column, channel in enumerate(bone.dof) if channel in ("rx", "ry", "rz")]
    angles = np.radians(values[:, columns]) if degrees else values[:, columns]
    M = rotation_in_order(angles, "".join(bone.dof[column][1] for column in columns))
    return bone.axis @ M @ bone.axis.T
