"""How well the estimate fits what was measured, sensor by sensor and over time; against the truth if it is known.

And the least certain moments, with pictures: where the estimate fits worst, or knows least.
"""

import base64
import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from vip_factors.body.skeleton import JOINT_NAMES
from vip_factors.evaluate.evaluation import evaluate, evaluate_scene
from vip_factors.evaluate.table import Metric
from vip_factors.geometry.rotations import Array
from vip_factors.report.blocks import (
    UNKNOWN,
    Block,
    Chart,
    Charts,
    Image,
    Line,
    Paragraph,
    Picture,
    Pictures,
    Section,
    Table,
    joint_words,
    number,
    time_chart,
    wearer_mark,
)
from vip_factors.report.material import Material, Wearer
from vip_factors.viz.images import jpeg_bytes, png_bytes
from vip_factors.viz.picture import frame_picture, mean_residual, pose_picture

APART_S = 1.0  # between two moments of one wearer
SMOOTH_S = 0.2  # a moment lasts: single frames do not count
SIZE = (320, 400)  # pixels of a pose
FRAME_WIDTH = 640  # pixels of a video frame
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


@dataclass(frozen=True)
class Moment:
    """A wearer at a time, how many times as bad as usual it is there, and in what."""

    wearer: Wearer
    frame: int
    time: float
    times: float
    reason: str


def moments_section(material: Material, most: int) -> Section | None:
    """The worst moments of all wearers, with a picture of each; None if none is asked for or nothing tells of them."""
    worst = worst_moments(material, most)
    if not worst:
        return None
    pictures = []
    for one in worst:
        pose = pose_picture(one.wearer.estimate.motion, one.frame, SIZE)
        images = [Image(png(pose), f"the body at {one.time:.2f} s"), *_video_frame(material, one)]
        whose = f"{one.wearer.name}, " if len(material.wearers) > 1 else ""
        pictures.append(Picture(tuple(images), f"{whose}{one.time:.2f} s", one.reason, one.time))
    camera = material.scene.camera if material.scene is not None else None
    blind = camera is not None and (camera.video is None or not (camera.video.images or camera.video.path))
    blocks: list[Block] = [
        Paragraph(
            "Where the estimate differs most from what was measured, or knows least, against what is usual in this "
            "recording. Look at these first; elsewhere the body fits better. Left limbs are orange, "
            "right ones blue; in frames of the video the broad skeletons are the reconstructed ones, thin lines what "
            "the detector saw." + (" The video itself is not in the recording." if blind else "")
        ),
        Pictures(tuple(pictures)),
    ]
    return Section("moments", "The least certain moments", tuple(blocks))


def worst_moments(material: Material, most: int) -> list[Moment]:
    """Of all wearers and measures the worst, each of a wearer at least :data:`APART_S` from the others."""
    moments: list[Moment] = []
    for wearer in material.wearers:
        motion = wearer.estimate.motion
        for name, values in _measures(material, wearer).items():
            smooth = _smoothed(values, round(SMOOTH_S * motion.rate))
            usual = float(np.nanmedian(smooth)) if np.isfinite(smooth).any() else 0.0
            if usual <= 0:
                continue
            for frame in _peaks(smooth, round(APART_S * motion.rate), most):
                reason = f"{name.format(smooth[frame])} (usually {usual:.2g}){_where(wearer, name, frame)}"
                moments.append(Moment(wearer, frame, float(motion.time[frame]), smooth[frame] / usual, reason))
    chosen: list[Moment] = []
    for one in sorted(moments, key=lambda moment: -moment.times):
        near = any(one.wearer is other.wearer and abs(one.time - other.time) < APART_S for other in chosen)
        if not near and len(chosen) < most:
            chosen.append(one)
    return sorted(chosen, key=lambda moment: moment.time)


