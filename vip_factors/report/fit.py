"""How well the estimate fits what was measured, sensor by sensor and over time; against the truth if it is known."""

import itertools
from collections.abc import Mapping

import numpy as np

from vip_factors.evaluate.evaluation import evaluate, evaluate_scene
from vip_factors.evaluate.table import Metric
from vip_factors.geometry.rotations import Array
from vip_factors.report.blocks import (
    UNKNOWN,
    Block,
    Chart,
    Charts,
    Line,
    Paragraph,
    Section,
    Table,
    number,
    time_chart,
    wearer_mark,
)
from vip_factors.report.material import Material, Wearer

KINDS = {"orientation_deg": ("Orientation, °", "°"), "acceleration_m_s2": ("Acceleration, m/s²", "")}


def fit_section(material: Material) -> Section:
    """Residuals, reprojection, and errors."""
    blocks: list[Block] = [
        Paragraph(
            "How far the reconstructed motion is from what the sensors and the camera measured. Small differences "
            "alone do not prove the motion right, but large ones prove it wrong there."
        )
    ]
    charts = [_residual_chart(material, kind) for kind in KINDS] + [_reprojection_chart(material)]
    shown = tuple(one for one in charts if one is not None)
    blocks += [Charts(shown)] if shown else [Paragraph("The file does not hold what was left unexplained.")]
    for wearer in material.wearers:
        blocks += _sensor_table(wearer, len(material.wearers))
    blocks += _reprojection_table(material)
    blocks += _truth(material)
    return Section("fit", "How well it fits", tuple(blocks))


def mean_residual(values: Array) -> Array:
    """Mean over the sensors ``(T,)``; NaN where none gave anything."""
    some = np.isfinite(values).any(axis=1)
    mean = np.full(len(values), np.nan)
    mean[some] = np.nanmean(values[some], axis=1)
    return mean


def _residual_chart(material: Material, kind: str) -> Chart | None:
    title, unit = KINDS[kind]
    lines = [
        Line(one.name, one.estimate.motion.time, mean_residual(one.estimate.residuals[kind]),
             wearer_mark(one.index, len(material.wearers)))
        for one in material.wearers
        if kind in one.estimate.residuals and one.estimate.residuals[kind].size
    ]  # fmt: skip
    return time_chart(f"{title}: mean over the sensors", lines, unit, from_zero=True, decimals=2)


def _sensor_table(wearer: Wearer, of: int) -> list[Block]:
    residuals = {kind: values for kind, values in wearer.estimate.residuals.items() if values.size}
    if not residuals:
        return []
    rows = []
    for column, sensor in enumerate(wearer.estimate.sensors):
        cells = [sensor]
        for kind in KINDS:
            values = residuals[kind][:, column] if kind in residuals else np.zeros(0)
            values = values[np.isfinite(values)]
            cells += (
                [f"{np.median(values):.2f}", f"{np.quantile(values, 0.95):.2f}", f"{values.max():.1f}"]
                if len(values)
                else [UNKNOWN] * 3
            )
        rows.append(cells)
    head = ["Sensor"]
    for title in ("orientation, °", "acceleration, m/s²"):
        head += [f"{title}: median", "95 % below", "largest"]
    return [Table(head, rows, "Differences by sensor" + (f": {wearer.name}" if of > 1 else ""))]


def _reprojection_chart(material: Material) -> Chart | None:
    camera = material.estimate.camera
    if camera is None or camera.residual_px is None:
        return None
    frames = len(camera.residual_px)
    times = (camera.path.time, material.wearers[0].estimate.motion.time)
    time = next((one for one in times if len(one) == frames), None)
    if time is None:
        return None
    lines = [
        Line(one.name, time, values, wearer_mark(one.index, len(material.wearers)))
        for one, values in zip(material.wearers, joined(camera.residual_px).T, strict=True)
    ]
    return time_chart("Video, px: root mean square over the points", lines, from_zero=True)


def joined(values: Array, longest: int = 6) -> Array:
    """``(T, n)`` with gaps of at most so many frames filled in: a camera is slower than the sensors."""
    filled = values.copy()
    for column in filled.T:
        good = np.flatnonzero(np.isfinite(column))
        for before, after in itertools.pairwise(good):
            if 1 < after - before <= longest:
                column[before + 1 : after] = np.interp(
                    np.arange(before + 1, after), (before, after), (column[before], column[after])
                )
    return filled


def _reprojection_table(material: Material) -> list[Block]:
    camera = material.estimate.camera
    if camera is None or camera.residual_px is None:
        return []
    rows = []
    for one, values in zip(material.wearers, camera.residual_px.T, strict=True):
        seen = values[np.isfinite(values)]
        cells = (f"{np.median(seen):.1f}", f"{np.quantile(seen, 0.95):.1f}") if len(seen) else (UNKNOWN, UNKNOWN)
        rows.append((one.name, str(len(seen)), *cells))
    return [Table(("Seen by the camera", "Frames", "Median, px", "95 % below, px"), rows)]


def _truth(material: Material) -> list[Block]:
    """Errors against the truth, in words and by their names."""
    if not material.has_truth:
        return []
    assert material.scene is not None
    scene, one = material.scene, material.estimate.wearers[0]
    truth = scene.wearers[0].truth
    if len(scene.wearers) == 1 and scene.camera is None and truth is not None:
        evaluation = evaluate(one, truth, scene.wearers[0].placement)
        columns: dict[str, Mapping[str, Metric]] = {material.wearers[0].name: evaluation.metrics}
    else:
        evaluation = evaluate_scene(material.estimate, scene)
        each = {name: one.metrics for name, one in evaluation.wearers.items()}
        # Of one wearer alone what is of the scene and what is its own fit into one column.
        columns = (
            {"all": evaluation.metrics, **each}
            if len(each) > 1
            else {name: {**evaluation.metrics, **table} for name, table in each.items()}
        )
    names = [name for name in METRIC_WORDS if any(name in table for table in columns.values())]
    rows = [
        (
            f"{METRIC_WORDS[name]} ({name})",
            next(table[name].unit for table in columns.values() if name in table),
            *(number(table[name].value, 2) if name in table else "" for table in columns.values()),
        )
        for name in names
    ]
    lines = [
        Line(each.name, each.motion.time, each.error_mm, wearer_mark(each.index, len(material.wearers)))
        for each in material.drawn.wearers
        if each.error_mm is not None and each.motion is not None
    ]
    chart = time_chart("Error of the joints against the truth, mm (each frame aligned)", lines,
                       from_zero=True, wide=True)  # fmt: skip
    return [
        Paragraph("The truth is known for this recording; the estimate differs from it by:"),
        Table(("Against the truth", "Unit", *columns), rows, words=1),
        *([Charts((chart,))] if chart is not None else []),
    ]


METRIC_WORDS = {
    "mpjpe": "Joint positions, each frame aligned",
    "mpjpe_true_body": "Joint positions, on a body of true lengths",
    "mpjae": "Orientations of the segments",
    "mpjae_local": "Joint rotations",
    "knee_flexion_rmse": "Knee flexion",
    "knee_flexion_rmse_without_offset": "Knee flexion, mean difference removed",
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
    "coverage_95_joints": "Share of joint rotations within their 95 % range",
}
