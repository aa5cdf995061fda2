"""Charts and tables of the report: joint angles, repetitions, fit to what was measured, errors against the truth."""

import itertools
import json
import re
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from vip_factors.body.joint_angles import JointAngles, is_measured, joint_angle_sigmas, joint_angles
from vip_factors.body.mannequin import Side
from vip_factors.body.model_errors import shape_factor
from vip_factors.body.skeleton import LIMBS, worn_limbs
from vip_factors.describe.estimates import RESIDUALS, finite_quantile
from vip_factors.evaluate.evaluation import evaluate, evaluate_scene
from vip_factors.gait.analysis import bones_with_sensors, gait_of
from vip_factors.gait.results import Gait
from vip_factors.geometry.rotations import Array
from vip_factors.report.report_data import ReportData, ReportWearer
from vip_factors.tables import UNKNOWN, Quantity, Row, Table, joint_words
from vip_factors.viz.charts import Curve, known_curves, page, panel, plot_curves, svg, thinned
from vip_factors.viz.colours import SIDE_COLOURS, wearer_mark
from vip_factors.viz.picture import mean_residual

WIDTH, HEIGHT = 540.0, 190.0
LEFT, RIGHT, TOP, BOTTOM = 44.0, 14.0, 10.0, 24.0  # margins


@dataclass(frozen=True)
class Chart:
    """Drawing of curves over time, with what the page's script needs to read it.

    Attributes:
        title: above it.
        svg: made by Matplotlib, which escapes the texts in it.
        legend: names and colours of the curves.
        numbers: the curves and the box they are drawn in, as JSON.
    """

    title: str
    svg: Markup
    legend: tuple[tuple[str, str], ...]
    numbers: str


def time_charts(
    title: str, curves: Sequence[Curve], unit: str = "", from_zero: bool = False, decimals: int = 1, wide: bool = False
) -> list[Chart]:
    """A chart of some curves on one scale; none if there is no finite value.

    Args:
        title: above the chart.
        curves: at least one.
        unit: of the values, written after them.
        from_zero: whether the scale begins at zero.
        decimals: of values read off.
        wide: whether it is as wide as the page.
    """
    if not (curves := known_curves(curves)):
        return []
    width = 2 * WIDTH + 20 if wide else WIDTH
    figure, box = page(width, HEIGHT), (LEFT, TOP, width - RIGHT, HEIGHT - BOTTOM)
    axes = panel(figure, box)
    plot_curves(axes, curves, unit=unit, from_zero=from_zero, usual=0.998, seconds=8, width=1.5)
    axes.tick_params(labelsize=10, pad=4)
    readings = []
    for curve in curves:
        time, values = thinned(curve.time, curve.values)
        read = [None if not np.isfinite(value) else round(float(value), decimals) for value in values]
        readings.append({"name": curve.name, "time": np.round(time, 3).tolist(), "values": read})
    numbers = {"box": box, "span": axes.get_xlim(), "unit": unit, "decimals": decimals, "curves": readings}
    legend = tuple((curve.name, curve.colour) for curve in curves)
    # To stand among others in a page: without header and ids of groups, to a tenth of a pixel.
    drawing = svg(figure)
    drawing = re.sub(r'<g id="[^"]*"', "<g", drawing[drawing.index("<svg") :])
    drawing = re.sub(r"(\d\.\d)\d{2,}", r"\1", drawing)
    return [Chart(title, Markup(drawing), legend, json.dumps(numbers, separators=(",", ":")))]


PAIRED = (
    "hip_flexion",
    "knee_flexion",
    "ankle_dorsiflexion",
    "hip_adduction",
    "hip_internal_rotation",
    "shoulder_flexion",
    "shoulder_adduction",
    "elbow_flexion",
)
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


