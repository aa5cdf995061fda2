"""What a section of the page is made of; the template says how each looks, and escapes every text.

Curves over time are SVG, with gaps and pale bands, and their numbers stand there for the page's script to read off;
other numbers, and names, are written as people write them.
"""

import itertools
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from markupsafe import Markup

from vip_factors.body.mannequin import ESTIMATE_COLOURS, TRUTH_COLOUR, Side
from vip_factors.findings import Severity
from vip_factors.geometry.rotations import Array
from vip_factors.viz.charts import GRID, page, panel, round_ticks, seconds_axis, svg
from vip_factors.viz.colours import body_colours, hexadecimal, wearer_colour

UNKNOWN = "\u2013"  # a dash
WIDTH, HEIGHT = 540.0, 190.0
LEFT, RIGHT, TOP, BOTTOM = 44.0, 14.0, 10.0, 24.0  # margins
BINS = 320  # of time: of each the least and the largest value are drawn, so that no peak is lost
OUTLIERS = 0.998  # of all values are within the scale: one wild frame must not flatten the others


@dataclass(frozen=True)
class Paragraph:
    """Running text; ``small`` for a remark."""

    kind: ClassVar[str] = "paragraph"
    text: str
    small: bool = False


@dataclass(frozen=True)
class Heading:
    """Of a part of a section."""

    kind: ClassVar[str] = "heading"
    text: str


@dataclass(frozen=True)
class Tile:
    """One figure: what it is, its value, and a remark."""

    label: str
    value: str
    remark: str = ""


@dataclass(frozen=True)
class Tiles:
    """Figures in a row."""

    kind: ClassVar[str] = "tiles"
    tiles: tuple[Tile, ...]


@dataclass(frozen=True)
class Remark:
    """A remark with its weight: a headline, then what it means and what to do."""

    weight: Severity
    headline: str
    meaning: str = ""
    advice: str = ""
    detail: str = ""


@dataclass(frozen=True)
class Remarks:
    """One below the other, the weightiest first."""

    kind: ClassVar[str] = "remarks"
    remarks: tuple[Remark, ...]


@dataclass(frozen=True)
class Table:
    """Text in rows; the first ``words`` columns hold words, the others numbers. Folded away if ``folded``."""

    kind: ClassVar[str] = "table"
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""
    words: int = 1
    folded: bool = False


@dataclass(frozen=True)
class Chart:
    """A drawing of curves over time, with what the page's script needs to read it.

    Attributes:
        title: above it.
        svg: made by us; no text in it comes from outside.
        legend: names and colours of the curves.
        numbers: the curves and the box they are drawn in, as JSON.
    """

    kind: ClassVar[str] = "chart"
    title: str
    svg: Markup
    legend: tuple[tuple[str, str], ...]
    numbers: str


@dataclass(frozen=True)
class Charts:
    """Several, side by side where there is room."""

    kind: ClassVar[str] = "charts"
    charts: tuple[Chart, ...]


@dataclass(frozen=True)
class Image:
    """What is to be seen, as a ``data:`` address, and in words; ``wide`` of a frame of a video."""

    source: str
    alt: str
    wide: bool = False


@dataclass(frozen=True)
class Picture:
    """Images side by side with a headline, text, and the time that they show; None if they show no single one."""

    images: tuple[Image, ...]
    headline: str
    text: str
    time: float | None


@dataclass(frozen=True)
class Pictures:
    """Several, side by side where there is room."""

    kind: ClassVar[str] = "pictures"
    pictures: tuple[Picture, ...]


Block = Paragraph | Heading | Tiles | Remarks | Table | Charts | Pictures


@dataclass(frozen=True)
class Section:
    """A part of the page.

    Attributes:
        id: that links point to.
        title: above it, and in the page's list of sections.
        blocks: in order.
    """

    id: str
    title: str
    blocks: tuple[Block, ...]


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


def count(number: int, one: str) -> str:
    """``1 sensor``, ``13 sensors``."""
    return f"{number} {one if number == 1 else one + 's'}"


def listed(words: Sequence[str]) -> str:
    """``a``, ``a and b``, ``a, b and c``."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def seconds_words(seconds: float) -> str:
    """``12.3 s``, ``4 min 05 s``."""
    return f"{seconds:.1f} s" if seconds < 120 else f"{int(seconds) // 60} min {int(seconds) % 60:02d} s"


def number(value: float, decimals: int = 1) -> str:
    """Without a minus before zero; a dash for what is not known."""
    return f"{value:z.{decimals}f}" if np.isfinite(value) else UNKNOWN


def with_unit(value: float, unit: str, decimals: int = 1) -> str:
    """``1.75 m``, ``3.1°``; a dash for what is not known."""
    space = "" if unit in ("°", "") else "\u202f"
    return f"{value:z.{decimals}f}{space}{unit}" if np.isfinite(value) else UNKNOWN


def plus_minus(value: float, sigma: float, unit: str = "", decimals: int = 0, sigma_decimals: int = 0) -> str:
    """A value and its standard deviation, which is left out if it is not known."""
    text = with_unit(value, unit, decimals)
    return f"{text} ± {sigma:.{sigma_decimals}f}" if np.isfinite(sigma) and np.isfinite(value) else text


def joint_words(name: str) -> str:
    """``left_knee`` → ``left knee``."""
    return name.replace("_", " ")


def capital(text: str) -> str:
    """With a large first letter."""
    return text[:1].upper() + text[1:]


BONE_WORDS = {"hip": "thigh", "knee": "shank", "ankle": "foot", "shoulder": "upper arm", "elbow": "forearm",
              "wrist": "hand", "foot": "toes", "hand": "fingers", "collar": "collar bone",
              "spine1": "lower back", "spine2": "middle back", "spine3": "chest"}  # fmt: skip


def bone_words(bone: str) -> str:
    """What people call a bone: ``left_knee`` is the left shank."""
    side, _, joint = bone.rpartition("_")
    return f"{side} {BONE_WORDS.get(joint, joint)}".strip()
