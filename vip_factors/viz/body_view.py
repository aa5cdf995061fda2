"""Bodies with skin on Matplotlib axes: shaded triangles in a parallel projection, the farthest first."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import TriMesh
from matplotlib.tri import Triangulation

from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.body_mesh import body_mesh
from vip_factors.body.kinematics import Motion
from vip_factors.body.mannequin import ESTIMATE_COLOURS, Colour, Side, side_of
from vip_factors.body.skeleton import JOINT_COUNT, calibration_pose
from vip_factors.geometry.rotations import Array, rotation_x, rotation_z
from vip_factors.sensors.calibration import SensorSite, sensor_site, site_axes
from vip_factors.viz.charts import GRID, INK, SOFT_INK, Point, canvas, svg
from vip_factors.viz.colours import mixed

R_FRONT_WORLD = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])  # a view along −x
LIGHT = np.array([-0.42, -0.76, -0.50])  # unit, from the upper left, before the page
AMBIENT, DIFFUSE, GLOSS = 0.64, 0.44, 0.16  # shares of light, chosen by eye
SENSOR = "#2c3038"
FACING = -0.25  # of a sensor's axis out of the skin along the look: nearer to 0 it is seen from its edge


@dataclass(frozen=True)
class View:
    """Parallel projection of the world onto a page.

    Attributes:
        R_page_world: ``(3, 3)``; the page's x points right, y down, z away from who looks.
        scale: pixels per metre.
        pixel: where on the page ``p_world`` is seen.
        p_world: ``(3,)`` metres.
    """

    R_page_world: Array
    scale: float
    pixel: tuple[float, float]
    p_world: Array

    def project(self, p_world: Array) -> Array:
        """Pixels ``(..., 2)`` of points ``(..., 3)``."""
        return np.asarray(self.pixel) + self.scale * ((p_world - self.p_world) @ self.R_page_world.T)[..., :2]

    def depth(self, p_world: Array) -> Array:
        """Depths ``(...)`` in metres of points ``(..., 3)`` behind ``p_world``."""
        return (p_world - self.p_world) @ self.R_page_world[2]


def view_from(
    yaw: float, pitch: float, pixel: tuple[float, float], scale: float, p_world: Sequence[float] | Array = (0, 0, 0)
) -> View:
    """View of a point at a pixel, ``scale`` pixels a metre.

    ``yaw`` (rad) 0 sees the front of who faces x, positive from their left; ``pitch`` (rad) is from above.
    """
    return View(rotation_x(pitch) @ R_FRONT_WORLD @ rotation_z(-yaw), scale, pixel, np.asarray(p_world, float))


def draw_body(axes: Axes, motion: Motion, frame: int, view: View, colours: Mapping[Side, Colour]) -> None:
    """Draw the body of a motion at a frame, in the colours of its sides, over what is drawn already.

    The axes measure in pixels, y down.
    """
    mesh = body_mesh(motion.skeleton)
    p_world, normal = mesh.posed(motion.state.R_world_bone[frame], motion.state.p_world_joint[frame])
    pixels = view.project(p_world)
    corners = pixels[mesh.faces]
    ab, ac = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    facing = np.flatnonzero(ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0] < 0)  # anticlockwise, with y down
    faces = facing[np.argsort(-view.depth(p_world)[mesh.faces[facing]].mean(axis=1))]
    light = np.clip(normal @ view.R_page_world.T @ LIGHT, 0, 1)[:, None]
    by_bone = np.array([colours[side_of(bone)] for bone in range(JOINT_COUNT)]) / 255
    skin = TriMesh(Triangulation(pixels[:, 0], pixels[:, 1], mesh.faces[faces]), rasterized=True, zorder=1)
    skin.set_facecolor(np.clip((mesh.weights @ by_bone) * (AMBIENT + DIFFUSE * light) + GLOSS * light**6, 0, 1))
    axes.add_collection(skin, autolim=False)


def draw_sensors(axes: Axes, motion: Motion, frame: int, view: View, sites: Iterable[SensorSite]) -> None:
    """Draw the sensors at their sites whose outer side faces the page's reader, as dark squares."""
    R_world_bone, p_world_joint = motion.state.R_world_bone[frame], motion.state.p_world_joint[frame]
    for site in sites:
        R, p = R_world_bone[site.bone_index], p_world_joint[site.bone_index]
        if view.R_page_world[2] @ R @ site.R_bone_sensor[:, 2] < FACING:
            axes.plot(*view.project(p + R @ site.p_bone_sensor), "s", color=SENSOR, markersize=10, mew=0, zorder=1)