ORIENTATION, ACCELERATION = "orientations differ by {:.1f}°", "accelerations differ by {:.1f}\u202fm/s²"
VIDEO, UNSURE = "body and video differ by {:.0f}\u202fpx", "joints are known to ± {:.1f}° only"
_KINDS = {ORIENTATION: "orientation_deg", ACCELERATION: "acceleration_m_s2"}
"""Sentences with a place for the value, and of which residuals."""


def _measures(material: Material, wearer: Wearer) -> dict[str, Array]:
    """By name, ``(T,)`` each."""
    estimate, camera = wearer.estimate, material.estimate.camera
    measures = {
        name: mean_residual(estimate.residuals[kind])
        for name, kind in _KINDS.items()
        if kind in estimate.residuals and estimate.residuals[kind].size
    }
    if camera is not None and camera.residual_px is not None and len(camera.residual_px) == len(estimate.motion):
        measures[VIDEO] = joined(camera.residual_px)[:, wearer.index]
    if estimate.covariance is not None:
        measures[UNSURE] = np.rad2deg(estimate.covariance.joint_sigma.mean(axis=1))
    return measures


def _where(wearer: Wearer, name: str, frame: int) -> str:
    """Most of it where."""
    estimate = wearer.estimate
    if name == UNSURE and estimate.covariance is not None:
        return f", most at the {joint_words(JOINT_NAMES[int(np.argmax(estimate.covariance.joint_sigma[frame]))])}"
    if name in _KINDS:
        values = estimate.residuals[_KINDS[name]][frame]
        return f", most at {estimate.sensors[int(np.nanargmax(values))]}" if np.isfinite(values).any() else ""
    return ""


def _smoothed(values: Array, width: int) -> Array:
    """A running mean that leaves out what is not known."""
    width = max(1, min(width, len(values)))
    good, ones = np.isfinite(values), np.ones(width)
    total = np.convolve(np.where(good, values, 0.0), ones, "same")
    counted = np.convolve(good.astype(float), ones, "same")
    return np.where(good, total / np.maximum(counted, 1), np.nan)


def _peaks(values: Array, apart: int, most: int) -> list[int]:
    """Frames of the largest values, each a while from the others."""
    left, peaks = values.copy(), list[int]()
    while len(peaks) < most and np.isfinite(left).any():
        frame = int(np.nanargmax(left))
        peaks.append(frame)
        left[max(frame - apart, 0) : frame + apart] = np.nan
    return peaks


def _video_frame(material: Material, moment: Moment) -> list[Image]:
    """The frame of the video at a moment with the skeletons over it, if the camera is there and sees something then."""
    drawn = material.drawn
    if drawn.detections is None or drawn.model is None or not len(drawn.detections.time):
        return []
    time = drawn.detections.time
    frame = int(np.argmin(np.abs(time - moment.time)))
    if abs(time[frame] - moment.time) > APART_S / 2:
        return []
    height = round(FRAME_WIDTH * drawn.model.height / drawn.model.width)
    image = frame_picture(drawn, frame, (FRAME_WIDTH, height))
    return [Image(jpeg(image), f"the video at {time[frame]:.2f} s with the skeletons over it", wide=True)]


def png(image: np.ndarray) -> str:
    """A ``data:`` address of an image ``(height, width, 3)``, blue green red: of drawings."""
    return f"data:image/png;base64,{base64.b64encode(png_bytes(image)).decode()}"


def jpeg(image: np.ndarray) -> str:
    """The same of photographs."""
    return f"data:image/jpeg;base64,{base64.b64encode(jpeg_bytes(image)).decode()}"


POSES, STRIP_SIZE = 6, (180, 260)  # a row, pixels of a pose


def strip(material: Material) -> np.ndarray:
    """A row of poses for each wearer ``(height, width, 3)``, blue green red, evenly over the time."""
    rows = []
    for wearer in material.wearers:
        motion = wearer.estimate.motion
        frames = np.round(np.linspace(0.04, 0.96, POSES) * (len(motion) - 1)).astype(int)
        rows.append(np.concatenate([pose_picture(motion, int(frame), STRIP_SIZE) for frame in frames], axis=1))
    return np.concatenate(rows, axis=0)
