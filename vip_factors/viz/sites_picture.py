"""Where sensors sit by name, and how their axes lie there, drawn on a body in a T-pose (SVG)."""

import numpy as np

from vip_factors.body.kinematics import BodyState
from vip_factors.body.skeleton import Skeleton
from vip_factors.sensors.calibration import sensor_site, site_axes
from vip_factors.viz.drawn_body import Eye, draw_axes, draw_body, standing
from vip_factors.viz.svg import INK, MUTED, RULE, Svg

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
    skeleton, state = standing("t-pose", stature_m)
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
