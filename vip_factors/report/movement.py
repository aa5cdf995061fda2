"""How somebody walked, and the squats, lunges, jumps and curls of somebody who exercises."""

from dataclasses import dataclass, replace

from vip_factors.describe.table import UNKNOWN, Cell, Quantity, Row, Table, count
from vip_factors.findings import Finding
from vip_factors.gait.analysis import Gait, gait_of
from vip_factors.gait.files import curves_figure
from vip_factors.gait.strides import QUANTITIES
from vip_factors.repetitions import files
from vip_factors.repetitions.repetitions import repetitions_of
from vip_factors.repetitions.settings import RepetitionSettings
from vip_factors.report.report_data import ReportWearer
from vip_factors.viz.charts import png


@dataclass(frozen=True)
class GaitSection:
    """Gait of a wearer.

    Attributes:
        figures: label, value and remark of the figures that most ask for.
        sides: each quantity left, right, and their difference.
        curves: PNG of joint angles over the cycle; None if no sensor measured one.
        findings: what is left out, as nothing measured it.
        source: what told strikes and toe-offs.
    """

    figures: Table
    sides: Table
    curves: bytes | None
    findings: tuple[Finding, ...]
    source: str


def gait_section(wearer: ReportWearer, with_camera: bool) -> GaitSection | None:
    """Gait of a wearer; None of somebody who hardly walks."""
    fewest = 4  # strides
    gait = gait_of(wearer.estimate, wearer.recording, wearer.name, with_camera)
    if len(gait.counted) < fewest:
        return None
    figure = curves_figure(gait)
    words = {True: "the feet's own sensors", False: "the motion of the legs"}
    source = " and ".join(dict.fromkeys(words[events.by_sensor] for events in gait.feet.values()))
    curves = None if figure is None else png(figure)
    return GaitSection(_figure_table(gait), _side_table(gait), curves, gait.findings, source)


def _unit(unit: str) -> str:
    return "°" if unit == "deg" else unit


def _figure_table(gait: Gait) -> Table:
    others = len(gait.strides) - len(gait.counted)
    remark = f"{others} more are turns, pauses or no steps" if others else "all of them"
    figures: list[Row] = [("strides", str(len(gait.counted)), remark)]
    for name in ("speed", "cadence", "length", "time"):
        figure = gait.figure(name)
        if figure is not None:
            value = Quantity(figure.mean, figure.sigma, _unit(figure.quantity.unit), 2 * (figure.mean < 10))
            figures.append((figure.quantity.words, value, f"mean of {count(figure.count, 'stride')}"))
    return Table((), figures, words=3)


def _side_table(gait: Gait) -> Table:
    quantities: list[Row] = []
    for quantity in QUANTITIES:
        both = gait.figure(quantity.name)
        if both is None:
            continue
        decimals = min(quantity.decimals, 2) if quantity.unit in ("s", "m", "m/s") else quantity.decimals
        cells: list[Cell] = [f"{quantity.words}, {_unit(quantity.unit)}"]
        for side in ("left", "right", "difference", "both"):
            figure = gait.figure(quantity.name, side)
            cells.append(UNKNOWN if figure is None else Quantity(figure.mean, figure.sigma, decimals=decimals))
        quantities.append((*cells, Quantity(both.variability, decimals=decimals)))
    return Table(("quantity", "left", "right", "left less right", "both", "from stride to stride"), quantities)


def repetition_table(wearer: ReportWearer) -> Table:
    """A row of each repetition."""
    exercises = repetitions_of(wearer.estimate, RepetitionSettings())
    return replace(files.repetition_table(exercises), title=exercises.counts)
