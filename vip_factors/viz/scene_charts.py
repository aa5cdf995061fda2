"""Charts of a scene as pictures: headings with their uncertainty, joint error per frame of one or more estimates."""

from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np

from vip_factors.errors import InputError
from vip_factors.viz.canvas import Canvas
from vip_factors.viz.curves_chart import Curve, draw_curves
from vip_factors.viz.drawn_scene import DrawnScene
from vip_factors.viz.headings import rows_of
from vip_factors.viz.headings_chart import INK, draw_headings, headings_height
from vip_factors.viz.wearer_colours import wearer_colour

WIDTH, MARGIN = 1600, 60
CURVES_HEIGHT = 300
BLOCK_WIDTH = 760  # of one wearer's headings in a viewer's panel
LINE_COLOURS = ((62, 110, 190), (40, 150, 90), (226, 120, 40), (150, 90, 190), (200, 60, 80), (90, 100, 115))


def headings_image(drawn: DrawnScene) -> bytes | None:
    """All wearers' headings as a PNG; None if nothing is estimated."""
    blocks = [(wearer, rows_of(wearer)) for wearer in drawn.wearers]
    blocks = [(wearer, rows) for wearer, rows in blocks if rows]
    if not blocks:
        return None
    width = BLOCK_WIDTH * len(blocks) + 20
    canvas = Canvas(width, 20 + max(headings_height(rows) for _, rows in blocks))
    for column, (wearer, rows) in enumerate(blocks):
        left = 20.0 + BLOCK_WIDTH * column
        draw_headings(canvas, left, 10.0, BLOCK_WIDTH - 30, wearer.name, rows, wearer_colour(wearer.index))
    _, encoded = cv2.imencode(".png", canvas.pixels())
    return encoded.tobytes()


def scene_charts(estimates: Mapping[str, DrawnScene], path: Path, *, overwrite: bool = False) -> None:
    """Draw a PNG: joint error per frame of every estimate (as thesis fig. 4.9), then the headings of the last one.

    Args:
        estimates: of one scene, by the name to write beside the curve.
        path: of the PNG.
        overwrite: replace an existing file.

    Raises:
        InputError: if there is neither an error nor a heading to draw, or the file exists.
    """
    if not estimates:
        raise InputError("no chart to draw: expected at least one estimate")
    panels = _error_panels(estimates)
    last = list(estimates.values())[-1]
    blocks = [(wearer, rows) for wearer in last.wearers if (rows := rows_of(wearer))]
    if not panels and not blocks:
        raise InputError("no chart to draw: expected an estimate with headings, or the truth to compare it with")
    height = 90 + (CURVES_HEIGHT + 70) * len(panels) + sum(headings_height(rows) + 20 for _, rows in blocks)
    canvas = Canvas(WIDTH, height)
    canvas.text((MARGIN, 56), last.name, INK, 30, 600)
    top = 90.0
    for name, curves in panels.items():
        box = (MARGIN + 40, top + 50, WIDTH - MARGIN, top + CURVES_HEIGHT)
        draw_curves(canvas, box, curves, f"{name}: joint error, mm (mean)" if name else "joint error, mm (mean)")
        top += CURVES_HEIGHT + 70
    for wearer, rows in blocks:
        title = f"Headings of {wearer.name}" + (f", {list(estimates)[-1]}" if len(estimates) > 1 else "")
        draw_headings(canvas, MARGIN, top, WIDTH - 2 * MARGIN, title, rows, wearer_colour(wearer.index))
        top += headings_height(rows) + 20
    canvas.save(path, overwrite)


def _error_panels(estimates: Mapping[str, DrawnScene]) -> dict[str, list[Curve]]:
    """Curves by wearer; the wearer's name is empty where there is but one."""
    panels: dict[str, list[Curve]] = {}
    for index, (label, drawn) in enumerate(estimates.items()):
        for wearer in drawn.wearers:
            error = wearer.error_mm
            if error is None or wearer.motion is None or not np.any(np.isfinite(error)):
                continue
            name = wearer.name if len(drawn.wearers) > 1 else ""
            colour = LINE_COLOURS[index % len(LINE_COLOURS)]
            panels.setdefault(name, []).append(Curve(label, wearer.motion.time, error, colour))
    return panels
