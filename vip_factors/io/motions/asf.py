"""ASF: the skeleton of an AMC motion, bone by bone, each with its own axes."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from vip_factors.errors import FileFormatError
from vip_factors.geometry.rotations import Array, rotation_x, rotation_y, rotation_z

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
    try:
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read ({error.strerror}); expected an ASF skeleton") from error
    skeleton = AsfSkeleton({"root": AsfBone("root", dof=ROOT_CHANNELS)}, {}, True, 1.0)
    section, bone = "", AsfBone("")
    for number, line in enumerate(lines, start=1):
        words = line.partition("#")[0].split()
        if not words:
            continue
        try:
            if words[0].startswith(":"):
                section = words[0].lower()
            elif section == ":units":
                _units(skeleton, words)
            elif section == ":root":
                _root(skeleton.bones["root"], words, skeleton.degrees)
            elif section == ":bonedata":
                bone = _bone_line(skeleton, bone, words)
            elif section == ":hierarchy" and words[0] not in ("begin", "end"):
                _children(skeleton, words)
        except (ValueError, IndexError, KeyError) as error:
            raise FileFormatError(f"{path}, line {number}: '{line.strip()[:60]}' in {section}: {error}") from error
    if len(skeleton.parents) < 2:
        raise FileFormatError(f"{path}: no :hierarchy of bones found; expected an ASF skeleton")
    return skeleton


def _units(skeleton: AsfSkeleton, words: list[str]) -> None:
    if words[0] == "length":
        length = float(words[1])
        if not 0 < length < np.inf:
            raise ValueError("expected a length above zero")
        skeleton.unit_m = INCH_M / length
    elif words[0] == "angle":
        skeleton.degrees = words[1].lower().startswith("deg")


def _root(root: AsfBone, words: list[str], degrees: bool) -> None:
    if words[0] == "order":
        root.dof = tuple(word.lower() for word in words[1:])
    elif words[0] == "orientation":
        root.axis = _axis(words[1:4], "xyz", degrees)


def _axis(angles: list[str], order: str, degrees: bool) -> Array:
    values = np.array([float(word) for word in angles])
    if len(values) != 3:
        raise ValueError("expected three angles")
    return rotation_in_order(np.radians(values) if degrees else values, order)


def _bone_line(skeleton: AsfSkeleton, bone: AsfBone, words: list[str]) -> AsfBone:
    key = words[0].lower()
    if key == "begin":
        return AsfBone("")
    if key == "name":
        bone.name = words[1]
        skeleton.bones[bone.name] = bone
    elif key == "direction":
        bone.direction = np.array([float(word) for word in words[1:4]])
        if len(bone.direction) != 3 or not np.all(np.isfinite(bone.direction)):
            raise ValueError("expected three numbers")
    elif key == "length":
        bone.length = float(words[1])
        if not np.isfinite(bone.length):
            raise ValueError("expected a length")
    elif key == "axis":
        bone.axis = _axis(words[1:4], (words[4] if len(words) > 4 else "xyz").lower(), skeleton.degrees)
    elif key == "dof":
        bone.dof = tuple(word.lower() for word in words[1:])
    return bone


def _children(skeleton: AsfSkeleton, words: list[str]) -> None:
    for name in words:
        if name not in skeleton.bones:
            raise KeyError(f"bone '{name}' is not among :bonedata")
    if words[0] != "root" and words[0] not in skeleton.parents:
        raise ValueError(f"bone '{words[0]}' has children before it has a parent")
    for child in words[1:]:
        skeleton.parents[child] = words[0]
