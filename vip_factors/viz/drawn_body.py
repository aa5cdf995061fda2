"""A standing body and coordinate axes as an eye at infinity sees them (SVG): where sensors sit, and how they lie."""

from dataclasses import dataclass

import cv2
import numpy as np

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.calibration_pose import calibration_pose
from vip_factors.body.kinematics import BodyState, forward_kinematics
from vip_factors.body.mannequin import ESTIMATE_COLOURS, mannequin
from vip_factors.body.skeleton import Skeleton
from vip_factors.geometry.rotations import Array, rotation_x, rotation_z
from vip_factors.sensors.calibration import sensor_site, site_axes
from vip_factors.viz.svg import INK, MUTED, RULE, Point, Svg, tinted

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


def standing_body(pose: str, stature_m: float = 1.75) -> tuple[Skeleton, BodyState]:
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


WIDTH, HEIGHT = 860.0, 1470.0
MARGIN = 30.0
TOPS = (116.0, 960.0)  # of the panels, one above the other
PLATE_M = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * np.array([0.024, 0.016, 0.0])
FRONT = Eye(np.deg2rad(30.0), np.deg2rad(16.0), (430.0, 890.0), 415.0)
BACK = Eye(np.deg2rad(180.0 - 30.0), np.deg2rad(16.0), (425.0, 1375.0), 480.0, (0.0, 0.0, 1.0))
ARROW_PX = 54.0
LEADER_PX = 125.0  # a name further off than this has a line to its sensor
# Each site, and where its name is written: pixels right of and below the sensor, and what of it stands there.
SEEN_FROM_THE_FRONT = {
    "sternum": (-110, 40, "end"), "belly": (-110, 30, "end"), "left_forearm": (0, 74, "middle"),
    "right_hand": (20, 66, "middle"), "left_thigh": (76, -16, "start"), "left_shank_side": (76, -16, "start"),
    "left_ankle": (76, -16, "start"), "left_foot": (56, 20, "start"), "right_thigh_front": (-84, -2, "end"),
    "right_shank": (-84, -2, "end"), "right_foot": (-84, -2, "end"),
}  # fmt: skip
SEEN_FROM_THE_BACK = {
    "head": (60, -20, "start"), "upper_back": (-110, 94, "end"), "left_shoulder": (-70, -84, "end"),
    "right_shoulder": (40, -84, "start"), "left_upper_arm": (-80, 64, "end"), "right_upper_arm": (50, 76, "start"),
    "lower_back": (110, 0, "start"), "pelvis": (110, 20, "start"),
}  # fmt: skip


def sites_picture(stature_m: float = 1.75) -> str:
    """The picture as SVG text: a front and a back view, each sensor with its x, y and z axis.

    Of a pair the one is drawn that is seen better; the other one is its mirror image, but that its y axis points the
    other way (the axes stay right-handed).
    """
    svg = Svg(WIDTH, HEIGHT)
    svg.text((MARGIN, 46), "Where sensors sit, and how their axes are taken to lie", 22, INK, bold=True)
    told = "T-pose, palms down. z points out of the skin. Orange is the wearer's left, blue the right."
    svg.text((MARGIN, 74), told, 14, MUTED)
    skeleton, state = standing_body("t-pose", stature_m)
    for title, top, eye, names in (
        ("From the front left", TOPS[0], FRONT, SEEN_FROM_THE_FRONT),
        ("From the back left", TOPS[1], BACK, SEEN_FROM_THE_BACK),
    ):
        svg.line((MARGIN, top - 12), (WIDTH - MARGIN, top - 12), RULE)
        svg.text((MARGIN, top + 14), title, 15, INK, bold=True)
        draw_body(svg, skeleton, state, eye, paler=0.55)
        for name, beside in names.items():
            _draw_site(svg, eye, name, beside, skeleton, state)
    return str(svg)


def _draw_site(
    svg: Svg, eye: Eye, name: str, beside: tuple[float, float, str], skeleton: Skeleton, state: BodyState
) -> None:
    site = sensor_site(name, skeleton)
    R_world_bone = state.R_world_bone[0, site.bone_index]
    R_world_sensor = R_world_bone @ site.R_bone_sensor
    p_world_sensor = state.p_world_joint[0, site.bone_index] + R_world_bone @ site.p_bone_sensor
    plate = eye.project(p_world_sensor + PLATE_M @ R_world_sensor.T)[0]
    svg.polygon([(float(x), float(y)) for x, y in plate], "#f6de78", INK, 1.2)
    draw_axes(svg, eye, p_world_sensor, R_world_sensor, ARROW_PX / eye.scale)
    right, down, anchor = beside
    x, y = np.add(eye.at(p_world_sensor), (right, down))
    if np.hypot(right, down) > LEADER_PX:
        svg.line((x + 6, y - 6), eye.at(p_world_sensor), MUTED)
    svg.text((x, y), name, 15, INK, anchor, bold=True, halo=True)
    svg.text((x, y + 17), site_axes(name).split("; ")[1], 13, MUTED, anchor, halo=True)
