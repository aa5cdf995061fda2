"""The drawings of the documentation: ``python docs/draw.py``, from a clone."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from vip_factors.atomic import atomic_path
from vip_factors.body.anthropometry import skeleton_from_stature
from vip_factors.body.kinematics import Motion
from vip_factors.body.mannequin import ESTIMATE_COLOURS
from vip_factors.body.skeleton import calibration_pose, joint_index
from vip_factors.geometry.rotations import Array, rotation_z
from vip_factors.sensors.calibration import sensor_site, site_axes
from vip_factors.viz.charts import GRID, INK, SOFT_INK, View, canvas, draw_body, svg, view_from
from vip_factors.viz.colours import mixed

PAGE_MM = (297.0, 210.0)  # the checkerboard's, A4
SQUARES, SQUARE_MM = (10, 7), 25.0  # 9 by 6 inner corners: odd and even, so that the board has one way up

POSES_SIZE, FLOOR, SCALE = (880, 430), 390.0, 165.0
FRONT_X, SIDE_X, TEXT_X = 175.0, 380.0, 24.0
POSES = {
    "t-pose": ("T-pose", "arms level, elbows straight, palms down"),
    "n-pose": ("N-pose", "arms hang, palms to the thighs"),
}

FRAMES_SIZE = (960, 620)
VIEW = view_from(np.deg2rad(38.0), np.deg2rad(20.0), (400.0, 545.0), 280.0)
GAMMA = "\N{GREEK SMALL LETTER GAMMA}"
AXIS_M, HEADING = 0.32, np.deg2rad(40.0)
WORLD = np.array([0.2, -1.0, 0.0])
INERTIAL = np.array([0.0, 0.95, 1.35])
CAMERA = np.array([-0.7, 1.2, 0.6])
R_WORLD_CAMERA = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # looks along −x before it is turned

Point = tuple[float, float]  # pixels of the page; y goes down
AXES = (("x", "#c8443c"), ("y", "#2f8f4e"), ("z", "#2f5fc4"))
HALO = {"facecolor": "white", "edgecolor": "none", "pad": 1.0, "alpha": 0.8}  # below text: legible over the body


def standing_body(pose: str) -> Motion:
    """A frame of somebody in a calibration pose (``t-pose``, ``n-pose``) at the origin, facing x, heels at z = 0."""
    skeleton = skeleton_from_stature(1.75)
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


SITES_SIZE, MARGIN = (860, 1470), 30.0
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


def sites_picture() -> str:
    """The picture as SVG text: a front and a back view, each sensor with its x, y and z axis.

    Of a pair the one is drawn that is seen better; the other one is its mirror image, but that its y axis points the
    other way (the axes stay right-handed).
    """
    axes = canvas(*SITES_SIZE)
    write(axes, (MARGIN, 46), "Where sensors sit, and how their axes are taken to lie", 22, bold=True)
    frames = "T-pose, palms down. z points out of the skin. Orange is the wearer's left, blue the right."
    write(axes, (MARGIN, 74), frames, 14, SOFT_INK)
    body = standing_body("t-pose")
    tops = (116.0, 960.0)  # of the panels, one above the other
    for title, top, view, names in (
        ("From the front left", tops[0], FRONT, SEEN_FROM_THE_FRONT),
        ("From the back left", tops[1], BACK, SEEN_FROM_THE_BACK),
    ):
        axes.hlines(top - 12, MARGIN, SITES_SIZE[0] - MARGIN, color=GRID)
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


def checkerboard() -> str:
    """To print, for calibrating cameras; a unit is a millimetre."""
    width, height = PAGE_MM
    left, top = ((page - count * SQUARE_MM) / 2 for page, count in zip(PAGE_MM, SQUARES, strict=True))
    squares = "\n".join(
        f'<rect x="{left + column * SQUARE_MM:g}" y="{top + row * SQUARE_MM:g}" width="{SQUARE_MM:g}" '
        f'height="{SQUARE_MM:g}" fill="#000000"/>'
        for column in range(SQUARES[0])
        for row in range(SQUARES[1])
        if (column + row) % 2 == 0
    )
    corners = "x".join(str(count - 1) for count in SQUARES)
    options = f"--checkerboard {corners} --square-m {SQUARE_MM / 1000:g}"
    return f"""<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" width="{width:g}mm" \
height="{height:g}mm" font-family="Helvetica, Arial, sans-serif">
<rect width="{width:g}" height="{height:g}" fill="#ffffff"/>
{squares}
<text x="{left:g}" y="{height - 8:g}" font-size="4" fill="{SOFT_INK}">{options} · print at 100 %, measure: ten squares \
are 250 mm</text>
</svg>
"""


def poses_picture() -> str:
    """The poses that wearers hold for calibration, from the front and from their left."""
    axes = canvas(*POSES_SIZE)
    for number, (pose, (title, how)) in enumerate(POSES.items()):
        left = number * POSES_SIZE[0] / len(POSES)
        write(axes, (left + TEXT_X, 44), title, 20, bold=True)
        write(axes, (left + TEXT_X, 66), how, 14, SOFT_INK)
        write(axes, (left + TEXT_X, 85), "feet and face forward", 14, SOFT_INK)
        body = standing_body(pose)
        for x, yaw, seen in ((FRONT_X, 0.0, "front"), (SIDE_X, np.pi / 2, "left side")):
            axes.hlines(FLOOR, left + x - 45, left + x + 45, color=GRID, lw=3.0, zorder=0)
            draw_pale_body(axes, body, view_from(yaw, 0.0, (left + x, FLOOR), SCALE), paler=0.2)
            write(axes, (left + x, FLOOR + 24), seen, 13, SOFT_INK, "center")
    return svg(axes)


def frames_picture() -> str:
    """World, bone, sensor, its inertial frame and the camera, about somebody who wears one sensor."""
    axes = canvas(*FRAMES_SIZE)
    for one in np.arange(-1.5, 1.6, 0.5):
        for ends in ([(one, -1.5, 0), (one, 1.5, 0)], [(-1.5, one, 0), (1.5, one, 0)]):
            _line(axes, ends, GRID)
    body = standing_body("n-pose")
    draw_pale_body(axes, body, VIEW, paler=0.6)
    draw_axes(axes, VIEW, WORLD, np.eye(3), AXIS_M)
    _label(axes, WORLD, (6, 46), "world", "z up, floor at z = 0", "center")

    thigh, state = joint_index("left_hip"), body.state
    draw_axes(axes, VIEW, state.p_world_joint[0, thigh], state.R_world_bone[0, thigh], 0.26)
    which = "R_world_bone: x left, y up, z forward"
    _label(axes, state.p_world_joint[0, thigh], (-92, -16), "bone left_hip", which, "right")
    site = sensor_site("left_shank_side", body.skeleton)
    R_world_bone = state.R_world_bone[0, site.bone_index]
    p_world_sensor = state.p_world_joint[0, site.bone_index] + R_world_bone @ site.p_bone_sensor
    draw_axes(axes, VIEW, p_world_sensor, R_world_bone @ site.R_bone_sensor, 0.2)
    _label(axes, p_world_sensor, (56, 62), "sensor", "R_bone_sensor: its mounting", "left")

    _inertial(axes)
    _camera(axes)
    return svg(axes)


def _line(axes: Axes, points: Array | list[tuple[float, float, float]], colour: str, width: float = 1.1) -> None:
    axes.plot(*VIEW.project(np.array(points, float)).T, color=colour, lw=width, zorder=0.5)


def _inertial(axes: Axes) -> None:
    """The frame in which the sensor tells its orientation: the world's, turned about the vertical by the heading."""
    x_world = INERTIAL + AXIS_M * np.array([1.0, 0.0, 0.0])
    draw_arrow(axes, pixel(VIEW, INERTIAL), pixel(VIEW, x_world), "#98a2ae", width=1.4)
    write(axes, np.add(pixel(VIEW, x_world), (-14, 10)), "world's x", 12, SOFT_INK, "right")
    angles = np.linspace(0, HEADING, 12)
    _line(axes, INERTIAL + 0.2 * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1), INK, 1.6)
    middle = INERTIAL + 0.26 * np.array([np.cos(HEADING / 2), np.sin(HEADING / 2), 0])
    write(axes, np.add(pixel(VIEW, middle), (0, 10)), GAMMA, 15, anchor="center", bold=True)
    draw_axes(axes, VIEW, INERTIAL, rotation_z(HEADING), AXIS_M)
    which = f"R_world_inertial = Rz({GAMMA}), {GAMMA} its heading"
    _label(axes, INERTIAL, (-10, -152), "inertial frame of the sensor", which, "center")


