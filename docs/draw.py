"""The drawings of the documentation: ``python docs/draw.py``, from a clone."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from vip_factors.atomic import atomic_path
from vip_factors.body.skeleton import joint_index
from vip_factors.geometry.rotations import Array, rotation_z
from vip_factors.sensors.calibration import sensor_site
from vip_factors.viz.body_view import (
    draw_arrow,
    draw_axes,
    draw_pale_body,
    pixel,
    sites_picture,
    standing_body,
    view_from,
    write,
)
from vip_factors.viz.charts import GRID, INK, SOFT_INK, Point, canvas, svg

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
