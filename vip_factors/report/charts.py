"""Curves over time as SVG, with gaps and pale bands, and their numbers for the page's script to read off."""

import itertools
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from vip_factors.body.mannequin import ESTIMATE_COLOURS, TRUTH_COLOUR, Side
from vip_factors.geometry.rotations import Array
from vip_factors.report.blocks import Chart
from vip_factors.viz.charts import GRID, page, panel, round_ticks, seconds_axis, svg
from vip_factors.viz.colours import body_colours, hexadecimal, wearer_colour

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
    figure = page(width, HEIGHT)
    axes = panel(figure, (LEFT, TOP, width - RIGHT, HEIGHT - BOTTOM))
    low = min(float(np.nanquantile(line.values, 1 - OUTLIERS)) for line in lines)
    high = max(float(np.nanquantile(line.values, OUTLIERS)) for line in lines)
    ticks = round_ticks(min(low, 0.0) if from_zero else low, high)
    axes.set_ylim(ticks[0], ticks[-1])
    axes.set_yticks(ticks, [f"{0.0 if abs(tick) < 1e-9 else tick:g}{unit}" for tick in ticks])
    axes.grid(axis="y", color=GRID, linewidth=0.8)
    seconds_axis(axes, min(float(line.time[0]) for line in lines), max(float(line.time[-1]) for line in lines), 8)
    axes.tick_params(labelsize=10, pad=4)
    curves = []
    for line in lines:
        if line.sigma is not None:
            every = slice(None, None, max(1, len(line.time) // BINS))
            band = (line.values - line.sigma)[every], (line.values + line.sigma)[every]
            axes.fill_between(line.time[every], *band, color=line.colour, alpha=0.16, linewidth=0)
        time, values = thinned(line.time, line.values)
        axes.plot(time, values, color=line.colour, linewidth=1.5)
        read = [None if not np.isfinite(value) else round(float(value), decimals) for value in values]
        curves.append({"name": line.name, "time": np.round(time, 3).tolist(), "values": read})
    numbers = {"box": (LEFT, TOP, width - RIGHT, HEIGHT - BOTTOM), "span": axes.get_xlim(), "unit": unit,
               "decimals": decimals, "curves": curves}  # fmt: skip
    legend = tuple((line.name, line.colour) for line in lines)
    return Chart(title, Markup(_embeddable(svg(figure))), legend, json.dumps(numbers, separators=(",", ":")))


def _embeddable(drawing: str) -> str:
    """An SVG element to stand among others in a page: without header and ids of groups, to a tenth of a pixel."""
    drawing = re.sub(r'<g id="[^"]*"', "<g", drawing[drawing.index("<svg") :])
    return re.sub(r"(\d\.\d)\d{2,}", r"\1", drawing)


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


SIDE_COLOURS = {side: hexadecimal(colour) for side, colour in ESTIMATE_COLOURS.items()}
TRUTH = hexadecimal(TRUTH_COLOUR)


def wearer_mark(index: int, of: int) -> str:
    """What marks a wearer's curves: of one alone the trunk's grey."""
    return SIDE_COLOURS[Side.MIDDLE] if of == 1 else hexadecimal(wearer_colour(index))


def sides_of(index: int, of: int) -> dict[Side, str]:
    """Of a body in the 3D view: by side of one wearer alone, else all in the wearer's own."""
    return SIDE_COLOURS if of == 1 else {side: hexadecimal(one) for side, one in body_colours(index).items()}
