"""Gait as files: tables of strides, figures and curves (CSV), all of it (JSON), and a picture of the curves (PNG).

How healthy adults walk at some speeds: joint angles over the cycle, to lay beneath somebody's own.

``data/reference.csv`` holds them, and says where they are from: ``python -m tests.studies train-gait`` computes it from
the optical part of the Geneva data set (Grouvel et al. 2023, Sci. Data 10: 180; CC BY 4.0), with this package's angles.
"""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from vip_factors.atomic import atomic_open, check_target
from vip_factors.body.joint_angles import ANGLE_DEFINITIONS, is_measured
from vip_factors.body.mannequin import Side
from vip_factors.display import distinct_file_names
from vip_factors.errors import InputError
from vip_factors.gait.results import CYCLE, ROWS, Curve, Gait
from vip_factors.gait.strides import QUANTITIES
from vip_factors.geometry.rotations import Array
from vip_factors.tables import UNKNOWN, Cell, Quantity, Row, Table, count, json_text
from vip_factors.viz.charts import GRID, INK, SOFT_INK, Figure, page, panel, save, write
from vip_factors.viz.colours import SIDE_COLOURS

SOURCE = "Grouvel et al. 2023, doi 10.1038/s41597-023-02077-3, CC BY 4.0"
FILE = "data/reference.csv"
REFERENCE_COLUMNS = ("pace", "speed_m_s", "people", "strides", "angle", "percent", "mean_deg", "sd_deg")
NAMES = ("strides.csv", "figures.csv", "curves.csv", "gait.json", "gait.png")
DRAWN = (
    "hip_flexion",
    "knee_flexion",
    "ankle_dorsiflexion",
    "hip_adduction",
    "hip_internal_rotation",
    "ankle_inversion",
    "pelvis_tilt",
    "pelvis_obliquity",
    "pelvis_rotation",
    "trunk_flexion",
    "trunk_lateral_bending",
    "trunk_axial_rotation",
)
COLUMNS, CELL, MARGIN = 2, (390.0, 280.0), 70.0
BELOW = "#c9ced6"  # what references are drawn in: grey, beneath


def write_gait(gaits: Sequence[Gait], folder: Path, overwrite: bool = False) -> list[Path]:
    """Write all files of some wearers into a folder, which is made if need be; each complete or not at all.

    Those of several wearers begin with their names.

    Raises:
        InputError: if a file is there already and may not be replaced, or two wearers have one name.
    """
    names = [gait.name for gait in gaits]
    if len(gaits) > 1 and len(set(names)) < len(names):
        raise InputError(f"wearers {', '.join(names)}: expected different names, for files of their own")
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file: expected a folder for the tables")
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for gait, file_name in zip(gaits, distinct_file_names(names), strict=True):
        begin = f"{file_name}." if len(gaits) > 1 else ""
        *tables, numbers, picture = paths = [folder / f"{begin}{name}" for name in NAMES]
        for path in paths:
            check_target(path, overwrite)
        for path, rows in zip(tables, ROWS.values(), strict=True):
            with atomic_open(path, "w", overwrite) as file:
                csv.writer(file, lineterminator="\n").writerows(rows(gait))
        with atomic_open(numbers, "w", overwrite) as file:
            file.write(json_text(as_json(gait), decimals=5))
        written += paths[:-1]
        figure = curves_figure(gait)
        if figure is not None:
            save(figure, picture, overwrite)
            written.append(picture)
    return written


def _unit(unit: str) -> str:
    return "°" if unit == "deg" else unit


def figure_table(gait: Gait) -> Table:
    """The figures that most ask for: label, value and remark."""
    remark = f"left out: {gait.left_out}" if gait.left_out else "all of them"
    figures: list[Row] = [("strides", str(len(gait.counted)), remark)]
    for name in ("speed", "cadence", "length", "time"):
        figure = gait.figure(name)
        if figure is not None:
            value = Quantity(figure.mean, figure.sigma, _unit(figure.quantity.unit), 2 * (figure.mean < 10))
            figures.append((figure.quantity.words, value, f"mean of {count(figure.count, 'stride')}"))
    return Table((), figures, words=3)


def side_table(gait: Gait) -> Table:
    """Each quantity left, right, and their difference."""
    numbers = {side: sum(stride.side == side for stride in gait.counted) for side in ("left", "right")}
    quantities: list[Row] = [("strides, n", *map(str, numbers.values()), "", str(len(gait.counted)), "")]
    for quantity in QUANTITIES:
        both_sides = gait.figure(quantity.name)
        if both_sides is None:
            continue
        decimals = min(quantity.decimals, 2) if quantity.unit in ("s", "m", "m/s") else quantity.decimals
        cells: list[Cell] = [f"{quantity.words}, {_unit(quantity.unit)}"]
        for side in ("left", "right", "difference", "both"):
            figure = gait.figure(quantity.name, side)
            cells.append(UNKNOWN if figure is None else Quantity(figure.mean, figure.sigma, decimals=decimals))
        quantities.append((*cells, Quantity(both_sides.variability, decimals=decimals)))
    return Table(("quantity", "left", "right", "left less right", "both", "from stride to stride"), quantities)


def as_json(gait: Gait) -> dict[str, Any]:
    """All of it, by names."""
    return {
        "name": gait.name,
        "verdict": gait.verdict,
        "left_out": gait.left_out,
        "events": {side: vars(events) for side, events in gait.feet.items()},
        "strides": [vars(stride) for stride in gait.strides],
        "units": {quantity.name: quantity.unit for quantity in QUANTITIES},
        "figures": [{**vars(figure), "quantity": figure.quantity.name} for figure in gait.figures],
        "curves": [vars(curve) for curve in gait.curves],
        "curves_with_covariance": gait.with_covariance,
        "findings": [str(finding) for finding in gait.findings],
        "bones_with_sensors": None if gait.bones is None else sorted(gait.bones),
    }


