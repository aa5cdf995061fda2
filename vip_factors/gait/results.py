"""Gait of a wearer: strides, means, joint angles over the cycle, and their tables of numbers."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from vip_factors.body.joint_angles import is_measured
from vip_factors.display import Summarised
from vip_factors.errors import InputError, nearest
from vip_factors.estimate import dataframe
from vip_factors.findings import Finding
from vip_factors.gait.events import FootEvents
from vip_factors.gait.strides import QUANTITIES, Quantity, Stride
from vip_factors.geometry.rotations import Array

if TYPE_CHECKING:
    import pandas

CYCLE = np.arange(101.0)  # per cent


@dataclass(frozen=True)
class Figure:
    """A number of all strides that count.

    Attributes:
        quantity: what it is of.
        side: ``left``, ``right``, ``both``, or ``difference``: left less right.
        count: of strides.
        mean: of them.
        variability: standard deviation from stride to stride; NaN of a difference, and of one stride.
        sigma: standard deviation of the mean: of the strides, and of what all of them share; NaN of one stride.
    """

    quantity: Quantity
    side: str
    count: int
    mean: float
    variability: float
    sigma: float


@dataclass(frozen=True)
class Curve:
    """A joint angle over the cycle, from strike to strike of one side.

    Attributes:
        angle: name of the joint angle, such as ``left_knee_flexion``.
        side: whose cycle it is.
        count: of strides.
        mean, variability: ``(101,)`` degrees, and their standard deviation from stride to stride.
        sigma: ``(101,)`` of the mean: of the strides, and of the estimate's own covariance where it has one.
    """

    angle: str
    side: str
    count: int
    mean: Array
    variability: Array
    sigma: Array


@dataclass(frozen=True, repr=False)
class Gait(Summarised):
    """Gait of one wearer.

    Attributes:
        name: whose gait.
        feet: events by side.
        strides: all, in the order of time; those with a reason in ``left_out`` are in no mean.
        figures: of each quantity: left, right, both, difference.
        curves: of joint angles that something measured, each over the cycle of its own side; of the trunk over both.
        with_covariance: whether the bands of the curves hold what the estimate itself is unsure of.
        bones: that sensors sat on; None if nobody knows.
        findings: what is left out, as nothing measured it.
        verdict: of the estimate; empty if not known.
    """

    name: str
    feet: dict[str, FootEvents]
    strides: tuple[Stride, ...]
    figures: tuple[Figure, ...]
    curves: tuple[Curve, ...]
    with_covariance: bool
    bones: frozenset[str] | None = None
    findings: tuple[Finding, ...] = ()
    verdict: str = ""

    def summary(self) -> list[str]:
        """Summarise the strides, the source of their events, findings and main parameters."""
        stride_count = f"{len(self.strides)} strides, {len(self.counted)} of them in the means; events by {self.source}"
        lines = [f"{self.name or 'wearer'}: {stride_count}"]
        lines += [f"verdict of the estimate: {self.verdict}"] if self.verdict else []
        lines += [f"left out: {self.left_out}"] if self.left_out else []
        lines += [f"{finding.severity}: {finding}" for finding in self.findings]
        for figure in filter(None, map(self.figure, ("speed", "cadence", "time", "length"))):
            mean, sigma = (f"{value:.{figure.quantity.decimals}f}" for value in (figure.mean, figure.sigma))
            lines.append(f"{figure.quantity.words}: {mean} ± {sigma} {figure.quantity.unit}, n {figure.count}")
        return lines

    @property
    def source(self) -> str:
        """Source of strikes and toe-offs."""
        words = {True: "foot sensors", False: "the motion of the legs"}
        return " and ".join(dict.fromkeys(words[events.by_sensor] for events in self.feet.values()))

    @property
    def counted(self) -> tuple[Stride, ...]:
        """Strides that count in the means."""
        return tuple(stride for stride in self.strides if not stride.left_out)

    @property
    def left_out(self) -> str:
        """Numbers of excluded strides by reason, such as ``2 turn, 1 stop``."""
        reasons = Counter(stride.left_out for stride in self.strides if stride.left_out)
        return ", ".join(f"{number} {reason}" for reason, number in reasons.most_common())

    def figure(self, quantity: str, side: str = "both") -> Figure | None:
        """One of the figures; None if no stride has it."""
        return next(
            (figure for figure in self.figures if (figure.quantity.name, figure.side) == (quantity, side)), None
        )

    def to_dataframe(self, table: Literal["strides", "figures", "curves"] = "strides") -> "pandas.DataFrame":
        """A pandas table, as the CSV file of that name; an :class:`InputError` without pandas or for another table."""
        if table not in ROWS:
            raise InputError(f"gait has no table '{table}'{nearest(table, ROWS)}")
        return dataframe(ROWS[table](self))


def stride_rows(gait: Gait) -> Iterator[list[object]]:
    """Every stride, and why it is in no mean."""
    names = (f"{quantity.name}_{quantity.unit}" for quantity in QUANTITIES)
    columns = [name.replace("/", "_per_").replace("%", "").rstrip("_") for name in names]
    yield ["side", "strike_s", "toe_off_s", "next_strike_s", *columns, "turn_deg", "counted", "left_out", "length_by"]
    for stride in gait.strides:
        values = [_number(stride.values[quantity.name], quantity.decimals + 1) for quantity in QUANTITIES]
        times = [f"{time:.4f}" for time in (stride.start, stride.off, stride.end)]
        by = "foot sensor" if stride.by_sensor else "motion"
        yield [stride.side, *times, *values, f"{stride.turn_deg:.1f}", int(not stride.left_out), stride.left_out, by]


def figure_rows(gait: Gait) -> Iterator[list[object]]:
    """Every figure: its mean, the mean's standard deviation, and that from stride to stride."""
    yield ["quantity", "unit", "side", "strides", "mean", "sigma", "variability", "verdict"]
    for figure in gait.figures:
        numbers = (figure.mean, figure.sigma, figure.variability)
        values = [_number(number, figure.quantity.decimals + 1) for number in numbers]
        yield [figure.quantity.name, figure.quantity.unit, figure.side, figure.count, *values, gait.verdict]


def curve_rows(gait: Gait) -> Iterator[list[object]]:
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
