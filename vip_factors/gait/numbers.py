"""Gait as tables of numbers, a row each under a row of names: strides, figures, curves."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from vip_factors.body.joint_angles import is_measured
from vip_factors.gait.strides import QUANTITIES

if TYPE_CHECKING:
    from vip_factors.gait.analysis import Gait


def stride_rows(gait: "Gait") -> Iterator[list[object]]:
    """Every stride, and why it is in no mean."""
    names = (f"{quantity.name}_{quantity.unit}" for quantity in QUANTITIES)
    columns = [name.replace("/", "_per_").replace("%", "").rstrip("_") for name in names]
    yield ["side", "strike_s", "toe_off_s", "next_strike_s", *columns, "turn_deg", "counted", "left_out", "length_by"]
    for stride in gait.strides:
        values = [_number(stride.values[quantity.name], quantity.decimals + 1) for quantity in QUANTITIES]
        times = [f"{time:.4f}" for time in (stride.start, stride.off, stride.end)]
        by = "foot sensor" if stride.by_sensor else "motion"
        yield [stride.side, *times, *values, f"{stride.turn_deg:.1f}", int(not stride.left_out), stride.left_out, by]


def figure_rows(gait: "Gait") -> Iterator[list[object]]:
    """Every figure: its mean, the mean's standard deviation, and that from stride to stride."""
    yield ["quantity", "unit", "side", "strides", "mean", "sigma", "variability", "verdict"]
    for figure in gait.figures:
        numbers = (figure.mean, figure.sigma, figure.variability)
        values = [_number(number, figure.quantity.decimals + 1) for number in numbers]
        yield [figure.quantity.name, figure.quantity.unit, figure.side, figure.count, *values, gait.verdict]


def curve_rows(gait: "Gait") -> Iterator[list[object]]:
    """Every joint angle at every per cent of the cycle."""
    yield ["angle", "measured", "cycle_of", "strides", "percent", "mean_deg", "sigma_deg", "variability_deg"]
    for curve in gait.curves:
        measured = "" if gait.bones is None else int(is_measured(gait.bones, curve.angle))
        for percent, values in enumerate(zip(curve.mean, curve.sigma, curve.variability, strict=True)):
            yield [curve.angle, measured, curve.side, curve.count, percent, *(f"{value:.3f}" for value in values)]


def _number(value: float, decimals: int) -> str:
    """Nothing for what is not known."""
    return f"{value:.{decimals}f}" if np.isfinite(value) else ""


ROWS = {"strides": stride_rows, "figures": figure_rows, "curves": curve_rows}
