"""How well the estimate fits what was measured, over time; against the truth if it is known."""

import itertools

import numpy as np

from vip_factors.body.mannequin import Side
from vip_factors.describe.estimates import RESIDUALS
from vip_factors.evaluate.evaluation import evaluate, evaluate_scene
from vip_factors.geometry.rotations import Array
from vip_factors.report.charts import SIDE_COLOURS, Chart, time_charts, wearer_mark
from vip_factors.report.report_data import ReportData, ReportWearer
from vip_factors.tables import Quantity, Row, Table
from vip_factors.viz.charts import Curve
from vip_factors.viz.picture import mean_residual

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
            Curve(wearer.name, wearer.estimate.motion.time, mean_residual(wearer.estimate.residuals[kind]),
                  wearer_mark(wearer.index, len(data.wearers)))
            for wearer in data.wearers
            if kind in wearer.estimate.residuals and wearer.estimate.residuals[kind].size
        ]  # fmt: skip
        title, ticks = f"{name}, {unit}: mean over the sensors", "°" if unit == "°" else ""
        charts += time_charts(title, curves, ticks, from_zero=True, decimals=2)
    return [*charts, *_reprojection_charts(data)]


def _reprojection_charts(data: ReportData) -> list[Chart]:
    camera = data.estimate.camera
    if camera is None or camera.residual_px is None:
        return []
    times = (camera.path.time, data.wearers[0].estimate.motion.time)
    time = next((time for time in times if len(time) == len(camera.residual_px)), None)
    if time is None:
        return []
    curves = [
        Curve(wearer.name, time, values, wearer_mark(wearer.index, len(data.wearers)))
        for wearer, values in zip(data.wearers, _joined(camera.residual_px).T, strict=True)
    ]
    return time_charts("Video, px: root mean square over the points", curves, from_zero=True)


def _joined(values: Array) -> Array:
    """``(T, n)`` with short gaps filled in: a camera is slower than the sensors."""
    longest = 6  # frames
    filled = values.copy()
    for column in filled.T:
        good = np.flatnonzero(np.isfinite(column))
        for before, after in itertools.pairwise(good):
            if 1 < after - before <= longest:
                column[before + 1 : after] = np.interp(
                    np.arange(before + 1, after), (before, after), (column[before], column[after])
                )
    return filled


def truth_table(data: ReportData) -> Table:
    """Errors against the truth, in words and by their names; without rows if it is not known."""
    scene, names = data.scene, data.names
    if scene is None or not data.has_truth:
        return Table((), ())
    truth = scene.wearers[0].truth
    if len(names) == 1 and scene.camera is None and truth is not None:
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
        Curve(name, sensor.heading_time, np.rad2deg(sensor.heading_path - sensor.heading_path[0]),
              SIDE_COLOURS[sides.get(name, Side.MIDDLE)])
        for name, sensor in wearer.estimate.calibration.items()
        if len(sensor.heading_path) > 1
    ]  # fmt: skip
    return time_charts("Drift of the headings", curves, "°", wide=True)