def angle_section(wearer: ReportWearer, is_filmed: bool) -> AngleSection:
    """Charts and ranges of a wearer's joint angles; without a camera, none of a limb that wears nothing."""
    angles, covariance = joint_angles(wearer.estimate.motion), wearer.estimate.covariance
    sigmas: dict[str, Array] = {}
    if covariance is not None:
        columns = joint_angle_sigmas(wearer.estimate.motion, covariance.joints).T
        sigmas = dict(zip(angles.names, columns, strict=True))
    bones = bones_with_sensors(wearer.estimate, wearer.recording)
    names = {name: is_measured(bones, name) for name in (*PAIRED, *TRUNK) if is_filmed or _is_worn(bones, name)}
    charts: dict[bool, list[Chart]] = {True: [], False: []}
    for name, has_sensors in names.items():
        charts[has_sensors] += _chart(angles, sigmas, name)
    ranges = _range_table(angles, sigmas, [name for name, has_sensors in names.items() if has_sensors])
    return AngleSection(charts[True], charts[False], ranges, bones is not None)


def _is_worn(bones: Container[str] | None, angle: str) -> bool:
    """Whether the limb of an angle wears a sensor, or it is not known which do."""
    joint = angle.partition("_")[0]
    limb = next((limb for limb in LIMBS.values() if joint in limb), ())
    return bones is None or not limb or limb in worn_limbs(bones)


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
        (left_cell, left_range), (right_cell, right_range) = (_range_cells(angles.of(side)) for side in sides)
        shapes = [shape_factor(joints[side]) * finite_quantile(sigmas[side], 0.5) for side in sides if sigmas]
        sigma = float(np.linalg.norm(shapes)) if shapes else np.nan
        difference = Quantity(left_range.value - right_range.value, unit="°")
        uncertainty = f"± {Quantity(sigma, unit='°')}" if np.isfinite(sigma) else UNKNOWN
        rows.append((joint_words(name), left_cell, left_range, right_cell, right_range, difference, uncertainty))
    head = ("angle", "left: from … to", "range", "right: from … to", "range", "left less right", "uncertain by")
    return Table(head, rows)


def _range_cells(values: Array) -> tuple[str, Quantity]:
    """Ends and width of a range that does not hang on single frames."""
    low, high = (float(value) for value in np.nanquantile(values, (0.01, 0.99)))
    return f"{Quantity(low, unit='°')} … {Quantity(high, unit='°')}", Quantity(high - low, unit="°")


def gait_section(wearer: ReportWearer, with_camera: bool, verdict: str) -> Gait | None:
    """Gait of a wearer; None of somebody who hardly walks."""
    fewest = 4  # strides
    gait = gait_of(wearer.estimate, wearer.recording, wearer.name, with_camera, verdict=verdict)
    return gait if len(gait.counted) >= fewest else None


METRICS = {
    "mpjpe": "Joint positions, each frame aligned",
    "mpjae": "Orientations of the segments",
    "mpjae_local": "Joint rotations",
    "knee_flexion_rmse": "Knee flexion",
    "scene_position_error": "Joint positions in the room",
    "yaw_aligned_position_error": "Joint positions, the whole turned and shifted once",
    "root_translation_error": "Path of the pelvis",
    "root_translation_error_percent": "Path of the pelvis, of its length",
    "length_error": "Lengths of the body",
    "heading_error": "Headings of the sensors",
    "mounting_error": "Mountings of the sensors",
    "camera_translation": "Place of the camera",
    "camera_rotation": "Orientation of the camera",
    "focal_length_error": "Focal length of the camera",
    "time_offset_error": "Clock of the video",
    "association_precision": "Detections given to the right person",
    "association_recall": "Detections of wearers that were used",
    "nees_joints": "Honesty of the ± of joint rotations: 1 is right, above 1 too sure",
}


def fit_charts(data: ReportData) -> list[Chart]:
    """Differences from the sensors and from the video over time, a curve for each wearer."""
    charts = []
    for kind, (name, unit) in RESIDUALS.items():
        curves = [
            Curve(
                wearer.name,
                wearer.estimate.motion.time,
                mean_residual(wearer.estimate.residuals[kind]),
                wearer_mark(wearer.index, len(data.wearers)),
            )
            for wearer in data.wearers
            if kind in wearer.estimate.residuals and wearer.estimate.residuals[kind].size
        ]
        title, ticks = f"{name}, {unit}: mean over the sensors", "°" if unit == "°" else ""
        charts += time_charts(title, curves, ticks, from_zero=True, decimals=2)
    return [*charts, *_reprojection_charts(data)]


