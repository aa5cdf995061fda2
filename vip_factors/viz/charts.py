"""Charts by matplotlib, on pages measured in pixels: curves over time, headings beside the truth, the sensors' colours.

Its import takes some tenths of a second: whoever draws imports it late.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from vip_factors.atomic import atomic_path
from vip_factors.body.mannequin import Colour
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array
from vip_factors.viz.colours import hexadecimal, mixed, wearer_colour
from vip_factors.viz.drawn_scene import DrawnScene, HeadingRow, rows_of

INK, SOFT_INK, GRID, ERROR = "#282e3a", "#66707e", "#e4e7ec", "#c44854"
LINE_COLOURS = ("#3e6ebe", "#289650", "#e27828", "#965abe", "#c83c50", "#5a6473")
WIDTH, MARGIN, TEXT = 1600, 60, 16.0
ROW_HEIGHT, HEAD_HEIGHT, FOOT_HEIGHT, NAME_WIDTH, GAP = 28, 64, 44, 190, 60  # of headings
# A bar that is longer than the first says "unknown" as well as one that fills the panel.
WIDEST_ERROR_DEG, NARROWEST_ERROR_DEG = 90.0, 2.0
LEGEND_COLUMNS, LEGEND_ROW_PX, LEGEND_PAPER = 5, 40, "#101113"  # dark as the plots of Rerun that it explains

Point = tuple[float, float]
Box = tuple[float, float, float, float]
"""Left, top, right and bottom in pixels of the page; y goes down."""


@dataclass(frozen=True)
class Curve:
    """Values ``(T,)`` at times ``(T,)`` seconds, gaps where not finite; in the legend if it has a name.

    ``sigma`` ``(T,)`` is drawn as a pale band on the report's page.
    """

    name: str
    time: Array
    values: Array
    colour: str = ERROR
    sigma: Array | None = None


def page(width: float, height: float, paper: str = "white") -> Figure:
    """An empty picture of a size in pixels: sizes of text and lines are pixels too."""
    figure = Figure(figsize=(width / 72, height / 72), dpi=72, facecolor=paper)
    FigureCanvasAgg(figure)
    return figure


def size_of(figure: Figure) -> tuple[float, float]:
    """Width and height in pixels."""
    width, height = figure.get_size_inches() * 72
    return float(width), float(height)


def write(
    figure: Figure, at: tuple[float, float], text: str, size: float = TEXT, colour: str = INK, **more: Any
) -> None:
    """Text from a point on its baseline, in pixels of the page."""
    width, height = size_of(figure)
    figure.text(at[0] / width, 1 - at[1] / height, text, size=size, color=colour, **more)


def panel(figure: Figure, box: Box) -> Axes:
    """Axes without a frame in a part of the page."""
    width, height = size_of(figure)
    left, top, right, bottom = box
    size = max(right - left, 1.0) / width, max(bottom - top, 1.0) / height
    axes = figure.add_axes((left / width, 1 - bottom / height, *size))
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0, labelsize=TEXT, labelcolor=SOFT_INK, pad=7)
    axes.set_axisbelow(True)
    return axes


def canvas(width: float, height: float) -> Axes:
    """Axes without a frame over a whole picture of a size in pixels, in which they measure too; y goes down."""
    axes = page(width, height).add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    axes.set_xlim(0, width)
    axes.set_ylim(height, 0)
    axes.set_autoscale_on(False)
    return axes


def save(figure: Figure, path: Path, overwrite: bool = False) -> None:
    """Write a PNG, complete or not at all.

    Raises:
        InputError: if the file exists and must not be overwritten, or is not named ``.png``.
    """
    if Path(path).suffix.lower() != ".png":
        raise InputError(f"{path}: expected a name that ends in .png")
    with atomic_path(Path(path), overwrite) as partial:
        figure.savefig(partial, dpi=72)


def png(figure: Figure) -> bytes:
    """The picture as bytes of a PNG file."""
    file = BytesIO()
    figure.savefig(file, format="png", dpi=72, facecolor=figure.get_facecolor())
    return file.getvalue()


def svg(drawing: Figure | Axes) -> str:
    """The picture, or that which some axes are of, as SVG."""
    figure = drawing if isinstance(drawing, Figure) else drawing.figure
    assert isinstance(figure, Figure), "axes of a part of a figure"
    file = BytesIO()
    svg_dpi = 108  # of what is drawn as pixels within: half as many again as the page has
    with mpl.rc_context(
        {"svg.fonttype": "none", "svg.hashsalt": "vip_factors"}
    ):  # text stays text, a file stays itself
        figure.savefig(file, format="svg", dpi=svg_dpi, metadata=dict.fromkeys(("Date", "Creator", "Type", "Format")))
    return file.getvalue().decode()


def pixels(figure: Figure) -> np.ndarray:
    """The picture ``(height, width, 3)`` uint8, red green blue."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def seconds_axis(axes: Axes, first: float, last: float, most: int = 10) -> None:
    """Label x with seconds at round steps."""
    axes.set_xlim(first, max(last, first + 1e-9))
    axes.xaxis.set_major_locator(MaxNLocator(most, steps=[1, 2, 2.5, 5, 10]))
    axes.xaxis.set_major_formatter(lambda value, _: f"{abs(value) if abs(value) < 1e-9 else value:g} s")