AXES = (("x", "#c8443c"), ("y", "#2f8f4e"), ("z", "#2f5fc4"))
HALO = {"facecolor": "white", "edgecolor": "none", "pad": 1.0, "alpha": 0.8}  # below text: legible over the body


def standing_body(pose: str, stature_m: float = 1.75) -> Motion:
    """A frame of somebody in a calibration pose (``t-pose``, ``n-pose``) at the origin, facing x, heels at z = 0."""
    skeleton = skeleton_from_stature(stature_m)
    heel = skeleton.landmarks["left_heel"]
    height = -(skeleton.p_pelvis_joint[heel.bone] + heel.p_bone_point)[1]
    return Motion(skeleton, calibration_pose(pose)[None], np.array([[0.0, 0.0, height]]), 1.0)


def draw_pale_body(axes: Axes, body: Motion, view: View, paler: float = 0.45) -> None:
    """Draw the first frame in the colours of its sides with a share of white."""
    draw_body(axes, body, 0, view, {side: mixed(c, (255, 255, 255), paler) for side, c in ESTIMATE_COLOURS.items()})


def pixel(view: View, p_world: Array) -> Point:
    """Pixel of a point in the picture."""
    x, y = view.project(np.asarray(p_world, float))
    return float(x), float(y)


def draw_axes(axes: Axes, view: View, p_world: Array, R_world_frame: Array, metres: float) -> None:
    """Arrows of a frame's three axes with their letters, the farthest first."""
    tips = p_world + metres * R_world_frame.T
    for axis in np.argsort(-view.depth(tips)):
        draw_arrow(axes, pixel(view, p_world), pixel(view, tips[axis]), *AXES[axis][::-1])


def draw_arrow(axes: Axes, start: Point, end: Point, colour: str, letter: str = "", width: float = 2.2) -> None:
    """An arrow between two pixels; of one that points at the reader, or away from it, only a dot is left."""
    direction = np.subtract(end, start)
    length = float(np.linalg.norm(direction))
    if length < 4.0:
        axes.plot(*start, "o", color=colour, ms=6)
        return
    style = {"arrowstyle": "-|>", "color": colour, "lw": width, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 11}
    axes.annotate("", end, start, arrowprops=style)
    letter_gap_px = 9.0
    if letter:
        x, y = np.array(end) + letter_gap_px * direction / length
        write(axes, (x, y + 4.5), letter, 13, colour, "center", bold=True)


def write(
    axes: Axes,
    position: Point,
    text: str,
    size: float = 13,
    colour: str = INK,
    anchor: str = "left",
    *,
    bold: bool = False,
    halo: bool = True,
) -> None:
    """Text from, around or up to (left, center, right) a point on its baseline, legible over what is below."""
    weight, bbox = "bold" if bold else "normal", HALO if halo else None
    axes.text(*position, text, size=size, color=colour, ha=anchor, weight=weight, bbox=bbox, zorder=4)


