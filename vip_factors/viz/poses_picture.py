"""The poses that wearers hold for calibration, from the front and from their left (SVG)."""

import numpy as np

from vip_factors.viz.drawn_body import Eye, draw_body, standing
from vip_factors.viz.svg import INK, MUTED, RULE, Svg

WIDTH, HEIGHT, FLOOR, SCALE = 1400.0, 560.0, 520.0, 215.0
FRONT_X, SIDE_X, TEXT_X = 230.0, 520.0, 36.0
POSES = {
    "t-pose": ("T-pose", "arms level, elbows straight, palms down"),
    "n-pose": ("N-pose", "arms hang, elbows straight, palms to the thighs"),
}


def poses_picture() -> str:
    """The picture as SVG text: each pose twice."""
    svg = Svg(WIDTH, HEIGHT)
    for number, (pose, (title, told)) in enumerate(POSES.items()):
        left = number * WIDTH / len(POSES)
        svg.text((left + TEXT_X, 44), title, 20, INK, bold=True)
        svg.text((left + TEXT_X, 68), f"{told}; feet and face forward", 14, MUTED)
        skeleton, state = standing(pose)
        for x, yaw, seen in ((FRONT_X, 0.0, "front"), (SIDE_X, np.pi / 2, "left side")):
            svg.line((left + x - 60, FLOOR), (left + x + 60, FLOOR), RULE, 3.0)
            draw_body(svg, skeleton, state, Eye(yaw, 0.0, (left + x, FLOOR), SCALE), paler=0.2)
            svg.text((left + x, FLOOR + 24), seen, 13, MUTED, "middle")
    return str(svg)