def round_ticks(low: float, high: float) -> Array:
    """At most five round values from ``low`` or below to ``high`` or above."""
    return np.asarray(MaxNLocator(4, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high))


def draw_curves(axes: Axes, curves: Sequence[Curve], label: str, marks: Sequence[float] = ()) -> None:
    """Draw curves from zero up, with one scale.

    A curve alone is filled below, and ``marks`` (seconds) are dots on it; several are lines, and marks cross them. Each
    name is followed by the curve's mean, for that is the number people quote.
    """
    curves = [curve for curve in curves if np.any(np.isfinite(curve.values))]
    if not curves:
        return
    # A single wild frame must not flatten all others: what is above is cut off at the top.
    most = max(float(np.nanquantile(curve.values, 0.995)) for curve in curves)
    ticks = round_ticks(0.0, max(most, 1e-9))
    axes.set_ylim(0.0, ticks[-1])
    axes.set_yticks(ticks)
    axes.yaxis.set_major_formatter("{x:g}")
    axes.grid(axis="y", color=GRID, linewidth=1.2)
    first = min(float(curve.time[0]) for curve in curves)
    seconds_axis(axes, first, max(float(curve.time[-1]) for curve in curves))
    for curve in curves:
        axes.plot(curve.time, curve.values, color=curve.colour, linewidth=2.2, clip_on=True, label=curve.name)
    if len(curves) == 1:
        curve, good = curves[0], np.isfinite(curves[0].values)
        axes.fill_between(curve.time, 0, curve.values, color=curve.colour, alpha=0.12, linewidth=0)
        at = np.interp(marks, curve.time[good], curve.values[good])
        axes.plot(marks, at, "o", color=curve.colour, markersize=9, markeredgecolor="white", clip_on=False)
    else:
        axes.vlines(marks, 0, ticks[-1], color="#cdd2da", linewidth=1.6, zorder=0)
    axes.set_title(label, loc="left", size=TEXT, color=SOFT_INK, pad=10)
    named = [(Line2D([], [], color=one.colour, linewidth=4), one) for one in curves if one.name]
    if named:
        texts = [f"{one.name}  {np.nanmean(one.values):.3g}" for _, one in named]
        axes.legend(
            [line for line, _ in named], texts, loc="lower right", bbox_to_anchor=(1, 1), ncols=len(named),
            frameon=False, prop={"size": TEXT, "weight": "bold"}, labelcolor="linecolor", borderaxespad=0.2,
        )  # fmt: skip


def curve_chart(
    path: Path, title: str, curve: Curve, labels: tuple[str, str], mark: float, overwrite: bool = False
) -> None:
    """Write a PNG of one curve under a title, labelled above and below, with a dot at a mark on x.

    Raises:
        InputError: as :func:`save`.
    """
    figure = page(1200, 520)
    write(figure, (80, 48), title, 24, weight="bold")
    axes = panel(figure, (80, 110, 1160, 430))
    draw_curves(axes, [curve], labels[0], [mark])
    axes.set_xlabel(labels[1], size=TEXT, color=SOFT_INK, labelpad=12)
    save(figure, path, overwrite)


def headings_height(rows: Sequence[HeadingRow]) -> int:
    """Pixels that a chart of these rows takes."""
    return HEAD_HEIGHT + ROW_HEIGHT * len(rows) + FOOT_HEIGHT


def draw_headings(
    figure: Figure, corner: tuple[float, float], width: float, title: str, rows: Sequence[HeadingRow], colour: Colour
) -> None:
    """Draw one wearer's headings: absolute, and where the truth is known the error with one and two sigma.

    Args:
        figure: to draw on.
        corner: left and top in pixels.
        width: in pixels; the height is :func:`headings_height`.
        title: above the rows.
        rows: one per sensor.
        colour: of the wearer.
    """
    left, top = corner
    compared = any(np.isfinite(row.truth) for row in rows)
    write(figure, (left, top + 22), title, 20, weight="bold")
    first, bottom = left + NAME_WIDTH, top + HEAD_HEIGHT + ROW_HEIGHT * len(rows)
    each = (width - NAME_WIDTH - (GAP if compared else 0)) / (2 if compared else 1)
    heading, sigma, truth = (np.array([getattr(row, name) for row in rows]) for name in ("heading", "sigma", "truth"))
    reach = np.abs(heading) + 2 * np.nan_to_num(sigma)
    span = float(np.clip(np.nanmax(np.concatenate([reach, np.abs(truth)])), 5.0, 180.0))
    axes = panel(figure, (first, top + HEAD_HEIGHT, first + each, bottom))
    _rows(axes, heading, sigma, span, "heading, °" + ("   (ring: truth)" if compared else ""), colour)
    axes.set_yticks(range(len(rows)), [row.sensor.replace("_", " ") for row in rows])
    axes.plot(truth, np.arange(len(rows)), "o", markersize=16, markerfacecolor="none", markeredgecolor=INK)
    if not compared:
        return
    error = np.where(np.isfinite(truth), [row.error for row in rows], np.nan)
    span = float(np.nanmax(np.abs(error) + 2 * np.nan_to_num(sigma)))
    axes = panel(figure, (first + each + GAP, top + HEAD_HEIGHT, first + 2 * each + GAP, bottom))
    span = float(np.clip(span, NARROWEST_ERROR_DEG, WIDEST_ERROR_DEG))
    _rows(axes, error, sigma, span, "error, °   (bars: 1, 2 sigma)", colour)
    axes.set_yticks([])


