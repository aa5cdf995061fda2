"""Small motion files in the dialects that are read: written here, from skeletons and poses that the tests choose."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.skeleton import JOINT_NAMES, PARENTS
from vip_factors.geometry.rotations import Array, exp

# How MVN's BVH names our joints; it has no knuckles.
MVN_NAMES = {
    "pelvis": "Hips", "spine1": "Chest", "spine2": "Chest3", "spine3": "Chest4", "neck": "Neck", "head": "Head",
} | {
    f"{side.lower()}_{ours}": f"{side}{theirs}"
    for side in ("Left", "Right")
    for ours, theirs in {
        "hip": "Hip", "knee": "Knee", "ankle": "Ankle", "foot": "Toe", "collar": "Collar", "shoulder": "Shoulder",
        "elbow": "Elbow", "wrist": "Wrist",
    }.items()
}  # fmt: skip

# The cgspeed figure: its hips hang on buttocks, its feet end without toes.
CGSPEED_NAMES = {
    "pelvis": "hip", "spine1": "abdomen", "spine2": "chest", "neck": "neck", "head": "head",
} | {
    f"{side}_{ours}": f"{side[0]}{theirs}"
    for side in ("left", "right")
    for ours, theirs in {
        "hip": "Thigh", "knee": "Shin", "ankle": "Foot", "collar": "Collar", "shoulder": "Shldr", "elbow": "ForeArm",
        "wrist": "Hand", "hand": "Mid1",
    }.items()
}  # fmt: skip
SMPL_NAMES = {name: name for name in JOINT_NAMES}


def rest_skeleton() -> dict[str, Array]:
    """Offsets in metres of a T-posed body, by our joint names."""
    offsets = skeleton_from_stature(1.75).p_parent_joint
    return {name: offsets[joint] for joint, name in enumerate(JOINT_NAMES)}


def random_pose(seed: int, frames: int = 4, spread: float = 0.6) -> dict[str, Array]:
    """Joint rotations ``(frames, 3, 3)`` by our joint names."""
    rng = np.random.default_rng(seed)
    return {name: exp(rng.normal(0, spread, (frames, 3))) for name in JOINT_NAMES}


def euler_degrees(R: Array, order: str) -> Array:
    """Angles of ``R = R_first(a) R_second(b) R_third(c)``, degrees, in the order of the names."""
    from scipy.spatial.transform import Rotation

    axes: Any = order.upper()  # which of the six orders, the types cannot say
    angles: Array = Rotation.from_matrix(R).as_euler(axes, degrees=True)
    return angles


def write_bvh(
    path: Path,
    names: Mapping[str, str],
    offsets: Mapping[str, Array],
    pose: Mapping[str, Array],
    root: Array,
    *,
    order: str = "ZXY",
    scale: float = 100.0,
    frame_time: float = 0.01,
    turn: Array | None = None,
    ends: Mapping[str, Sequence[float]] | None = None,
) -> Path:
    """A BVH file of the joints in ``names``; ``turn`` takes our rest axes to the file's (Y up if not given).

    ``root`` is in metres, in the file's axes; every joint that ``names`` lacks must be a leaf or straight at rest.
    """
    A = np.eye(3) if turn is None else turn
    lines = ["HIERARCHY"]
    written: list[str] = []

    def parent_of(name: str) -> str:
        parent = JOINT_NAMES[PARENTS[JOINT_NAMES.index(name)]]
        return parent if parent in names else parent_of(parent)

    def offset_of(name: str) -> Array:
        total, joint = offsets[name], JOINT_NAMES[PARENTS[JOINT_NAMES.index(name)]]
        while joint not in names:
            total, joint = total + offsets[joint], JOINT_NAMES[PARENTS[JOINT_NAMES.index(joint)]]
        return A @ total * scale

    def emit(name: str, depth: int) -> None:
        pad = "  " * depth
        written.append(name)
        shift = "6 Xposition Yposition Zposition" if name == "pelvis" else "3"
        place = np.zeros(3) if name == "pelvis" else offset_of(name)
        lines.append(f"{pad}{'ROOT' if name == 'pelvis' else 'JOINT'} {names[name]}")
        lines.append(f"{pad}{{\n{pad}  OFFSET {place[0]:.9f} {place[1]:.9f} {place[2]:.9f}")
        lines.append(f"{pad}  CHANNELS {shift} " + " ".join(f"{axis}rotation" for axis in order))
        children = [other for other in names if other != "pelvis" and parent_of(other) == name]
        for child in children:
            emit(child, depth + 1)
        if not children:
            x, y, z = A @ np.asarray((ends or {}).get(name, (0.0, 0.05, 0.0))) * scale
            lines.append(f"{pad}  End Site\n{pad}  {{\n{pad}    OFFSET {x:.9f} {y:.9f} {z:.9f}\n{pad}  }}")
        lines.append(f"{pad}}}")

    emit("pelvis", 0)
    columns = [root * scale] + [euler_degrees(A @ pose[name] @ A.T, order) for name in written]
    lines += ["MOTION", f"Frames: {len(root)}", f"Frame Time: {frame_time:.8f}"]
    lines += [" ".join(f"{value:.9f}" for value in row) for row in np.concatenate(columns, axis=1)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path