def curves_figure(gait: Gait) -> Figure | None:
    """A picture of joint angles over the cycle, both sides over each other, with references beneath.

    None if there is none that sensors measured.
    """
    drawn = [name for name in DRAWN if is_measured(gait.bones, name) and _curves_of(gait, name)]
    if not drawn:
        return None
    rows = -(-len(drawn) // COLUMNS)
    figure = page(COLUMNS * CELL[0] + MARGIN, rows * CELL[1] + 190)
    speed = gait.figure("speed")
    speed_text = "" if speed is None else f", {speed.mean:.2f} ± {speed.sigma:.2f} m/s"
    write(figure, (30, 40), f"{gait.name}: joint angles over the cycle{speed_text}", 20, weight="bold")
    reference, positive = None, {definition.name: definition.positive for definition in ANGLE_DEFINITIONS}
    for number, name in enumerate(drawn):
        row, column = divmod(number, COLUMNS)
        x, top = MARGIN + column * CELL[0], 70 + row * CELL[1]
        axes = panel(figure, (x, top + 40, x + CELL[0] - 80, top + CELL[1] - 40))
        meaning = positive.get(f"left_{name}", positive.get(name, "")).partition(";")[0]
        axes.set_title(f"{name.replace('_', ' ')} (+ {meaning})", loc="left", size=14, color=INK, x=-0.12)
        axes.set_xlabel("% of the gait cycle", size=12, color=SOFT_INK)
        axes.set_ylabel("degrees", size=12, color=SOFT_INK)
        axes.tick_params(labelsize=13)
        axes.grid(color=GRID)
        axes.set_xlim(0, 100)
        beneath = reference_at(speed.mean, name) if speed is not None else None
        if beneath is not None:
            reference = beneath
            axes.fill_between(
                CYCLE, beneath.mean - beneath.sd, beneath.mean + beneath.sd, color=BELOW, alpha=0.6, linewidth=0
            )
        for curve in _curves_of(gait, name):
            colour = SIDE_COLOURS[Side(curve.side)]
            dashes = "-" if curve.side == Side.LEFT else "--"
            axes.plot(CYCLE, curve.mean, dashes, color=colour, linewidth=2)
            stance = gait.figure("stance_percent", curve.side)
            if stance is not None:
                axes.axvline(stance.mean, color=colour, linestyle=dashes, linewidth=1)
            for spread, alpha in ((curve.variability, 0.15), (curve.sigma, 0.25)):
                band = curve.mean - spread, curve.mean + spread
                axes.fill_between(CYCLE, *band, color=colour, alpha=alpha, linewidth=0)
    words = "mean, its ± (dark) and from stride to stride (pale)"
    words += "\n0 and 100 %: foot strike of the same side; upright lines: its toe-off"
    if reference is not None:
        words += f"\ngrey: {reference.people} healthy adults at {reference.speed:.2f} m/s\n{SOURCE}"
    bottom = rows * CELL[1] + 95
    for number, (side, line) in enumerate(((Side.LEFT, "solid"), (Side.RIGHT, "dashed"))):
        strides = sum(stride.side == side for stride in gait.counted)
        legend = f"{side} ({line}), n = {strides}"
        write(figure, (30 + 190 * number, bottom), legend, 15, SIDE_COLOURS[side], weight="bold")
    write(figure, (30, bottom + 12), words, 13, SOFT_INK, va="top")
    return figure


def _curves_of(gait: Gait, name: str) -> list[Curve]:
    return [curve for curve in gait.curves if curve.angle in (name, f"{curve.side}_{name}")]


@dataclass(frozen=True)
class ReferenceCurve:
    """A joint angle over the cycle, of either side, of some people at one pace.

    Attributes:
        angle: without side, such as ``knee_flexion``.
        speed: their mean, m/s.
        people: how many.
        mean, sd: ``(101,)`` degrees, and standard deviation of all strides.
    """

    angle: str
    speed: float
    people: int
    mean: Array
    sd: Array


@cache
def references() -> tuple[ReferenceCurve, ...]:
    """All curves of the package."""
    text = (files("vip_factors.gait") / FILE).read_text(encoding="utf-8")
    rows: dict[tuple[str, str], list[dict[str, str]]] = {}
    for row in csv.DictReader(line for line in text.splitlines() if not line.startswith("#")):
        rows.setdefault((row["pace"], row["angle"]), []).append(row)
    curves = []
    for (_, angle), points in rows.items():
        mean, sd = (np.array([float(row[name]) for row in points]) for name in ("mean_deg", "sd_deg"))
        curves.append(ReferenceCurve(angle, float(points[0]["speed_m_s"]), int(points[0]["people"]), mean, sd))
    return tuple(curves)


def reference_at(speed: float, angle: str) -> ReferenceCurve | None:
    """The curve of the nearest speed in m/s; None if there is none of such an angle, or none near."""
    curves = (curve for curve in references() if curve.angle == angle)
    nearest = min(curves, key=lambda curve: abs(curve.speed - speed), default=None)
    farthest_m_s = 0.3  # from a reference's speed: curves of another pace are no reference
    return nearest if nearest is not None and abs(nearest.speed - speed) <= farthest_m_s else None