def _rows(axes: Axes, values: Array, sigma: Array, span: float, label: str, colour: Colour) -> None:
    """A dot with bars of one and two sigma for each row, the first uppermost."""
    y = np.arange(len(values))
    for row in y[::2]:
        axes.axhspan(row - 0.5, row + 0.5, color="#f7f8fa", zorder=0)
    axes.axvline(0, color=hexadecimal(mixed((228, 231, 236), (40, 46, 58), 0.4)), linewidth=1.6, zorder=1)
    axes.grid(axis="x", color=GRID, linewidth=1.2)
    pale, shown = hexadecimal(mixed(colour, (255, 255, 255), 0.35)), np.clip(values, -span, span)
    for times, thickness in ((2.0, 2.0), (1.0, 6.0)):
        axes.hlines(y, values - times * sigma, values + times * sigma, color=pale, linewidth=thickness, zorder=2)
    axes.plot(shown, y, "o", color=hexadecimal(colour), markersize=11, markeredgecolor="white", zorder=3)
    axes.set_xlim(-1.04 * span, 1.04 * span)
    axes.set_ylim(len(values) - 0.5, -0.5)
    axes.xaxis.set_major_locator(MaxNLocator(9, steps=[1, 2, 2.5, 5, 10]))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set_title(label, loc="left", size=TEXT, color=SOFT_INK, pad=8)


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
    errors = _error_curves(estimates)
    last = list(estimates.values())[-1]
    blocks = [(wearer, rows) for wearer in last.wearers if (rows := rows_of(wearer))]
    if not errors and not blocks:
        raise InputError("no chart to draw: expected an estimate with headings, or the truth to compare it with")
    curves_height = 300
    figure = page(
        WIDTH, 90 + (curves_height + 70) * len(errors) + sum(headings_height(rows) + 20 for _, rows in blocks)
    )
    write(figure, (MARGIN, 56), last.name, 28, weight="bold")
    top = 90.0
    for name, curves in errors.items():
        axes = panel(figure, (MARGIN + 40, top + 50, WIDTH - MARGIN, top + curves_height))
        draw_curves(axes, curves, f"{name}: joint error, mm (mean)" if name else "joint error, mm (mean)")
        top += curves_height + 70
    for wearer, rows in blocks:
        title = f"Headings of {wearer.name}" + (f", {list(estimates)[-1]}" if len(estimates) > 1 else "")
        draw_headings(figure, (MARGIN, top), WIDTH - 2 * MARGIN, title, rows, wearer_colour(wearer.index))
        top += headings_height(rows) + 20
    save(figure, path, overwrite)


def _error_curves(estimates: Mapping[str, DrawnScene]) -> dict[str, list[Curve]]:
    """Curves by wearer; the wearer's name is empty where there is but one."""
    curves: dict[str, list[Curve]] = {}
    for index, (label, drawn) in enumerate(estimates.items()):
        for wearer in drawn.wearers:
            error = wearer.error_mm
            if error is not None and wearer.motion is not None and np.any(np.isfinite(error)):
                name = wearer.name if len(drawn.wearers) > 1 else ""
                colour = LINE_COLOURS[index % len(LINE_COLOURS)]
                curves.setdefault(name, []).append(Curve(label, wearer.motion.time, error, colour))
    return curves


def colour_legend(colours: Mapping[str, Colour]) -> Figure:
    """A square in its colour beside every sensor's name, columns filled first: Rerun's legends fit no small plot."""
    rows = -(-len(colours) // LEGEND_COLUMNS)
    figure = page(1200, LEGEND_ROW_PX * rows + 20, LEGEND_PAPER)
    axes = panel(figure, (0, 10, 1200, LEGEND_ROW_PX * rows + 10))
    axes.set_axis_off()
    axes.set_xlim(0, LEGEND_COLUMNS)
    axes.set_ylim(rows - 0.5, -0.5)
    for index, (sensor, colour) in enumerate(colours.items()):
        column, row = divmod(index, rows)
        axes.plot(column + 0.08, row, "s", color=hexadecimal(colour), markersize=20)
        axes.text(column + 0.14, row, sensor.replace("_", " "), size=21, color="#d6dae0", va="center_baseline")
    return figure