def _reprojection_charts(data: ReportData) -> list[Chart]:
    charts = list[Chart]()
    for camera in data.estimate.cameras:
        times = (camera.path.time, data.wearers[0].estimate.motion.time)
        residuals = camera.residual_px
        time = None if residuals is None else next((time for time in times if len(time) == len(residuals)), None)
        if residuals is None or time is None:
            continue
        curves = [
            Curve(wearer.name, time, values, wearer_mark(wearer.index, len(data.wearers)))
            for wearer, values in zip(data.wearers, _joined(residuals).T, strict=True)
        ]
        name = f", {camera.name}" if len(data.estimate.cameras) > 1 else ""
        charts += time_charts(f"Video{name}, px: root mean square over the points", curves, from_zero=True)
    return charts


def _joined(values: Array) -> Array:
    """``(T, n)`` with short gaps filled in: a camera is slower than the sensors."""
    longest = 6  # frames
    filled = values.copy()
    for column in filled.T:
        good = np.flatnonzero(np.isfinite(column))
        for start, end in itertools.pairwise(good):
            if 1 < end - start <= longest:
                column[start:end] = np.interp(np.arange(start, end), (start, end), column[[start, end]])
    return filled


def truth_table(data: ReportData) -> Table:
    """Errors against the truth, in words and by their names; without rows if it is not known."""
    scene, names = data.scene, data.names
    if scene is None or not data.has_truth:
        return Table((), ())
    truth = scene.wearers[0].truth
    if len(names) == 1 and not scene.cameras and truth is not None:
        columns = {names[0]: evaluate(data.estimate.wearers[0], truth).metrics}
    else:
        evaluation = evaluate_scene(data.estimate, scene)
        columns = {name: wearer.metrics for name, wearer in evaluation.wearers.items()}
        if len(columns) > 1:
            columns = {"all": evaluation.metrics, **columns}
        else:  # the scene's metrics and the wearer's fit into one column
            columns = {name: {**evaluation.metrics, **metrics} for name, metrics in columns.items()}
    rows: list[Row] = []
    for name, words in METRICS.items():
        values = [metrics.get(name) for metrics in columns.values()]
        unit = next((metric.unit for metric in values if metric is not None), None)
        if unit is not None:
            cells = ("" if metric is None else Quantity(metric.value, decimals=2) for metric in values)
            rows.append((f"{words} ({name})", unit, *cells))
    return Table(("against the truth", "unit", *columns), rows)


def truth_charts(data: ReportData) -> list[Chart]:
    """Error of the joints against the truth over time, a curve for each wearer."""
    curves = [
        Curve(wearer.name, wearer.motion.time, wearer.error_mm, wearer_mark(wearer.index, len(data.wearers)))
        for wearer in data.drawn.wearers
        if wearer.error_mm is not None and wearer.motion is not None
    ]
    title = "Error of the joints against the truth, mm (each frame aligned)"
    return time_charts(title, curves, from_zero=True, wide=True)


def drift_charts(wearer: ReportWearer) -> list[Chart]:
    """Drift of the headings that are estimated over time, coloured by side where the sensors' sites are known."""
    sites = () if wearer.recording is None else wearer.recording.placement.sites
    sides = {site.sensor: Side(side) for site in sites if (side := site.bone.partition("_")[0]) in ("left", "right")}
    curves = [
        Curve(
            name,
            sensor.heading_time,
            np.rad2deg(sensor.heading_path - sensor.heading_path[0]),
            SIDE_COLOURS[sides.get(name, Side.MIDDLE)],
        )
        for name, sensor in wearer.estimate.calibration.items()
        if len(sensor.heading_path) > 1
    ]
    return time_charts("Drift of the headings", curves, "°", wide=True)
