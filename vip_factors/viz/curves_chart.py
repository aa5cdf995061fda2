"""Several curves over time on a canvas, from zero up, each with its name."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vip_factors.body.mannequin import Colour
from vip_factors.geometry.rotations import Array
from vip_factors.viz.canvas import Canvas
from vip_factors.viz.chart import GRID, LABEL, tick_step

TEXT = 17


@dataclass(frozen=True)
class Curve:
    """Values ``(T,)`` at times ``(T,)`` seconds; values that are not finite are gaps."""

    name: str
    time: Array
    values: Array
    colour: Colour


def draw_curves(
    canvas: Canvas,
    box: tuple[float, float, float, float],
    curves: Sequence[Curve],
    label: str,
    marks: Array | None = None,
) -> None:
    """Draw curves into a box (left, top, right, bottom in pixels), with one scale; ``marks`` (seconds) get a line.

    Each name is followed by the curve's mean, for that is the number people quote.
    """
    curves = [curve for curve in curves if np.any(np.isfinite(curve.values))]
    if not curves:
        return
    left, top, right, bottom = box
    # A single wild frame must not flatten all others: what is above is cut off at the top.
    most = max(float(np.nanquantile(curve.values, 0.995)) for curve in curves) * 1.08
    step = tick_step(most, 4)
    highest = max(step * float(np.ceil(most / step - 1e-9)), step)
    first = min(float(curve.time[0]) for curve in curves)
    last = max(float(curve.time[-1]) for curve in curves)

    def x(t: Array | float) -> Array:
        return np.asarray(left + (right - left) * (np.asarray(t) - first) / max(last - first, 1e-9))

    for value in np.arange(0.0, highest + step / 2, step):
        y = bottom - (bottom - top) * value / highest
        canvas.curve([[left, y], [right, y]], GRID, 1.2)
        text = f"{value:g}"
        canvas.text((left - 12 - canvas.text_width(text, TEXT), y + 6), text, LABEL, TEXT)
    for mark in marks if marks is not None else ():
        canvas.curve([[float(x(mark)), top], [float(x(mark)), bottom]], (205, 210, 218), 1.6)
    for curve in curves:
        height = bottom - (bottom - top) * np.clip(curve.values / highest, 0, 1)
        for part in _whole(curve.values):
            canvas.curve(np.stack([x(curve.time[part]), height[part]], axis=1), curve.colour, 2.2)
    second = tick_step(last - first, 10)
    for t in np.arange(np.ceil(first / second - 0.01) * second, last + 1e-9, second):
        text = f"{abs(t) if abs(t) < 1e-9 else t:g} s"
        canvas.text((float(x(t)) - canvas.text_width(text, TEXT) / 2, bottom + 24), text, LABEL, TEXT)
    at = canvas.text((left, top - 16), label, LABEL, TEXT) + 28
    for curve in curves:
        canvas.curve([[at, top - 22], [at + 26, top - 22]], curve.colour, 4.0)
        name = f"{curve.name}  {np.nanmean(curve.values):.3g}"
        at = canvas.text((at + 34, top - 16), name, curve.colour, TEXT, 600) + 28


def _whole(values: Array) -> list[slice]:
    """Runs of finite values that are at least two long."""
    good = np.concatenate([[False], np.isfinite(values), [False]])
    edges = np.flatnonzero(np.diff(good.astype(int)))
    return [slice(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a > 1]
