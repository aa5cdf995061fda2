"""How somebody walked, and the squats, lunges, jumps and curls of somebody who exercises."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vip_factors.body.joint_angles import JointAngles, is_measured, joint_angle_sigmas, joint_angles
from vip_factors.body.mannequin import Side
from vip_factors.body.model_errors import shape_factor
from vip_factors.findings import Finding
from vip_factors.gait.analysis import Gait, bones_with_sensors, gait_of
from vip_factors.gait.files import curves_figure
from vip_factors.gait.strides import QUANTITIES
from vip_factors.geometry.rotations import Array
from vip_factors.repetitions import files
from vip_factors.repetitions.repetitions import repetitions_of
from vip_factors.report.charts import SIDE_COLOURS, Chart, time_charts
from vip_factors.report.report_data import ReportWearer
from vip_factors.tables import UNKNOWN, Cell, Quantity, Row, Table, count, joint_words
from vip_factors.viz.charts import Curve, png

PAIRED = (
    "hip_flexion", "knee_flexion", "ankle_dorsiflexion", "hip_adduction", "hip_internal_rotation", "shoulder_flexion",
    "shoulder_adduction", "elbow_flexion",
)  # fmt: skip
TRUNK = ("trunk_flexion", "trunk_lateral_bending", "trunk_axial_rotation", "pelvis_tilt")
SIDES = (Side.LEFT, Side.RIGHT)


@dataclass(frozen=True)
class AngleSection:
    """Joint angles of a wearer.

    Attributes:
        measured: charts of joints with sensors on both of their segments.
        guessed: charts of the others.
        ranges: of motion of those that are measured.
        knows_sensors: whether the segments that wore sensors are known; otherwise all count as measured.
    """

    measured: list[Chart]
    guessed: list[Chart]
    ranges: Table
    knows_sensors: bool


def angle_section(wearer: ReportWearer) -> AngleSection:
    """Charts and ranges of a wearer's joint angles."""
    angles, covariance = joint_angles(wearer.estimate.motion), wearer.estimate.covariance
    sigmas: dict[str, Array] = {}
    if covariance is not None:
        columns = joint_angle_sigmas(wearer.estimate.motion, covariance.joints).T
        sigmas = dict(zip(angles.names, columns, strict=True))
    bones = bones_with_sensors(wearer.estimate, wearer.recording)
    names = {name: is_measured(bones, name) for name in (*PAIRED, *TRUNK)}
    charts = {name: _chart(angles, sigmas, name) for name in names}
    measured, guessed = (
        [chart for name, is_told in names.items() if is_told == wanted for chart in charts[name]]
        for wanted in (True, False)
    )
    ranges = _range_table(angles, sigmas, [name for name, is_told in names.items() if is_told])
    return AngleSection(measured, guessed, ranges, bones is not None)


def _chart(angles: JointAngles, sigmas: Mapping[str, Array], name: str) -> list[Chart]:
    """One chart of an angle, both sides in it."""
    columns = {joint_words(name): (name, Side.MIDDLE)}
    if name in PAIRED:
        columns = {str(side): (f"{side}_{name}", side) for side in SIDES}
    curves = []
    for words, (column, side) in columns.items():
        values = angles.of(column).copy()
        half_circle = 180.0  # an angle goes on at the other end of its circle: a gap instead of a stroke across
        values[np.flatnonzero(np.abs(np.diff(values)) > half_circle)] = np.nan
        curves.append(Curve(words, angles.time, values, SIDE_COLOURS[side], sigmas.get(column)))
    positive = {definition.name: definition.positive for definition in angles.definitions}
    return time_charts(f"{joint_words(name)} (+ {positive[next(iter(columns.values()))[0]]})", curves, "°")


def _range_table(angles: JointAngles, sigmas: Mapping[str, Array], names: Sequence[str]) -> Table:
    """Range of motion of each angle, and the difference between the sides."""
    joints = {definition.name: definition.joint for definition in angles.definitions}
    rows: list[Row] = []
    for name in names:
        if name in TRUNK:
            rows.append((joint_words(name), *_range_cells(angles.of(name)), "", "", "", ""))
            continue
        sides = [f"{side}_{name}" for side in SIDES]
        (left, left_range), (right, right_range) = (_range_cells(angles.of(side)) for side in sides)
        shapes = [shape_factor(joints[side]) * _median(sigmas[side]) for side in sides if sigmas]
        sigma = float(np.linalg.norm(shapes)) if shapes else np.nan
        difference = Quantity(left_range.value - right_range.value, unit="°")
        known = f"± {Quantity(sigma, unit='°')}" if np.isfinite(sigma) else UNKNOWN
        rows.append((joint_words(name), left, left_range, right, right_range, difference, known))
    head = ("angle", "left: from … to", "range", "right: from … to", "range", "left less right", "uncertain by")
    return Table(head, rows)


def _median(values: Array) -> float:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else np.nan


def _range_cells(values: Array) -> tuple[str, Quantity]:
    """Ends and width of a range that does not hang on single frames."""
    low, high = (float(value) for value in np.nanquantile(values, (0.01, 0.99)))
    return f"{Quantity(low, unit='°')} … {Quantity(high, unit='°')}", Quantity(high - low, unit="°")


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
    exercises = repetitions_of(wearer.estimate)
    return replace(files.repetition_table(exercises), title=exercises.counts)
