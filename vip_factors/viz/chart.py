"""One curve over time on a canvas, with a scale that people can read."""

import numpy as np

from vip_factors.geometry.rotations import Array
from vip_factors.viz.canvas import Canvas

LINE, FILL, GRID, LABEL = (196, 72, 84), (250, 233, 234), (228, 231, 236), (120, 128, 140)
TICKS = (1.0, 2.0, 2.5, 5.0, 10.0)  # times a power of ten: steps that people count in


def tick_step(span: float, most: int) -> float:
    """The smallest round step that divides ``span`` into at most ``most`` parts."""
    if not span > 0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(span / most))
    return float(next(tick * power for tick in TICKS if tick * power * most >= span * (1 - 1e-9)))


def draw_chart(
    canvas: Canvas, box: tuple[float, float, float, float], time: Array, values: Array, label: str, marks: Array
) -> None:
    """Draw ``values`` ``(T,)`` over ``time`` ``(T,)`` seconds, from zero up.

    Args:
        canvas: to draw on.
        box: left, top, right, bottom of the axes in pixels.
        time, values: the curve; values that are not finite are left out.
        label: of the vertical axis, written above it.
        marks: times in seconds to mark with a dot on the curve.
    """
    good = np.isfinite(values)
    if not np.any(good):
        return
    left, top, right, bottom = box
    time, values = time[good], values[good]
    step = tick_step(float(values.max()), 4)
    highest = max(step * np.ceil(values.max() / step - 1e-9), step)
    first, last = float(time[0]), float(time[-1])

    def place(t: Array, v: Array) -> Array:
        x = left + (right - left) * (t - first) / max(last - first, 1e-9)
        return np.stack([x, bottom - (bottom - top) * v / highest], axis=-1)

    curve = place(time, values)
    canvas.polygon(np.concatenate([[[curve[0, 0], bottom]], curve, [[curve[-1, 0], bottom]]]), FILL)
    for value in np.arange(0.0, highest + step / 2, step):
        y = bottom - (bottom - top) * value / highest
        canvas.curve([[left, y], [right, y]], GRID, 1.2)
        text = f"{value:g}"
        canvas.text((left - 12 - canvas.text_width(text, 17), y + 6), text, LABEL, 17)
    canvas.text((left, top - 16), label, LABEL, 17)
    canvas.curve(curve, LINE, 2.2)
    marked = place(marks, np.interp(marks, time, values))
    for point in marked:
        canvas.ellipse(point, 6.0, 6.0, (255, 255, 255))
        canvas.ellipse(point, 4.4, 4.4, LINE)
    second = tick_step(last - first, 10)
    for t in np.arange(np.ceil(first / second - 0.01) * second, last + 1e-9, second):
        x = left + (right - left) * (t - first) / max(last - first, 1e-9)
        text = f"{abs(t) if abs(t) < 1e-9 else t:g} s"
        canvas.text((x - canvas.text_width(text, 17) / 2, bottom + 24), text, LABEL, 17)
