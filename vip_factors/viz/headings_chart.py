"""Headings as a chart: a row per sensor, the estimate with its uncertainty beside the truth."""

from collections.abc import Sequence

import numpy as np

from vip_factors.body.mannequin import Colour
from vip_factors.viz.canvas import Canvas, mixed
from vip_factors.viz.chart import GRID, LABEL, tick_step
from vip_factors.viz.headings import HeadingRow

INK: Colour = (40, 46, 58)
TRUTH: Colour = (40, 46, 58)
ROW_HEIGHT, HEAD_HEIGHT, FOOT_HEIGHT = 28, 64, 44
NAME_WIDTH, GAP = 190, 60
TEXT = 17
TICK_WIDTH = 62  # pixels that a number below the axis takes, with air around it
WIDEST_ERROR_DEG = 90.0  # a bar that is longer says "unknown" as well as one that fills the panel
NARROWEST_ERROR_DEG = 2.0


def headings_height(rows: Sequence[HeadingRow]) -> int:
    """Pixels that a chart of these rows takes."""
    return HEAD_HEIGHT + ROW_HEIGHT * len(rows) + FOOT_HEIGHT


def draw_headings(
    canvas: Canvas, left: float, top: float, width: float, title: str, rows: Sequence[HeadingRow], colour: Colour
) -> None:
    """Draw one wearer's headings: absolute, and where the truth is known the error with one and two sigma.

    Args:
        canvas: to draw on.
        left, top, width: in pixels; the height is :func:`headings_height`.
        title: above the rows.
        rows: one per sensor.
        colour: of the wearer.
    """
    compared = any(np.isfinite(row.truth) for row in rows)
    canvas.text((left, top + 22), title, INK, 21, 600)
    first = left + NAME_WIDTH
    panel = (width - NAME_WIDTH - (GAP if compared else 0)) / (2 if compared else 1)
    y = [top + HEAD_HEIGHT + ROW_HEIGHT * (index + 0.5) for index in range(len(rows))]
    for at, row in zip(y, rows, strict=True):
        name = row.sensor.replace("_", " ")
        canvas.text((first - 16 - canvas.text_width(name, TEXT), at + 6), name, LABEL, TEXT)
    absolute = [
        abs(v) + 2 * (s if np.isfinite(s) else 0) for r in rows for v, s in ((r.heading, r.sigma), (r.truth, 0.0))
    ]
    span = float(np.clip(np.nanmax(absolute), 5.0, 180.0)) if rows else 5.0
    _panel(canvas, (first, first + panel), y, span, "heading, °" + ("   (ring: truth)" if compared else ""))
    for at, row in zip(y, rows, strict=True):
        _whisker(canvas, (first, first + panel), span, at, row.heading, row.sigma, colour, np.isfinite(row.truth))
        if np.isfinite(row.truth):
            _ring(canvas, _x((first, first + panel), span, row.truth), at)
    if not compared:
        return
    second = first + panel + GAP
    reach = [abs(r.error) + 2 * (r.sigma if np.isfinite(r.sigma) else 0.0) for r in rows if np.isfinite(r.truth)]
    span = float(np.clip(np.nanmax(reach), NARROWEST_ERROR_DEG, WIDEST_ERROR_DEG))
    _panel(canvas, (second, second + panel), y, span, "error, °   (bars: 1, 2 sigma)")
    for at, row in zip(y, rows, strict=True):
        if np.isfinite(row.truth):
            _whisker(canvas, (second, second + panel), span, at, row.error, row.sigma, colour)


def _x(sides: tuple[float, float], span: float, value: float) -> float:
    middle, half = (sides[0] + sides[1]) / 2, (sides[1] - sides[0]) / 2
    return middle + half * float(np.clip(value / (1.04 * span), -1, 1))


def _panel(canvas: Canvas, sides: tuple[float, float], y: Sequence[float], span: float, label: str) -> None:
    top, bottom = y[0] - ROW_HEIGHT / 2, y[-1] + ROW_HEIGHT / 2
    canvas.text((sides[0], top - 12), label, LABEL, TEXT)
    step = tick_step(2 * span, max(2, int((sides[1] - sides[0]) / TICK_WIDTH)))
    for index, at in enumerate(y):
        if index % 2 == 0:
            band = [[sides[0], at - ROW_HEIGHT / 2], [sides[1], at - ROW_HEIGHT / 2]]
            canvas.polygon([*band, *[[x, at + ROW_HEIGHT / 2] for x, _ in reversed(band)]], (247, 248, 250))
    for tick in step * np.arange(-np.floor(span / step), np.floor(span / step) + 1):
        x = _x(sides, span, float(tick))
        zero = abs(tick) < 1e-9
        canvas.curve([[x, top], [x, bottom]], mixed(GRID, INK, 0.4) if zero else GRID, 1.6 if zero else 1.2)
        text = f"{0.0 if zero else tick:g}"
        canvas.text((x - canvas.text_width(text, TEXT) / 2, bottom + 24), text, LABEL, TEXT)


def _whisker(
    canvas: Canvas, sides: tuple[float, float], span: float, y: float, value: float, sigma: float, colour: Colour,
    small: bool = False,
) -> None:  # fmt: skip
    for times, thickness in ((2.0, 2.0), (1.0, 6.0)) if np.isfinite(sigma) else ():
        ends = [[_x(sides, span, value + side * times * sigma), y] for side in (-1, 1)]
        canvas.curve(ends, mixed(colour, (255, 255, 255), 0.35), thickness)
    radius = 4.6 if small else 5.6
    at = np.array([_x(sides, span, value), y])
    canvas.ellipse(at, radius + 1.4, radius + 1.4, (255, 255, 255))
    canvas.ellipse(at, radius, radius, colour)


def _ring(canvas: Canvas, x: float, y: float) -> None:
    angles = np.linspace(0, 2 * np.pi, 49)
    circle = np.array([x, y]) + 8.0 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    canvas.curve(circle, TRUTH, 1.5)
