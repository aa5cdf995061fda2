"""The drawings of the documentation: ``python docs/draw.py``, from a clone."""

from itertools import pairwise
from pathlib import Path

import numpy as np

from vip_factors.atomic import atomic_path
from vip_factors.body.skeleton import joint_index
from vip_factors.geometry.rotations import rotation_z
from vip_factors.sensors.calibration import sensor_site
from vip_factors.viz.drawn_body import Eye, draw_arrow, draw_axes, draw_body, sites_picture, standing_body
from vip_factors.viz.svg import FAINT, INK, MUTED, RULE, Point, Svg

PAGE_MM = (297.0, 210.0)  # the checkerboard's, A4
SQUARES, SQUARE_MM = (10, 7), 25.0  # 9 by 6 inner corners: odd and even, so that the board has one way up

POSES_SIZE, FLOOR, SCALE = (880.0, 430.0), 390.0, 165.0
FRONT_X, SIDE_X, TEXT_X = 175.0, 380.0, 24.0
POSES = {
    "t-pose": ("T-pose", "arms level, elbows straight, palms down"),
    "n-pose": ("N-pose", "arms hang, palms to the thighs"),
}

FRAMES_SIZE = (960.0, 620.0)
EYE = Eye(np.deg2rad(38.0), np.deg2rad(20.0), (400.0, 545.0), 280.0)
GAMMA = "\N{GREEK SMALL LETTER GAMMA}"
AXIS_M, HEADING = 0.32, np.deg2rad(40.0)
WORLD = np.array([0.2, -1.0, 0.0])
INERTIAL = np.array([0.0, 0.95, 1.35])
CAMERA = np.array([-0.7, 1.2, 0.6])
R_WORLD_CAMERA = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # looks along −x before it is turned


def checkerboard() -> str:
    """To print, for calibrating cameras; a unit is a millimetre."""
    svg = Svg(*PAGE_MM)
    left, top = ((page - count * SQUARE_MM) / 2 for page, count in zip(PAGE_MM, SQUARES, strict=True))
    for column in range(SQUARES[0]):
        for row in range(SQUARES[1]):
            if (column + row) % 2 == 0:
                svg.box((left + column * SQUARE_MM, top + row * SQUARE_MM), (SQUARE_MM, SQUARE_MM), "#000000", radius=0)
    corners = "x".join(str(count - 1) for count in SQUARES)
    told = f"--checkerboard {corners} --square-m {SQUARE_MM / 1000:g} · print at 100 %, measure: ten squares are 250 mm"
    svg.text((left, PAGE_MM[1] - 8), told, 4, MUTED)
    width, height = PAGE_MM
    return str(svg).replace(
        f'width="{width:g}" height="{height:g}" font', f'width="{width:g}mm" height="{height:g}mm" font'
    )


def poses_picture() -> str:
    """The poses that wearers hold for calibration, from the front and from their left."""
    svg = Svg(*POSES_SIZE)
    for number, (pose, (title, told)) in enumerate(POSES.items()):
        left = number * POSES_SIZE[0] / len(POSES)
        svg.text((left + TEXT_X, 44), title, 20, INK, bold=True)
        svg.text((left + TEXT_X, 66), told, 14, MUTED)
        svg.text((left + TEXT_X, 85), "feet and face forward", 14, MUTED)
        skeleton, state = standing_body(pose)
        for x, yaw, seen in ((FRONT_X, 0.0, "front"), (SIDE_X, np.pi / 2, "left side")):
            svg.line((left + x - 45, FLOOR), (left + x + 45, FLOOR), RULE, 3.0)
            draw_body(svg, skeleton, state, Eye(yaw, 0.0, (left + x, FLOOR), SCALE), paler=0.2)
            svg.text((left + x, FLOOR + 24), seen, 13, MUTED, "middle")
    return str(svg)