WIDTH, HEIGHT, MARGIN = 860, 1470, 30.0
PLATE_M = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * np.array([0.024, 0.016, 0.0])
PITCH = np.deg2rad(16.0)
FRONT = view_from(np.deg2rad(30.0), PITCH, (430.0, 890.0), 415.0)
BACK = view_from(np.deg2rad(150.0), PITCH, (425.0, 1375.0), 480.0, (0.0, 0.0, 1.0))
# Each site, and where its name is written: pixels right of and below the sensor, and what of it stands there.
SEEN_FROM_THE_FRONT = {
    "sternum": (-110, 76, "right"),
    "belly": (-110, 30, "right"),
    "left_forearm": (0, 74, "center"),
    "right_hand": (20, 66, "center"),
    "left_thigh": (76, -16, "left"),
    "left_shank_side": (76, -16, "left"),
    "left_ankle": (76, -16, "left"),
    "left_foot": (56, 20, "left"),
    "right_thigh_front": (-84, -2, "right"),
    "right_shank": (-84, -2, "right"),
    "right_foot": (-84, -2, "right"),
}
SEEN_FROM_THE_BACK = {
    "head": (60, -20, "left"),
    "upper_back": (-110, 94, "right"),
    "left_shoulder": (-70, -84, "right"),
    "right_shoulder": (40, -84, "left"),
    "left_upper_arm": (-80, 64, "right"),
    "right_upper_arm": (50, 76, "left"),
    "lower_back": (110, 0, "left"),
    "pelvis": (110, 20, "left"),
}


def sites_picture(stature_m: float = 1.75) -> str:
    """The picture as SVG text: a front and a back view, each sensor with its x, y and z axis.

    Of a pair the one is drawn that is seen better; the other one is its mirror image, but that its y axis points the
    other way (the axes stay right-handed).
    """
    axes = canvas(WIDTH, HEIGHT)
    write(axes, (MARGIN, 46), "Where sensors sit, and how their axes are taken to lie", 22, bold=True)
    frames = "T-pose, palms down. z points out of the skin. Orange is the wearer's left, blue the right."
    write(axes, (MARGIN, 74), frames, 14, SOFT_INK)
    body = standing_body("t-pose", stature_m)
    tops = (116.0, 960.0)  # of the panels, one above the other
    for title, top, view, names in (
        ("From the front left", tops[0], FRONT, SEEN_FROM_THE_FRONT),
        ("From the back left", tops[1], BACK, SEEN_FROM_THE_BACK),
    ):
        axes.hlines(top - 12, MARGIN, WIDTH - MARGIN, color=GRID)
        write(axes, (MARGIN, top + 14), title, 15, bold=True)
        draw_pale_body(axes, body, view, paler=0.55)
        for name, label in names.items():
            _draw_site(axes, view, name, label, body)
    return svg(axes)


def _draw_site(axes: Axes, view: View, name: str, label: tuple[float, float, str], body: Motion) -> None:
    site, state = sensor_site(name, body.skeleton), body.state
    R_world_bone = state.R_world_bone[0, site.bone_index]
    R_world_sensor = R_world_bone @ site.R_bone_sensor
    p_world_sensor = state.p_world_joint[0, site.bone_index] + R_world_bone @ site.p_bone_sensor
    plate = view.project(p_world_sensor + PLATE_M @ R_world_sensor.T)
    axes.fill(*plate.T, facecolor="#f6de78", edgecolor=INK, lw=1.2, zorder=2)
    arrow_m = 0.12
    draw_axes(axes, view, p_world_sensor, R_world_sensor, arrow_m)
    right, down, anchor = label
    sensor = pixel(view, p_world_sensor)
    x, y = np.add(sensor, (right, down))
    leader_px = 125.0  # a name further off than this has a line to its sensor
    if np.hypot(right, down) > leader_px:
        axes.plot([x + 6, sensor[0]], [y - 6, sensor[1]], color=SOFT_INK, lw=1.1)
    write(axes, (x, y), name, 15, anchor=anchor, bold=True)
    write(axes, (x, y + 17), site_axes(name).split("; ")[1], 13, SOFT_INK, anchor)