def _camera(axes: Axes) -> None:
    R = rotation_z(np.deg2rad(121.0)) @ R_WORLD_CAMERA
    corners = [CAMERA + R @ np.array([x, y, 0.3]) for x, y in ((-0.2, -0.13), (0.2, -0.13), (0.2, 0.13), (-0.2, 0.13))]
    axes.fill(*VIEW.project(np.array(corners))[0].T, facecolor="#f4f6f8", edgecolor=SOFT_INK, lw=1.2)
    for corner in corners:
        _line(axes, [CAMERA, corner], SOFT_INK, 1.2)
    draw_axes(axes, VIEW, CAMERA, R, AXIS_M)
    _label(axes, CAMERA, (-10, 112), "camera", "T_world_camera: z into the picture", "center")


def _label(axes: Axes, p_world: Array, beside: Point, name: str, told: str, anchor: str) -> None:
    x, y = np.add(pixel(VIEW, p_world), beside)
    write(axes, (x, y), name, 15, anchor=anchor, bold=True)
    write(axes, (x, y + 17), told, 13, SOFT_INK, anchor)


DRAWINGS = {
    "checkerboard.svg": checkerboard,
    "frames.svg": frames_picture,
    "poses.svg": poses_picture,
    "sites.svg": sites_picture,
}

if __name__ == "__main__":
    for name, draw in DRAWINGS.items():
        with atomic_path(Path(__file__).parent / name, overwrite=True) as partial:
            partial.write_text(draw(), encoding="utf-8")