def frames_picture() -> str:
    """World, bone, sensor, its inertial frame and the camera, about somebody who wears one sensor."""
    svg = Svg(*FRAMES_SIZE)
    _floor(svg)
    skeleton, state = standing_body("n-pose")
    draw_body(svg, skeleton, state, EYE, paler=0.6)
    draw_axes(svg, EYE, WORLD, np.eye(3), AXIS_M)
    _label(svg, EYE.at(WORLD), (6, 46), "world", "z up, floor at z = 0", "middle")

    thigh = joint_index("left_hip")
    draw_axes(svg, EYE, state.p_world_joint[0, thigh], state.R_world_bone[0, thigh], 0.26)
    told = "R_world_bone: x left, y up, z forward"
    _label(svg, EYE.at(state.p_world_joint[0, thigh]), (-92, -16), "bone left_hip", told, "end")
    site = sensor_site("left_shank_side", skeleton)
    R_world_bone = state.R_world_bone[0, site.bone_index]
    p_world_sensor = state.p_world_joint[0, site.bone_index] + R_world_bone @ site.p_bone_sensor
    draw_axes(svg, EYE, p_world_sensor, R_world_bone @ site.R_bone_sensor, 0.2)
    _label(svg, EYE.at(p_world_sensor), (56, 62), "sensor", "R_bone_sensor: its mounting", "start")

    _inertial(svg)
    _camera(svg)
    return str(svg)


def _floor(svg: Svg) -> None:
    for one in np.arange(-1.5, 1.6, 0.5):
        svg.line(EYE.at(np.array([one, -1.5, 0])), EYE.at(np.array([one, 1.5, 0])), RULE)
        svg.line(EYE.at(np.array([-1.5, one, 0])), EYE.at(np.array([1.5, one, 0])), RULE)


def _inertial(svg: Svg) -> None:
    """The frame in which the sensor tells its orientation: the world's, turned about the vertical by the heading."""
    x_world = INERTIAL + AXIS_M * np.array([1.0, 0.0, 0.0])
    draw_arrow(svg, EYE.at(INERTIAL), EYE.at(x_world), FAINT, width=1.4)
    x, y = EYE.at(x_world)
    svg.text((x - 14, y + 10), "world's x", 12, MUTED, "end")
    arc = [EYE.at(INERTIAL + 0.2 * np.array([np.cos(a), np.sin(a), 0])) for a in np.linspace(0, HEADING, 12)]
    for start, end in pairwise(arc):
        svg.line(start, end, INK, 1.6)
    middle = INERTIAL + 0.26 * np.array([np.cos(HEADING / 2), np.sin(HEADING / 2), 0])
    x, y = EYE.at(middle)
    svg.text((x, y + 10), GAMMA, 15, INK, "middle", bold=True, halo=True)
    draw_axes(svg, EYE, INERTIAL, rotation_z(HEADING), AXIS_M)
    told = f"R_world_inertial = Rz({GAMMA}), {GAMMA} its heading"
    _label(svg, EYE.at(INERTIAL), (-10, -130), "inertial frame of the sensor", told, "middle")


def _camera(svg: Svg) -> None:
    R = rotation_z(np.deg2rad(121.0)) @ R_WORLD_CAMERA
    corners = [CAMERA + R @ np.array([x, y, 0.3]) for x, y in ((-0.2, -0.13), (0.2, -0.13), (0.2, 0.13), (-0.2, 0.13))]
    svg.polygon([EYE.at(one) for one in corners], "#f4f6f8", MUTED, 1.2)
    for corner in corners:
        svg.line(EYE.at(CAMERA), EYE.at(corner), MUTED, 1.2)
    draw_axes(svg, EYE, CAMERA, R, AXIS_M)
    _label(svg, EYE.at(CAMERA), (-10, 126), "camera", "T_world_camera: z into the picture", "middle")


def _label(svg: Svg, at: Point, beside: Point, name: str, told: str, anchor: str) -> None:
    x, y = np.add(at, beside)
    svg.text((x, y), name, 15, INK, anchor, bold=True, halo=True)
    svg.text((x, y + 17), told, 13, MUTED, anchor, halo=True)


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
