"""MVNX files of both versions, from a motion that is known."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vip_factors.geometry.quaternions import Order, quaternion_from_matrix
from vip_factors.geometry.rotations import exp, rotation_x

# Segments with their parent and the origin in it, on a person in the T-pose: x forward, y left, z up.
LEFT = {
    "Shoulder": ("T8", (0, 0.03, 0.07)), "UpperArm": ("Shoulder", (0, 0.14, 0)),
    "ForeArm": ("UpperArm", (0, 0.27, 0)), "Hand": ("ForeArm", (0, 0.23, 0)),
    "UpperLeg": ("Pelvis", (0, 0.09, 0)), "LowerLeg": ("UpperLeg", (0, 0, -0.4)),
    "Foot": ("LowerLeg", (0, 0, -0.41)), "Toe": ("Foot", (0.15, 0, -0.07)),
}  # fmt: skip
SEGMENTS = {
    "Pelvis": (None, (0, 0, 0)), "L5": ("Pelvis", (0, 0, 0.1)), "L3": ("L5", (0, 0, 0.1)),
    "T12": ("L3", (0, 0, 0.09)), "T8": ("T12", (0, 0, 0.09)), "Neck": ("T8", (0, 0, 0.12)),
    "Head": ("Neck", (0, 0, 0.09)),
} | {
    side + name: (parent if parent in ("T8", "Pelvis") else side + parent, (x, y * sign, z))
    for side, sign in (("Right", -1), ("Left", 1))
    for name, (parent, (x, y, z)) in LEFT.items()
}  # fmt: skip
TIPS = {"Head": ("pTopOfHead", (0, 0, 0.17))} | {
    side + name: (f"p{side}{point}", (x, y * sign, z))
    for side, sign in (("Right", -1), ("Left", 1))
    for name, point, (x, y, z) in (
        ("Foot", "HeelFoot", (-0.04, 0, -0.085)),
        ("Toe", "Toe", (0.06, 0, -0.015)),
        ("Hand", "TopOfHand", (0, 0.17, 0)),
    )
}
SENSORS = ("Pelvis", "T8", "LeftForeArm", "Prop1")
FRAMES = 8
R_SEGMENT_BONE = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]])


def poses(R_world_segment: np.ndarray) -> np.ndarray:
    """Positions ``(T, 23, 3)`` of segments turned like this."""
    names, p = list(SEGMENTS), np.zeros((len(R_world_segment), 23, 3))
    p[:, 0] = [0.1, 0.2, 0.9]
    for row, (parent, offset) in enumerate(SEGMENTS.values()):
        if parent:
            up = names.index(parent)
            p[:, row] = p[:, up] + R_world_segment[:, up] @ np.array(offset, float)
    return p


def motion(seed: int = 0) -> np.ndarray:
    R = exp(0.5 * np.random.default_rng(seed).normal(size=(FRAMES, 23, 3)))
    names = list(SEGMENTS)
    R[:, names.index("L3")] = R[:, names.index("L5")]  # so that nothing is lost where we merge the two
    return R


def numbers(values: np.ndarray) -> str:
    return " ".join(f"{value:.9f}" for value in np.ravel(values))


def frame(R: np.ndarray, p: np.ndarray, attributes: str, more: str = "") -> str:
    q = quaternion_from_matrix(R, Order.WXYZ)
    return f"<frame {attributes}><orientation>{numbers(q)}</orientation><position>{numbers(p)}</position>{more}</frame>"


def write(
    path: Path,
    R: np.ndarray,
    version: int = 4,
    points: bool = True,
    sensors: tuple[str, ...] = SENSORS,
    segments: Sequence[str] = tuple(SEGMENTS),
) -> tuple[np.ndarray, np.ndarray]:
    """An MVNX file of this motion; returns sensor orientations ``(T, S, 3, 3)`` and specific forces it implies."""
    rng, names, tag = np.random.default_rng(5), list(SEGMENTS), "pos_b" if version == 4 else "pos_s"
    # Version 3 turns the arms' axes, and says so by the pose of its calibration only.
    zero = np.stack([rotation_x(np.pi / 2 if "Arm" in name and version == 3 else 0.0) for name in names])
    rows = [names.index(name) for name in segments]
    described, joints = "", ""
    for row, (name, (parent, _)) in enumerate(SEGMENTS.items()):
        if name not in segments:
            continue
        own: list[tuple[str, tuple[float, ...]]] = [(f"j{name}", (0, 0, 0))] if parent else []
        own += [(f"j{child}", offset) for child, (above, offset) in SEGMENTS.items() if above == name]
        own += [TIPS[name]] if name in TIPS else []
        tags = "".join(f'<point label="{p}"><{tag}>{numbers(np.array(x))}</{tag}></point>' for p, x in own)
        described += f'<segment label="{name}" id="{row + 1}"><points>{tags if points else ""}</points></segment>'
        if parent:
            ends = f"<connector1>{parent}/j{name}</connector1><connector2>{name}/j{name}</connector2>"
            joints += f'<joint label="j{name}">{ends}</joint>'
    straight = poses(np.tile(np.eye(3), (1, 23, 1, 1)))[0]
    frames = frame(
        zero[rows], straight[rows], 'time="0" type="identity"' if version == 4 else 'time="0" index="-3" type="npose"'
    )
    R_sensor = exp(rng.normal(size=(FRAMES, len(sensors), 3)))
    free = rng.normal(size=(FRAMES, len(sensors), 3))
    force = np.einsum("tsji,tsj->tsi", R_sensor, free + np.array([0, 0, 9.80665]))
    for t, (turned, p) in enumerate(zip(R @ zero, poses(R), strict=True)):
        acceleration = ("sensorFreeAcceleration", free) if version == 4 else ("sensorAcceleration", force)
        q = quaternion_from_matrix(R_sensor[t], Order.WXYZ)
        more = f"<sensorOrientation>{numbers(q)}</sensorOrientation>"
        more += f"<{acceleration[0]}>{numbers(acceleration[1][t])}</{acceleration[0]}>"
        attributes = f'time="{round(t * 1000 / 60)}" index="{t}" ms="{1542082631842 + t * 17}" type="normal"'
        frames += "\n" + frame(turned[rows], p[rows], attributes, more)
    path.write_text(
        '<?xml version="1.0" encoding="UTF-8"?>\n<!-- a comment -->\n'
        f'<mvnx xmlns="http://www.xsens.com/mvn/mvnx" version="{version}"><mvn version="2019.0.0"/><comment/>'
        f'<subject label="x" frameRate="60" segmentCount="23"><segments>{described}</segments><sensors>'
        + "".join(f'<sensor label="{name}"/>' for name in sensors)
        + f'</sensors><joints>{joints}</joints><frames sensorCount="{len(sensors)}">{frames}</frames></subject></mvnx>'
    )
    return R_sensor, force
