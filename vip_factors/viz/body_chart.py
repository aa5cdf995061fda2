"""A picture of the body that was found: beside what was likely beforehand, and the truth if that is known (SVG)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from vip_factors.body.hinges import HingeEstimate
from vip_factors.estimate import BodyEstimate
from vip_factors.viz.chart import tick_step
from vip_factors.viz.svg import FAINT, INK, MUTED, RULE, Point, Svg, text_width, tinted

WIDTH, MARGIN, TOP, ROW, GAP = 980.0, 36.0, 138.0, 24.0, 84.0
NAME_X, AXIS = 190.0, (210.0, 690.0)  # end of the names; the axis from left to right
PRIOR_X, FOUND_X, TRUTH_X = 790.0, 880.0, 944.0  # ends of the columns of numbers
PRIOR, FOUND, TRUTH = "#8fa3ba", "#c44854", "#1f2933"


@dataclass(frozen=True)
class _Row:
    """One quantity in the unit of its panel; NaN where something is not known."""

    name: str
    prior: float
    prior_sigma: float
    found: float
    sigma: float
    truth: float = float("nan")

    @property
    def reach(self) -> float:
        """How far off the prior's mean anything is drawn."""
        ends = [2 * self.prior_sigma, abs(self.found - self.prior) + np.nan_to_num(self.sigma)]
        return float(np.nanmax([*ends, abs(self.truth - self.prior)]))


def body_picture(name: str, body: BodyEstimate, truth: Mapping[str, float] | None = None) -> str:
    """The picture.

    Args:
        name: of the wearer.
        body: with lengths, or hinges, or both.
        truth: metres by name of a length, of those of which it is known.
    """
    known, svg = truth or {}, Svg(WIDTH, 0)
    svg.text((MARGIN, 48), f"The body of “{name}”", 22, INK, bold=True)
    _legend(svg, bool(known))
    bottom = TOP
    lengths = zip(body.names, body.prior, body.prior_sigma, body.found, body.sigma, strict=True)
    rows = [
        _Row(one, *(1e3 * value for value in (prior, prior_sigma, found, sigma, known.get(one, np.nan))))
        for one, prior, prior_sigma, found, sigma in lengths
    ]
    if rows:
        bottom = _panel(svg, bottom, "Lengths", "mm", rows, 0) + GAP
    angles = [_carrying_angles(*both) for both in zip(body.prior_hinges, body.hinges, strict=True)]
    if angles:
        bottom = _panel(svg, bottom, "Carrying angles, outwards", "°", angles, 1) + GAP
    svg.height = bottom - GAP + MARGIN
    return str(svg)


def _carrying_angles(before: HingeEstimate, found: HingeEstimate) -> _Row:
    angles = before.carrying_angle, before.carrying_sigma, found.carrying_angle, found.carrying_sigma
    return _Row(found.joint.replace("_", " "), *(float(np.rad2deg(one)) for one in angles))


def _legend(svg: Svg, with_truth: bool) -> None:
    y = 80.0
    _prior_bar(svg, (MARGIN + 20, y - 4.5), 10, 20)
    x = _label(svg, (MARGIN + 50, y), "likely beforehand: mean, one and two standard deviations")
    _found_mark(svg, (x + 12, y - 4.5), 12)
    x = _label(svg, (x + 34, y), "found, one standard deviation")
    if with_truth:
        _truth_mark(svg, (x, y - 4.5))
        _label(svg, (x + 10, y), "truth")


def _label(svg: Svg, at: Point, text: str) -> float:
    """Write a text; returns the x where the next one may begin."""
    svg.text(at, text, 12, MUTED)
    return at[0] + text_width(text, 12) + 16


def _panel(svg: Svg, top: float, title: str, unit: str, rows: Sequence[_Row], decimals: int) -> float:
    """Draw rows below a title; returns the y where they end."""
    left, right = AXIS
    middle, bottom = (left + right) / 2, top + ROW * len(rows)
    step = tick_step(2 * max(row.reach for row in rows), 10)
    half = step * np.ceil(max(row.reach for row in rows) / step - 1e-9)
    scale = (right - middle) / half
    svg.text((MARGIN, top - 16), f"{title} ({unit})", 15, INK, bold=True)
    svg.text((middle, top - 16), "off what was likely", 11, MUTED, "middle")
    heads = [(PRIOR_X, "likely"), (FOUND_X, "found")]
    heads += [(TRUTH_X, "truth")] if np.any(np.isfinite([row.truth for row in rows])) else []
    for x, head in heads:
        svg.text((x, top - 16), head, 11, MUTED, "end")
    for tick in np.arange(-half, half + step / 2, step):
        x = middle + scale * tick
        svg.line((x, top - 4), (x, bottom), FAINT if abs(tick) < step / 2 else RULE, 1.0)
        svg.text((x, bottom + 17), f"{tick:+g}" if abs(tick) > step / 2 else "0", 11, MUTED, "middle")
    for number, row in enumerate(rows):
        y = top + ROW * (number + 0.5)
        svg.text((NAME_X, y + 4), row.name, 12.5, INK, "end")
        _prior_bar(svg, (middle, y), *(scale * row.prior_sigma * np.array([1, 2])))
        _found_mark(svg, (middle + scale * (row.found - row.prior), y), scale * np.nan_to_num(row.sigma))
        if np.isfinite(row.truth):
            _truth_mark(svg, (middle + scale * (row.truth - row.prior), y))
            svg.text((TRUTH_X, y + 4), f"{row.truth:z.{decimals}f}", 12, TRUTH, "end")
        svg.text((PRIOR_X, y + 4), _number(row.prior, row.prior_sigma, decimals), 12, MUTED, "end")
        svg.text((FOUND_X, y + 4), _number(row.found, row.sigma, decimals), 12, FOUND, "end")
    return bottom


def _prior_bar(svg: Svg, centre: Point, one: float, two: float) -> None:
    x, y = centre
    svg.box((x - two, y - 7), (2 * two, 14), tinted(PRIOR, 0.82), radius=3)
    svg.box((x - one, y - 7), (2 * one, 14), tinted(PRIOR, 0.55), radius=3)
    svg.line((x, y - 7), (x, y + 7), PRIOR, 1.6)


def _found_mark(svg: Svg, at: Point, sigma: float) -> None:
    x, y = at
    svg.line((x - sigma, y), (x + sigma, y), FOUND, 2.0)
    svg.circle(at, 3.6, FOUND, "#ffffff", 1.0)


def _truth_mark(svg: Svg, at: Point) -> None:
    x, y = at
    svg.line((x, y - 8), (x, y + 8), TRUTH, 2.4)


def _number(value: float, sigma: float, decimals: int) -> str:
    known = f" ± {sigma:.{decimals}f}" if np.isfinite(sigma) else ""
    return f"{value:z.{decimals}f}{known}"
