"""The poses that wearers hold for calibration, from the front and from their left (SVG)."""

import numpy as np

from vip_factors.viz.drawn_body import Eye, draw_body, standing
from vip_factors.viz.svg import INK, MUTED, RULE, Svg

WIDTH, HEIGHT, FLOOR, SCALE = 880.0, 430.0, 390.0, 165.0
FRONT_X, SIDE_X, TEXT_X = 175.0, 380.0, 24.0
POSES = {
    "t-pose": ("T-pose", "arms level, elbows straight, palms down"),
    "n-pose": ("N-pose", "arms hang, palms to the thighs"),
}


def poses_picture() -> str:
    """The picture as SVG text: each pose twice."""
    svg = Svg(WIDTH, HEIGHT)
    for number, (pose, (title, told)) in enumerate(POSES.items()):
        left = number * WIDTH / len(POSES)
        svg.text((left + TEXT_X, 44), title, 20, INK, bold=True)
        svg.text((left + TEXT_X, 66), told, 14, MUTED)
        svg.text((left + TEXT_X, 85), "feet and face forward", 14, MUTED)
        skeleton, state = standing(pose)
        for x, yaw, seen in ((FRONT_X, 0.0, "front"), (SIDE_X, np.pi / 2, "left side")):
            svg.line((left + x - 45, FLOOR), (left + x + 45, FLOOR), RULE, 3.0)
            draw_body(svg, skeleton, state, Eye(yaw, 0.0, (left + x, FLOOR), SCALE), paler=0.2)
            svg.text((left + x, FLOOR + 24), seen, 13, MUTED, "middle")
    return str(svg)
