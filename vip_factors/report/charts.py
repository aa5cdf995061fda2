"""Curves over time, drawn as SVG in the colours of the page: with gaps, pale bands and a scale that people can read."""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

import numpy as np
from markupsafe import Markup

from vip_factors.body.mannequin import ESTIMATE_COLOURS, TRUTH_COLOUR, Side
from vip_factors.geometry.rotations import Array
from vip_factors.report.blocks import Chart
from vip_factors.viz.colours import body_colours, hexadecimal, wearer_colour
from vip_factors.viz.svg import MUTED, RULE, Svg

WIDTH, HEIGHT = 540.0, 190.0
LEFT, RIGHT, TOP, BOTTOM = 44.0, 14.0, 10.0, 24.0  # margins
BINS = 320  # of time: of each the least and the largest value are drawn, so that no peak is lost
OUTLIERS = 0.998  # of all values are within the scale: one wild frame must not flatten the others


@dataclass(frozen=True)
class Line:
    """Values ``(T,)`` at times ``(T,)`` seconds, NaN for gaps; ``sigma`` ``(T,)`` is drawn as a pale band."""

    name: str
    time: Array
    values: Array
    colour: str
    sigma: Array | None = None


def time_chart(
    title: str, lines: Sequence[Line], unit: str = "", from_zero: bool = False, decimals: int = 1, wide: bool = False
) -> Chart | None:
    """Draw some curves on one scale; None if there is no finite value.

    Args:
        title: above the chart.
        lines: the curves.
        unit: of the values, written after them.
        from_zero: whether the scale begins at zero.
        decimals: of values read off.
        wide: as wide as the page.
    """
    lines = [line for line in lines if np.any(np.isfinite(line.values))]
    if not lines:
        return None
    width = 2 * WIDTH + 20 if wide else WIDTH
    first = min(float(line.time[0]) for line in lines)
    last = max(float(line.time[-1]) for line in lines)
    low, high, step = _scale(lines, from_zero)
    svg, box = Svg(width, HEIGHT), (LEFT, TOP, width - RIGHT, HEIGHT - BOTTOM)

    def x(time: Array | float) -> Array:
        return np.asarray(box[0] + (box[2] - box[0]) * (np.asarray(time) - first) / max(last - first, 1e-9))

    def y(value: Array | float) -> Array:
        share = (np.asarray(value) - low) / (high - low)
        return np.asarray(box[3] - (box[3] - box[1]) * np.clip(share, 0, 1))

    _axes(svg, box, (first, last), (low, high, step), unit)
    for line in lines:
        if line.sigma is not None:
            _band(svg, line, x, y)
    for line in lines:
        time, values = thinned(line.time, line.values)
        for part in _whole(values):
            points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x(time[part]), y(values[part]), strict=True))
            svg.elements.append(
                f'<polyline data-name={quoteattr(line.name)} points="{points}" fill="none" stroke="{line.colour}" '
                'stroke-width="1.5" stroke-linejoin="round"/>'
            )
    scale = {"left": box[0], "right": box[2], "top": box[1], "bottom": box[3], "t0": first, "t1": last}
    numbers = {name: f"{value:.6g}" for name, value in {**scale, "y0": low, "y1": high, "decimals": decimals}.items()}
    legend = tuple((line.name, line.colour) for line in lines)
    return Chart(title, Markup(str(svg)), legend, {**numbers, "unit": unit})


def thinned(time: Array, values: Array) -> tuple[Array, Array]:
    """Of many samples the least and the largest of each of :data:`BINS` stretches, in the order of time."""
    if len(time) <= 2 * BINS:
        return time, values
    edges = np.linspace(0, len(time), BINS + 1).astype(int)
    kept = []
    for start, stop in itertools.pairwise(edges):
        part = values[start:stop]
        if np.isfinite(part).all():
            kept += sorted({start + int(np.argmin(part)), start + int(np.argmax(part))})
        else:  # a gap, if only of a frame, is to be seen
            kept += [*np.flatnonzero(np.isfinite(part))[:1] + start, start + int(np.flatnonzero(~np.isfinite(part))[0])]
            kept.sort()
    chosen = np.array(kept, int)
    return time[chosen], values[chosen]


