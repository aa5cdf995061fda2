"""A standing body and coordinate axes, drawn into an SVG as an eye at infinity sees them."""

from dataclasses import dataclass

import cv2
import numpy as np

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.calibration_pose import calibration_pose
from vip_factors.body.kinematics import BodyState, forward_kinematics
from vip_factors.body.mannequin import ESTIMATE_COLOURS, mannequin
from vip_factors.body.skeleton import Skeleton
from vip_factors.geometry.rotations import Array, rotation_x, rotation_z
from vip_factors.viz.svg import Point, Svg, tinted

AXES = (("x", "#c8443c"), ("y", "#2f8f4e"), ("z", "#2f5fc4"))
HEAD_PX = 8.0  # of an arrow
LETTER_GAP_PX = 9.0
NEARER_M = {"arm": 0.10, "leg": -0.25}  # a thigh begins behind the pelvis, an arm that hangs is before the trunk
CIRCLE = np.stack([np.cos(np.linspace(0, 2 * np.pi, 40)), np.sin(np.linspace(0, 2 * np.pi, 40))], axis=1)
R_FRONT_WORLD = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])  # an eye that looks along −x


@dataclass(frozen=True)
class Eye:
    """Where the picture is seen from: ``yaw`` 0 sees the front of who faces x, positive from their left (radians).

    The world point ``p_world_anchor`` (metres) falls on ``anchor`` (pixels); ``scale`` is in pixels a metre.
    """

    yaw: float
    pitch: float
    anchor: Point
    scale: float
    p_world_anchor: Point | tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def R_eye_world(self) -> Array:
        """``(3, 3)``: x right, y down, z away."""
        return rotation_x(self.pitch) @ R_FRONT_WORLD @ rotation_z(-self.yaw)

    def project(self, p_world: Array) -> tuple[Array, Array]:
        """Pixels ``(..., 2)`` and depth ``(...)`` in metres of world points ``(..., 3)``."""
        p_eye = (np.asarray(p_world, float) - np.array(self.p_world_anchor)) @ self.R_eye_world.T
        return np.array(self.anchor) + self.scale * p_eye[..., :2], p_eye[..., 2]

    def at(self, p_world: Array) -> Point:
        """Pixel of one point."""
        x, y = self.project(p_world)[0]
        return float(x), float(y)


def standing(pose: str, stature_m: float = 1.75) -> tuple[Skeleton, BodyState]:
    """Somebody in a calibration pose (``t-pose``, ``n-pose``) at the origin, facing x, heels on the floor z = 0."""
    skeleton = skeleton_from_stature(stature_m)
    heel = skeleton.landmarks["left_heel"]
    pelvis = np.array([0.0, 0.0, -(skeleton.p_pelvis_joint[heel.bone] + heel.p_bone_point)[1]])
    return skeleton, forward_kinematics(skeleton, calibration_pose(pose)[None], pelvis[None])


def draw_body(svg: Svg, skeleton: Skeleton, state: BodyState, eye: Eye, paler: float = 0.45) -> None:
    """Limbs of the first frame, the farthest first, in the colours of their sides with a share of white."""
    parts: dict[str, list[tuple[float, list[Point], str]]] = {}
    for segment in mannequin(skeleton):
        R, p = state.R_world_bone[0, segment.bone], state.p_world_joint[0, segment.bone]
        pixels, depth = eye.project(np.stack([p + R @ segment.p_bone_start, p + R @ segment.p_bone_end]))
        radii = eye.scale * np.array([segment.radius_start, segment.radius_end])
        red, green, blue = ESTIMATE_COLOURS[segment.side]
        colour = tinted(f"#{red:02x}{green:02x}{blue:02x}", paler)
        parts.setdefault(segment.region, []).append((float(depth.min()), _outline(pixels, radii), colour))
    depths = {part: float(np.mean([depth for depth, _, _ in pieces])) for part, pieces in parts.items()}
    for part in sorted(parts, key=lambda name: NEARER_M.get(name.rpartition("_")[2], 0.0) - depths[name]):
        for _, outline, colour in parts[part]:  # a white rim parts the limb from what is behind
            svg.polygon(outline, colour, "#ffffff", 3.0)
        for _, outline, colour in parts[part]:
            svg.polygon(outline, colour)


def _outline(pixels: Array, radii: Array) -> list[Point]:
    circles = np.concatenate([pixels[0] + radii[0] * CIRCLE, pixels[1] + radii[1] * CIRCLE])
    return [(float(x), float(y)) for x, y in cv2.convexHull(circles.astype(np.float32))[:, 0]]


def draw_axes(
    svg: Svg, eye: Eye, p_world: Array, R_world_frame: Array, metres: float, *, letters: bool = True, paler: float = 0.0
) -> None:
    """Arrows of a frame's three axes with their letters, the farthest first."""
    tips = p_world + metres * R_world_frame.T
    for axis in np.argsort(-eye.project(tips)[1]):
        letter, colour = AXES[axis]
        draw_arrow(svg, eye.at(p_world), eye.at(tips[axis]), tinted(colour, paler), letter if letters else "")


def draw_arrow(svg: Svg, start: Point, end: Point, colour: str, letter: str = "", width: float = 2.2) -> None:
    """An arrow between two pixels; of one that points at the eye, or away from it, only a dot is left."""
    way = np.subtract(end, start)
    length = float(np.linalg.norm(way))
    if length < HEAD_PX / 2:
        svg.circle(start, 3.0, colour, colour)
        return
    along = way / length
    across = 0.42 * HEAD_PX * np.array([-along[1], along[0]])
    neck = np.array(end) - min(HEAD_PX, 0.6 * length) * along
    svg.line(start, (float(neck[0]), float(neck[1])), colour, width)
    svg.polygon([(float(x), float(y)) for x, y in (np.array(end), neck + across, neck - across)], colour)
    if letter:
        x, y = np.array(end) + LETTER_GAP_PX * along
        svg.text((float(x), float(y) + 4.5), letter, 13, colour, "middle", bold=True, halo=True)
