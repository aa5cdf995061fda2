"""Curves over time as SVG, and beside each drawing the numbers that the page's script reads off."""

import itertools
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from vip_factors.body.mannequin import ESTIMATE_COLOURS, Side
from vip_factors.geometry.rotations import Array
from vip_factors.viz.charts import GRID, Curve, page, panel, round_ticks, seconds_axis, svg
from vip_factors.viz.colours import body_colours, hexadecimal, wearer_colour

WIDTH, HEIGHT = 540.0, 190.0
LEFT, RIGHT, TOP, BOTTOM = 44.0, 14.0, 10.0, 24.0  # margins
BINS = 320  # of time: of each the least and the largest value are drawn, so that no peak is lost
SIDE_COLOURS = {side: hexadecimal(colour) for side, colour in ESTIMATE_COLOURS.items()}


@dataclass(frozen=True)
class Chart:
    """Drawing of curves over time, with what the page's script needs to read it.

    Attributes:
        title: above it.
        svg: made by Matplotlib, which escapes the texts in it.
        legend: names and colours of the curves.
        numbers: the curves and the box they are drawn in, as JSON.
    """

    title: str
    svg: Markup
    legend: tuple[tuple[str, str], ...]
    numbers: str


def time_charts(
    title: str, curves: Sequence[Curve], unit: str = "", from_zero: bool = False, decimals: int = 1, wide: bool = False
) -> list[Chart]:
    """A chart of some curves on one scale; none if there is no finite value.

    Args:
        title: above the chart.
        curves: at least one.
        unit: of the values, written after them.
        from_zero: whether the scale begins at zero.
        decimals: of values read off.
        wide: whether it is as wide as the page.
    """
    curves = [curve for curve in curves if np.any(np.isfinite(curve.values))]
    if not curves:
        return []
    width = 2 * WIDTH + 20 if wide else WIDTH
    figure = page(width, HEIGHT)
    axes = panel(figure, (LEFT, TOP, width - RIGHT, HEIGHT - BOTTOM))
    usual = 0.998  # of all values are within the scale: one wild frame must not flatten the others
    low = min(float(np.nanquantile(curve.values, 1 - usual)) for curve in curves)
    high = max(float(np.nanquantile(curve.values, usual)) for curve in curves)
    ticks = round_ticks(min(low, 0.0) if from_zero else low, high)
    axes.set_ylim(ticks[0], ticks[-1])
    axes.set_yticks(ticks, [f"{0.0 if abs(tick) < 1e-9 else tick:g}{unit}" for tick in ticks])
    axes.grid(axis="y", color=GRID, linewidth=0.8)
    start, end = min(float(curve.time[0]) for curve in curves), max(float(curve.time[-1]) for curve in curves)
    seconds_axis(axes, start, end, 8)
    axes.tick_params(labelsize=10, pad=4)
    readings = []
    for curve in curves:
        if curve.sigma is not None:
            every = slice(None, None, max(1, len(curve.time) // BINS))
            band = (curve.values - curve.sigma)[every], (curve.values + curve.sigma)[every]
            axes.fill_between(curve.time[every], *band, color=curve.colour, alpha=0.16, linewidth=0)
        time, values = thinned(curve.time, curve.values)
        axes.plot(time, values, color=curve.colour, linewidth=1.5)
        read = [None if not np.isfinite(value) else round(float(value), decimals) for value in values]
        readings.append({"name": curve.name, "time": np.round(time, 3).tolist(), "values": read})
    box = (LEFT, TOP, width - RIGHT, HEIGHT - BOTTOM)
    numbers = {"box": box, "span": axes.get_xlim(), "unit": unit, "decimals": decimals, "curves": readings}
    legend = tuple((curve.name, curve.colour) for curve in curves)
    return [Chart(title, Markup(_embeddable(svg(figure))), legend, json.dumps(numbers, separators=(",", ":")))]


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


def wearer_mark(index: int, wearers: int) -> str:
    """Colour of a wearer's curves: the trunk's grey where there is one wearer alone."""
    return SIDE_COLOURS[Side.MIDDLE] if wearers == 1 else hexadecimal(wearer_colour(index))


def side_colours(index: int, wearers: int) -> dict[Side, str]:
    """Colours of a body in the 3D view: by side where there is one wearer alone, else shades of the wearer's own."""
    if wearers == 1:
        return SIDE_COLOURS
    return {side: hexadecimal(colour) for side, colour in body_colours(index).items()}