def _scale(lines: Sequence[Line], from_zero: bool) -> tuple[float, float, float]:
    """Least and largest value of the scale, and the step of its ticks."""
    low = min(float(np.nanquantile(line.values, 1 - OUTLIERS)) for line in lines)
    high = max(float(np.nanquantile(line.values, OUTLIERS)) for line in lines)
    if from_zero:
        low = min(low, 0.0)
    if high - low < 1e-6:
        low, high = low - 0.5, high + 0.5
    step = tick_step(high - low, 4)
    low, high = step * float(np.floor(low / step + 1e-9)), step * float(np.ceil(high / step - 1e-9))
    return low, max(high, low + step), step


def _axes(
    svg: Svg, box: tuple[float, ...], time: tuple[float, float], value: tuple[float, float, float], unit: str
) -> None:
    left, top, right, bottom = box
    low, high, step = value
    for tick in np.arange(low, high + step / 2, step):
        at = bottom - (bottom - top) * (tick - low) / (high - low)
        svg.line((left, at), (right, at), MUTED if abs(tick) < 1e-9 else RULE, 0.8)
        svg.text((left - 5, at + 3.5), f"{0.0 if abs(tick) < 1e-9 else tick:g}{unit}", 10, MUTED, "end")
    second = tick_step(time[1] - time[0], 8)
    for tick in np.arange(np.ceil(time[0] / second - 0.01) * second, time[1] + 1e-9, second):
        at = left + (right - left) * (tick - time[0]) / max(time[1] - time[0], 1e-9)
        svg.line((at, bottom), (at, bottom + 3), MUTED, 0.8)
        svg.text((at, bottom + 15), f"{0.0 if abs(tick) < 1e-9 else tick:g} s", 10, MUTED, "middle")


def _band(svg: Svg, line: Line, x: Callable[[Array], Array], y: Callable[[Array], Array]) -> None:
    assert line.sigma is not None
    every = slice(None, None, max(1, len(line.time) // BINS))
    time, low, high = line.time[every], (line.values - line.sigma)[every], (line.values + line.sigma)[every]
    for part in _whole(low + high):
        there = [*zip(x(time[part]), y(high[part]), strict=True)]
        back = [*zip(x(time[part]), y(low[part]), strict=True)][::-1]
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in (*there, *back))
        svg.elements.append(f'<polygon points="{points}" fill="{line.colour}" fill-opacity="0.16"/>')


def _whole(values: Array) -> list[slice]:
    """Runs of finite values that are at least two long."""
    good = np.concatenate([[False], np.isfinite(values), [False]])
    edges = np.flatnonzero(np.diff(good.astype(int)))
    return [slice(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a > 1]


SIDE_COLOURS = {side: hexadecimal(colour) for side, colour in ESTIMATE_COLOURS.items()}
TRUTH = hexadecimal(TRUTH_COLOUR)


def wearer_mark(index: int, of: int) -> str:
    """What marks a wearer's curves: of one alone the trunk's grey."""
    return SIDE_COLOURS[Side.MIDDLE] if of == 1 else hexadecimal(wearer_colour(index))


def sides_of(index: int, of: int) -> dict[Side, str]:
    """Of a body in the 3D view: by side of one wearer alone, else all in the wearer's own."""
    return SIDE_COLOURS if of == 1 else {side: hexadecimal(one) for side, one in body_colours(index).items()}


TICKS = (1.0, 2.0, 2.5, 5.0, 10.0)  # times a power of ten: steps that people count in


def tick_step(span: float, most: int) -> float:
    """The smallest round step that divides ``span`` into at most ``most`` parts."""
    if not span > 0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(span / most))
    return float(next(tick * power for tick in TICKS if tick * power * most >= span * (1 - 1e-9)))
