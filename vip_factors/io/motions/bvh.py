"""BVH: a hierarchy of joints with offsets and channels, then one line of numbers a frame."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.errors import FileFormatError
from vip_factors.geometry.rotations import Array, rotation_x, rotation_y, rotation_z
from vip_factors.io.motions.retarget import retarget, without_rest_frames
from vip_factors.io.motions.skeleton_maps import SourceClip, source_kinematics
from vip_factors.io.typed_files import MOST_MOTION_BYTES, read_text

TURNS = {"xrotation": rotation_x, "yrotation": rotation_y, "zrotation": rotation_z}
SHIFTS = {"xposition": 0, "yposition": 1, "zposition": 2}


@dataclass
class _Hierarchy:
    names: list[str] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    offsets: list[list[float]] = field(default_factory=list)
    channels: list[list[str]] = field(default_factory=list)

    @property
    def width(self) -> int:
        return sum(map(len, self.channels))


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
    hierarchy = _parse_hierarchy(numbered, path)
    frame_time, values = _parse_motion(lines, numbered, hierarchy.width, path)
    offsets = np.array(hierarchy.offsets)
    R_parent_node, p_parent_node = _local_poses(hierarchy, offsets, values)
    R_world, p_world = source_kinematics(hierarchy.parents, p_parent_node, R_parent_node)
    upright = np.broadcast_to(np.eye(3), (1, len(offsets), 3, 3))
    _, p_rest = source_kinematics(hierarchy.parents, offsets[None], upright)
    names, parents = tuple(hierarchy.names), tuple(hierarchy.parents)
    return SourceClip(names, parents, p_rest[0], R_world, p_world, _rate(frame_time), path.stem, str(path))


def _rate(frame_time: float) -> float:
    """Frames per second; a frame time written with few digits (0.016667) means the whole number beside it."""
    rate = 1.0 / frame_time
    return float(round(rate)) if abs(rate - round(rate)) < 1e-4 * rate else rate


def _parse_hierarchy(numbered: Iterator[tuple[int, str]], path: Path) -> _Hierarchy:
    """Everything before the line ``MOTION``, which is consumed."""
    hierarchy = _Hierarchy()
    stack: list[int] = []
    for number, line in numbered:
        words = line.replace("{", " { ").replace("}", " } ").split()
        while words:
            word = words.pop(0).upper()
            if word in ("ROOT", "JOINT", "END"):
                _open_node(hierarchy, stack, word, " ".join(words).partition("{")[0].strip())
                words = words[words.index("{") :] if "{" in words else []
            elif word in ("OFFSET", "CHANNELS") and not hierarchy.names:
                raise FileFormatError(f"{path}, line {number}: {word} before the first ROOT")
            elif word == "OFFSET":
                hierarchy.offsets[-1] = _floats(words[:3], 3, number, path)
                words = words[3:]
            elif word == "CHANNELS":
                count = int(words[0]) if words and words[0].isdigit() else -1
                channels = [channel.lower() for channel in words[1 : count + 1]]
                if len(channels) != count or set(channels) - TURNS.keys() - SHIFTS.keys():
                    raise FileFormatError(
                        f"{path}, line {number}: '{line.strip()}': expected CHANNELS, their number, and that many "
                        "of Xposition … Zrotation"
                    )
                hierarchy.channels[-1] = channels
                words = words[count + 1 :]
            elif word == "}" and stack:
                stack.pop()
            elif word == "MOTION":
                if not hierarchy.names or stack:
                    raise FileFormatError(f"{path}, line {number}: MOTION before the hierarchy is complete")
                return hierarchy
            elif word not in ("{", "HIERARCHY"):
                raise FileFormatError(
                    f"{path}, line {number}: '{line.strip()[:60]}': expected HIERARCHY, ROOT, JOINT, End Site, OFFSET "
                    "or CHANNELS; is this a BVH file?"
                )
    raise FileFormatError(f"{path}: no line MOTION: this is not a BVH file, or it is cut off in its hierarchy")


def _open_node(hierarchy: _Hierarchy, stack: list[int], word: str, name: str) -> None:
    parent = stack[-1] if stack else -1
    if word == "END":
        name = f"{hierarchy.names[parent]}/end" if parent >= 0 else "/end"
    hierarchy.names.append(name)
    hierarchy.parents.append(parent)
    hierarchy.offsets.append([0.0, 0.0, 0.0])
    hierarchy.channels.append([])
    stack.append(len(hierarchy.names) - 1)


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


def _local_poses(hierarchy: _Hierarchy, offsets: Array, values: Array) -> tuple[Array, Array]:
    """``R_parent_node`` ``(T, N, 3, 3)`` and ``p_parent_node`` ``(T, N, 3)``; turns are degrees, applied in order."""
    R = np.broadcast_to(np.eye(3), (len(values), len(offsets), 3, 3)).copy()
    p = np.broadcast_to(offsets, (len(values), *offsets.shape)).copy()
    column = 0
    for node, channels in enumerate(hierarchy.channels):
        for channel in channels:
            if channel in SHIFTS:
                p[:, node, SHIFTS[channel]] = values[:, column]
            else:
                R[:, node] = R[:, node] @ TURNS[channel](np.radians(values[:, column]))
            column += 1
    return R, p
