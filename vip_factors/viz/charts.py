"""Charts by Matplotlib, on pages measured in pixels: axes, curves over time, and files.

Its import takes some tenths of a second: whoever draws imports it late.
"""

from collections.abc import Sequence
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
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array

INK, SOFT_INK, GRID, ERROR = "#282e3a", "#66707e", "#e4e7ec", "#c44854"
WIDTH, MARGIN, TEXT = 1600, 60, 16.0

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


def page(width: float, height: float) -> Figure:
    """An empty picture of a size in pixels: sizes of text and lines are pixels too."""
    figure = Figure(figsize=(width / 72, height / 72), dpi=72)
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
