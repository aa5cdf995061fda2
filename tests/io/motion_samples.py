"""Small motion files in the dialects that are read: written here, from skeletons and poses that the tests choose."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import JOINT_NAMES, PARENTS, Skeleton
from vip_factors.geometry.rotations import Array, exp, rotation_x, rotation_z

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


# SlimeVR's skeleton as its server assembles it: bone → bone above, our bone that its tracker sits on, and where it
# points when the wearer stands and looks along −z. Its tail is the head of the bones below.
_DOWN = (0.0, -1.0, 0.0)
SLIMEVR = {
    "HEAD": ("", "head", (0, 0, 1)), "NECK": ("HEAD", "neck", _DOWN), "UPPER_CHEST": ("NECK", "spine3", _DOWN),
    "CHEST": ("UPPER_CHEST", "spine2", _DOWN), "WAIST": ("CHEST", "spine1", _DOWN), "HIP": ("WAIST", "pelvis", _DOWN),
} | {
    f"{side}_{bone}": (f"{side}_{above}" if sided else above, f"{side.lower()}_{ours}" if limb else ours, direction)
    for side, x in (("LEFT", -1.0), ("RIGHT", 1.0))
    for bone, above, sided, ours, limb, direction in (
        ("HIP", "HIP", False, "pelvis", False, (x, 0, 0)), ("UPPER_LEG", "HIP", True, "hip", True, _DOWN),
        ("LOWER_LEG", "UPPER_LEG", True, "knee", True, _DOWN), ("FOOT", "LOWER_LEG", True, "ankle", True, (0, 0, -1)),
        ("UPPER_SHOULDER", "NECK", False, "spine3", False, _DOWN),
        ("SHOULDER", "UPPER_SHOULDER", True, "spine3", False, (0.9 * x, -0.4, 0)),
        ("UPPER_ARM", "SHOULDER", True, "shoulder", True, _DOWN),
        ("LOWER_ARM", "UPPER_ARM", True, "elbow", True, _DOWN),
        ("HAND", "LOWER_ARM", True, "wrist", True, _DOWN),
    )
}  # fmt: skip


def slimevr_body() -> Skeleton:
    """A body that SlimeVR's skeleton has without remainder: trunk and limbs without bends, collars of no length."""
    offsets = {"spine1": (0, 0.1, 0), "spine2": (0, 0.12, 0), "spine3": (0, 0.12, 0), "neck": (0, 0.2, 0)}
    offsets["head"] = (0, 0.1, 0)
    for side, x in (("left", 1.0), ("right", -1.0)):
        offsets |= {
            f"{side}_{joint}": offset
            for joint, offset in {
                "hip": (0.09 * x, 0, 0), "knee": (0, -0.42, 0), "ankle": (0, -0.41, 0), "foot": (0, 0, 0.12),
                "collar": (0, 0.2, 0), "shoulder": (0.18 * x, -0.08, 0), "elbow": (0.28 * x, 0, 0),
                "wrist": (0.26 * x, 0, 0), "hand": (0.08 * x, 0, 0),
            }.items()
        }  # fmt: skip
    return Skeleton(np.array([offsets.get(name, (0, 0, 0)) for name in JOINT_NAMES], float))


def write_slimevr(path: Path, motion: Motion) -> Path:
    """The motion as SlimeVR's server records it: from the eyes down, all bones hanging down at rest, metres, y up."""
    from scipy.spatial.transform import Rotation

    half_turn = np.diag([-1.0, 1.0, -1.0])  # SlimeVR has x to the right and −z forward
    world = half_turn @ rotation_x(-np.pi / 2)
    p_of = dict(zip(JOINT_NAMES, np.moveaxis(motion.state.p_world_joint @ world.T, 1, 0), strict=True))
    R_of: dict[str, Array] = {}
    for bone, (_, ours, direction) in SLIMEVR.items():
        lowered = (
            rotation_z({"l": -np.pi / 2, "r": np.pi / 2}[ours[0]]) if "ARM" in bone or "HAND" in bone else np.eye(3)
        )
        tracker = world @ motion.state.R_world_bone[:, JOINT_NAMES.index(ours)] @ lowered.T @ half_turn
        R_of[bone] = tracker @ Rotation.align_vectors([direction], [_DOWN])[0].as_matrix()
    lengths = {"HEAD": 0.1, "NECK": 0.1, "UPPER_CHEST": 0.2, "CHEST": 0.12, "WAIST": 0.12, "HIP": 0.1}
    for side in ("LEFT", "RIGHT"):
        lengths |= {
            f"{side}_{bone}": length
            for bone, length in {
                "HIP": 0.09, "UPPER_LEG": 0.42, "LOWER_LEG": 0.41, "FOOT": 0.12, "UPPER_SHOULDER": 0.0,
                "SHOULDER": float(np.hypot(0.18, 0.08)), "UPPER_ARM": 0.28, "LOWER_ARM": 0.26, "HAND": 0.08,
            }.items()
        }  # fmt: skip
    lines, columns = ["HIERARCHY"], [p_of["head"] + R_of["HEAD"] @ [0.0, 0.1, 0.0]]

    def emit(bone: str, depth: int) -> None:
        above = SLIMEVR[bone][0]
        pad, place = "\t" * depth, f"OFFSET 0 {-lengths[above]} 0" if above else "OFFSET 0.0 0.0 0.0"
        lines.append(f"{pad}{'JOINT' if above else 'ROOT'} {bone}\n{pad}{{\n{pad}\t{place}")
        shift = "3" if above else "6 Xposition Yposition Zposition"
        lines.append(f"{pad}\tCHANNELS {shift} Zrotation Xrotation Yrotation")
        columns.append(euler_degrees(R_of[above].swapaxes(1, 2) @ R_of[bone] if above else R_of[bone], "ZXY"))
        below = [other for other, (parent, _, _) in SLIMEVR.items() if parent == bone]
        for other in below:
            emit(other, depth + 1)
        if not below:
            lines.append(f"{pad}\tEnd Site\n{pad}\t{{\n{pad}\t\tOFFSET 0 {-lengths[bone]} 0\n{pad}\t}}")
        lines.append(f"{pad}}}")

    emit("HEAD", 0)
    lines += ["MOTION", f"Frames: {len(motion):<19}", f"Frame Time: {1 / motion.rate}"]
    lines += [" ".join(map(str, row)) for row in np.concatenate(columns, axis=1)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path
