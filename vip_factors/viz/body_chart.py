"""A picture of the body that was found: beside what was likely beforehand, and the truth if that is known (SVG)."""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, MaxNLocator

from vip_factors.estimate import BodyEstimate
from vip_factors.geometry.rotations import Array
from vip_factors.viz.charts import ERROR, GRID, INK, SOFT_INK, page, panel, size_of, svg, write

WIDTH, MARGIN, TOP, ROW, GAP = 980.0, 36.0, 138.0, 24.0, 84.0
AXIS = (210.0, 690.0)  # from left to right
COLUMNS = ((790.0, "likely"), (880.0, "found"), (944.0, "truth"))  # right edges of the numbers
PRIOR = "#8fa3ba"


def body_picture(name: str, body: BodyEstimate, truth: Mapping[str, float] | None = None) -> str:
    """The picture as SVG text.

    Args:
        name: of the wearer.
        body: with lengths, or hinges, or both.
        truth: metres by name of a length, of those of which it is known.
    """
    return svg(body_figure(name, body, truth or {}))


def body_figure(name: str, body: BodyEstimate, truth: Mapping[str, float]) -> Figure:
    """The same as a figure: a panel of lengths, a panel of carrying angles."""
    panels = []
    if body.names:
        values = 1e3 * np.stack([body.prior, body.prior_sigma, body.posterior, body.sigma])
        true = 1e3 * np.array([truth.get(one, np.nan) for one in body.names])
        panels.append(("Lengths (mm)", body.names, values, true, 0))
    if body.hinges:
        names = tuple(one.joint.replace("_", " ") for one in body.hinges)
        before, found = ([(one.carrying_angle, one.carrying_sigma) for one in those]
                         for those in (body.prior_hinges, body.hinges))  # fmt: skip
        values = np.rad2deg(np.concatenate([np.transpose(before), np.transpose(found)]))
        panels.append(("Carrying angles, outwards (°)", names, values, np.full(len(names), np.nan), 1))
    figure = page(WIDTH, TOP + sum(ROW * len(names) + GAP for _, names, *_ in panels) - GAP + MARGIN)
    write(figure, (MARGIN, 48), f"The body of “{name}”", 22, weight="bold")
    marks = [
        (Patch(color=PRIOR, alpha=0.5), "likely beforehand: mean, one and two standard deviations"),
        (Line2D([], [], color=ERROR, marker="o", linewidth=2), "found, one standard deviation"),
    ]
    marks += (
        [(Line2D([], [], color=INK, marker="|", markersize=14, mew=2.4, linestyle="none"), "truth")] if truth else []
    )
    figure.legend(
        *zip(*marks, strict=True), loc="upper left", ncols=3, frameon=False, fontsize=12, labelcolor=SOFT_INK,
        bbox_to_anchor=((MARGIN - 6) / WIDTH, 1 - 64 / size_of(figure)[1]), borderaxespad=0,
    )  # fmt: skip
    top = TOP
    for title, names, values, true, decimals in panels:
        _panel(figure, top, title, names, values, true, decimals)
        top += ROW * len(names) + GAP
    return figure


def _panel(
    figure: Figure, top: float, title: str, names: tuple[str, ...], values: Array, truth: Array, decimals: int
) -> None:
    """Rows below a title: values ``(4, n)`` are prior, its sigma, found and its sigma (NaN: not known)."""
    prior, prior_sigma, found, sigma = values
    count, y = len(names), np.arange(len(names))
    write(figure, (MARGIN, top - 16), title, 15, weight="bold")
    write(figure, (sum(AXIS) / 2, top - 16), "off what was likely", 11, SOFT_INK, ha="center")
    axes = panel(figure, (AXIS[0], top, AXIS[1], top + ROW * count))
    axes.barh(y, 4 * prior_sigma, 0.58, -2 * prior_sigma, color=PRIOR, alpha=0.18)
    axes.barh(y, 2 * prior_sigma, 0.58, -prior_sigma, color=PRIOR, alpha=0.35)
    axes.axvline(0, color=PRIOR, linewidth=1.6)
    off = np.nan_to_num(sigma)
    axes.hlines(y, found - prior - off, found - prior + off, color=ERROR, linewidth=2)
    axes.plot(found - prior, y, "o", color=ERROR, markersize=8, markeredgecolor="white", label="found")
    axes.plot(truth - prior, y, "|", color=INK, markersize=16, markeredgewidth=2.4)
    reach = np.nanmax([2 * prior_sigma, np.abs(found - prior) + off, np.abs(truth - prior)])
    ticks = MaxNLocator(10, steps=[1, 2, 2.5, 5, 10], symmetric=True).tick_values(-reach, reach)
    axes.set_xlim(ticks[0], ticks[-1])
    axes.set_ylim(count - 0.5, -0.5)
    axes.set_xticks(ticks)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:+g}" if value else "0"))
    axes.tick_params(axis="x", labelsize=11)
    axes.set_yticks(y, names)
    axes.tick_params(axis="y", labelsize=12.5, labelcolor=INK, pad=16)
    axes.grid(axis="x", color=GRID)
    known = np.isfinite(truth)
    columns = (
        [_number(*both, decimals) for both in zip(prior, prior_sigma, strict=True)],
        [_number(*both, decimals) for both in zip(found, sigma, strict=True)],
        [f"{value:z.{decimals}f}" if np.isfinite(value) else "" for value in truth],
    )
    for (x, head), texts, colour in zip(COLUMNS, columns, (SOFT_INK, ERROR, INK), strict=True):
        if head == "truth" and not known.any():
            continue
        write(figure, (x, top - 16), head, 11, SOFT_INK, ha="right")
        for row, text in enumerate(texts):
            write(figure, (x, top + ROW * (row + 0.5) + 4), text, 12, colour, ha="right")


def _number(value: float, sigma: float, decimals: int) -> str:
    known = f" ± {sigma:.{decimals}f}" if np.isfinite(sigma) else ""
    return f"{value:z.{decimals}f}{known}"
