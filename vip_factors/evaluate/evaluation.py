"""All metrics of an estimate against the truth: of one wearer, and of a scene with its camera and several wearers."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace

import numpy as np

from vip_factors.body.joint_angles import joint_angles
from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import JOINT_NAMES, joint_index
from vip_factors.display import Summarised
from vip_factors.errors import InputError
from vip_factors.estimate import Estimate, PoseCovariance, WearerEstimate
from vip_factors.evaluate import metrics
from vip_factors.evaluate.calibration import (
    CalibrationPair,
    body_metrics,
    calibration_error,
    camera_error,
    consistency_metrics,
    error_metrics,
    joint_nees,
    length_table,
    nees,
    sensor_consistency,
    surest_heading,
)
from vip_factors.evaluate.comparison import CameraComparison, Comparison, SceneComparison, compare_motion, compare_scene
from vip_factors.evaluate.metrics import CM, POSITION_JOINTS, Compared, Metric, position_error
from vip_factors.geometry.poses import Alignment
from vip_factors.sensors.camera import anchored_gauge, move_motion, yaw
from vip_factors.sensors.recording import Truth
from vip_factors.sensors.scene import Scene
from vip_factors.tables import Table, json_text, markdown


class EvaluationWarning(UserWarning):
    """Something that could not be compared, and why."""


@dataclass(frozen=True, repr=False)
class Evaluation(Summarised):
    """How good an estimate is, of one wearer or of a scene; what does not apply is empty.

    Attributes:
        name, method, verdict: of the estimate; no verdict of one wearer in a scene.
        metrics: by name, in the order of the table; of a scene those of the whole.
        frames: of one wearer: how many were compared.
        joints: per joint: ``position_mm`` and ``orientation_deg`` after the alignment of MPJPE, ``local_deg`` in the
            parent's frame; with a covariance ``nees``.
        sensors: per sensor: ``heading_deg`` (signed, after the gauge) and ``mounting_deg``.
        lengths: of the body: ``estimate_mm``, ``truth_mm``, ``error_mm``.
        cameras: of a scene: by camera, its metrics, in the units that they have in ``metrics``; these hold the mean
            magnitudes if there are several cameras.
        wearers: of a scene, by subject.
    """

    name: str
    method: str
    metrics: Mapping[str, Metric]
    verdict: str = ""
    frames: int | None = None
    joints: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    sensors: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    lengths: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    cameras: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    wearers: Mapping[str, "Evaluation"] = field(default_factory=dict)

    def __getitem__(self, metric: str) -> float:
        return self.metrics[metric].value

    def __str__(self) -> str:
        names = ("mpjpe", "mpjae", "knee_flexion_rmse", "root_translation_error")
        wearers = [
            (name, *(_mean_text([wearer.metrics], metric) for metric in names)) for name, wearer in self.wearers.items()
        ]
        tables = (
            Table(("wearer", "positions", "orientations", "knee flexion", "path of the pelvis"), wearers),
            self._limb_table(),
            _table("sensor", self.sensors, {"heading_deg": "heading, °", "mounting_deg": "mounting, °"}),
            _table("camera", self.cameras, CAMERA_COLUMNS),
        )
        return "\n".join([*self.summary()[1:], "", *(line for table in tables for line in markdown(table))]).rstrip()

    def summary(self) -> list[str]:
        """A title, and five lines, each with the gauge that its errors are in."""
        wearers = [wearer.metrics for wearer in self.wearers.values()] or [self.metrics]
        return [f"evaluation of '{self.name}', {self.method}", *_summary_lines(self.metrics, wearers)]

    def to_table(self) -> str:
        """Markdown: the metrics, then joints, lengths and sensors, or every wearer of a scene."""
        lines = [f"## {self.name}, {self.method}", ""] if self.wearers else []
        metrics = [(name, number(metric.value), metric.unit) for name, metric in self.metrics.items()]
        lines += markdown(Table(("metric", "value", "unit"), metrics))
        tables = {"joint": self.joints, "length": self.lengths, "sensor": self.sensors, "camera": self.cameras}
        for title, rows in tables.items():
            lines += markdown(_table(title, rows, {column: column for row in rows.values() for column in row}))
        for name, wearer in self.wearers.items():
            lines += [f"## {name}", "", wearer.to_table()]
        return "\n".join(lines).rstrip() + "\n"

    def _limb_table(self) -> Table:
        """Errors of the main joints, left and right beside each other; of several wearers the mean."""
        wearers = list(self.wearers.values()) or [self]

        def mean(joint: str, column: str) -> str:
            values = [wearer.joints[joint][column] for wearer in wearers if joint in wearer.joints]
            return number(float(np.mean(values))) if values else NOTHING

        columns = ("position_mm", "orientation_deg")
        middle = [(joint, *(mean(joint, column) for column in columns), "", "") for joint in MIDDLE_JOINTS]
        limbs = [
            (joint, *(mean(f"{side}_{joint}", column) for side in ("left", "right") for column in columns))
            for joint in LIMB_JOINTS
        ]
        rows = [row for row in (*middle, *limbs) if set(row[1:]) - {NOTHING, ""}]
        return Table(("joint", "left (or middle), mm", "°", "right, mm", "°"), rows)

    def to_json(self) -> str:
        """Everything, as JSON; a number that is not defined is null, what is empty is left out."""
        return json_text(asdict(self))


NOTHING = "n/a"
CAMERA_COLUMNS = {
    "camera_translation": "position, m",
    "camera_rotation": "orientation, °",
    "focal_length_error": "focal length, %",
    "time_offset_error": "clock, ms",
    "association_precision": "labels right, %",
    "association_recall": "people found, %",
}
MIDDLE_JOINTS = ("pelvis", "spine3", "neck", "head")
LIMB_JOINTS = ("hip", "knee", "ankle", "foot", "shoulder", "elbow", "wrist")


def number(value: float) -> str:
    """With two decimals, small ones with two digits, or ``n/a``."""
    if np.isnan(value):
        return NOTHING
    return f"{value:.2g}" if 0 < abs(value) < 0.1 else f"{value:.2f}"


def _table(title: str, rows: Mapping[str, Mapping[str, float]], columns: Mapping[str, str]) -> Table:
    """Rows of numbers by name; ``columns`` are their keys and titles."""
    cells = [(name, *(number(row.get(column, np.nan)) for column in columns)) for name, row in rows.items()]
    return Table((title, *columns.values()), cells)


Metrics = Mapping[str, Metric]


def _mean_text(sources: Sequence[Metrics], name: str) -> str:
    """Mean of a metric, with its unit, over the wearers or scene of which it is defined."""
    metrics = [source[name] for source in sources if name in source and np.isfinite(source[name].value)]
    if not metrics:
        return NOTHING
    unit = {"": "", "deg": "°"}.get(metrics[0].unit, f" {metrics[0].unit}")
    return number(float(np.mean([metric.value for metric in metrics]))) + unit


def _summary_lines(scene: Metrics, wearers: Sequence[Metrics]) -> list[str]:
    """Five lines: positions, orientations, sensors, camera (or path), consistency."""

    def mean(name: str) -> str:
        return _mean_text(wearers, name)

    def value(name: str) -> str:
        return _mean_text([scene], name)

    with_camera = "camera_translation" in scene
    world = "scene_position_error" if with_camera else "yaw_aligned_position_error"
    removed = f"one yaw and shift of the {'scene' if with_camera else 'recording'} removed"
    lines = {
        "positions": f"{mean('mpjpe')}, each frame aligned rigidly (MPJPE); {mean(world)} in the world ({removed})",
        "orientation": f"{mean('mpjae')}, each frame aligned rigidly (MPJAE); {mean('mpjae_local')} relative to the "
        "bone above (no alignment)",
        "sensors": "not compared: the truth has no headings and mountings",
    }
    if "heading_error" in scene:
        gauge = "the scene's yaw removed" if with_camera else "their mean removed"
        mountings = f"mountings {value('mounting_error')} (in the bone's frame)"
        lines["sensors"] = f"headings {value('heading_error')} ({gauge}); {mountings}"
    if with_camera:
        place = f"{value('camera_translation')} and {value('camera_rotation')}"
        lines["camera"] = f"{place} in the world (the same yaw and shift removed)"
        if "focal_length_error" in scene:
            lines["camera"] += f"; focal length {value('focal_length_error')}"
        if "association_precision" in scene:
            shares = f"precision {value('association_precision')}, recall {value('association_recall')}"
            lines["camera"] += f"; detections assigned to wearers: {shares}"
    else:
        share = mean("root_translation_error_percent")
        share = "" if share == NOTHING else f", {share} of its length"
        lines["path"] = f"{mean('root_translation_error')} of the pelvis{share} (one rigid alignment of the path)"
    names = {
        "joints": "joints",
        "headings": "heading",
        "mountings": "mounting",
        "camera": "camera",
        "focal lengths": "focal_length",
        "lengths": "lengths",
    }
    ratios = {
        words: value(f"nees_{name}") if f"nees_{name}" in scene else mean(f"nees_{name}")
        for words, name in names.items()
        if any(f"nees_{name}" in metrics for metrics in (scene, *wearers))
    }
    ratios_text = "squared error over the reported variance (1 is consistent, more is overconfident): " + ", ".join(
        f"{words} {ratio}" for words, ratio in ratios.items()
    )
    unknown = "not compared: no standard deviations in the estimate, or no truth for them"
    lines["consistency"] = ratios_text if ratios else unknown
    return [f"{name:<12} {text}" for name, text in lines.items()]


def evaluate(estimate: WearerEstimate, truth: Truth) -> Evaluation:
    """Every metric of one wearer that the truth allows.

    Raises:
        InputError: if the two share no frame.

    Warns:
        EvaluationWarning: if both carry a calibration but share no sensor: headings and mountings are left out.
    """
    return _evaluate(estimate, truth, compare_motion(estimate.motion, truth), None)


def _evaluate(estimate: WearerEstimate, truth: Truth, comparison: Comparison, gauge: float | None) -> Evaluation:
    """``gauge``: radians by which the scene is turned against the true one; None: the mean heading error."""
    motion, reference, compared = comparison.motion, comparison.truth, comparison.compared
    table = _motion_metrics(motion, reference, compared) | {
        "jitter": Metric(metrics.jitter(motion), "m/s³"),
        # Of the truth as given: interpolated to other frames it would seem to shake.
        "jitter_truth": Metric(metrics.jitter(truth.motion), "m/s³"),
    }
    lengths = length_table(motion.skeleton, reference.skeleton, compared)
    table |= body_metrics(lengths, estimate.body, reference.skeleton)
    joints = _joint_table(motion, reference, compared)
    if estimate.covariance is not None:
        covariance = PoseCovariance(
            estimate.covariance.joints[comparison.frames], estimate.covariance.root[comparison.frames]
        )
        values = joint_nees(motion, reference, covariance)
        # Of joints whose rotation against the bone above is known; the pelvis has none.
        turned = [row for row in compared.orientations() if row in compared.positions() and row]
        table |= consistency_metrics("joints", values[:, turned])
        for name, row in joints.items():
            finite = values[np.isfinite(values[:, joint_index(name)]), joint_index(name)]
            row["nees"] = float(finite.mean()) if len(finite) else float("nan")
    sensors: dict[str, Mapping[str, float]] = {}
    if estimate.calibration and truth.calibration and not estimate.calibration.keys() & truth.calibration.keys():
        shown = 3  # names in the sentence
        estimated, true = (
            ", ".join([*calibration][:shown]) + (" …" if len(calibration) > shown else "")
            for calibration in (estimate.calibration, truth.calibration)
        )
        sentence = f"the estimate's sensors are called {estimated}, those of the truth {true}"
        warnings.warn(EvaluationWarning(f"headings and mountings are not compared: {sentence}"), stacklevel=3)
    elif estimate.calibration and truth.calibration:
        error = calibration_error(estimate.calibration, truth.calibration, gauge)
        pairs = {0: (error, estimate.calibration)}
        consistency = sensor_consistency(pairs, surest_heading(pairs))
        if gauge is not None:  # sigmas are against the heading that defines the scene's world: its table judges them
            consistency.pop("nees_heading", None)
        table |= error_metrics([error]) | consistency
        sensors = {
            name: {
                "heading_deg": float(np.rad2deg(error.heading[name])),
                "mounting_deg": float(np.rad2deg(np.linalg.norm(error.mounting[name]))),
            }
            for name in error.heading
        }
    severity = Estimate.of_one(estimate).verdict.severity
    return Evaluation(estimate.name, estimate.method, table, severity, len(motion), joints, sensors, lengths)


def evaluate_motion(estimate: Motion, truth: Motion) -> Evaluation:
    """The metrics of two motions alone."""
    return evaluate(WearerEstimate(estimate.name, "motion", estimate, {}), Truth(truth))


def _motion_metrics(motion: Motion, truth: Motion, compared: Compared) -> dict[str, Metric]:
    root_cm, root_percent = metrics.root_translation_error(motion, truth)
    legs = [side for side in ("left", "right") if len(compared.orientations((f"{side}_hip", f"{side}_knee"))) == 2]
    angles = [joint_angles(motion), joint_angles(truth)]
    pairs = [[joint_values.of(f"{side}_knee_flexion") for joint_values in angles] for side in legs]
    flexion = float(np.mean([np.sqrt(np.mean((knee - true) ** 2)) for knee, true in pairs])) if pairs else np.nan
    return {
        "mpjpe": Metric(metrics.mpjpe(motion, truth, compared), "mm"),
        "mpjae": Metric(metrics.mpjae(motion, truth, compared), "deg"),
        "mpjae_local": Metric(metrics.local_mpjae(motion, truth, compared), "deg"),
        "mpjpe_offsets_removed": Metric(metrics.mpjpe_offsets_removed(motion, truth, compared), "mm"),
        "sip_error": Metric(metrics.sip_error(motion, truth, compared), "deg"),
        "pa_mpjpe": Metric(metrics.pa_mpjpe(motion, truth, compared), "mm"),
        "root_relative_mpjpe": Metric(metrics.root_relative_mpjpe(motion, truth, compared), "mm"),
        "global_position_error": Metric(metrics.global_position_error(motion, truth, compared), "cm"),
        "yaw_aligned_position_error": Metric(metrics.yaw_aligned_position_error(motion, truth, compared), "cm"),
        "root_translation_error": Metric(root_cm, "cm"),
        "root_translation_error_percent": Metric(root_percent, "%"),
        "w_mpjpe": Metric(metrics.w_mpjpe(motion, truth, compared), "mm"),
        "wa_mpjpe": Metric(metrics.wa_mpjpe(motion, truth, compared), "mm"),
        "foot_sliding": Metric(metrics.foot_sliding(motion, truth, compared), "mm"),
        "knee_flexion_rmse": Metric(flexion, "deg"),
    }


def _joint_table(motion: Motion, truth: Motion, compared: Compared) -> dict[str, dict[str, float]]:
    """Joints whose place is known; their angles are not defined where the bone's turn is not known."""
    alignment = metrics.align_frames(motion, truth, compared=compared)
    position = metrics.MM * metrics.position_error(motion, truth, alignment).mean(axis=0)
    orientation = np.rad2deg(metrics.orientation_error(motion, truth, alignment).mean(axis=0))
    local = np.rad2deg(metrics.local_orientation_error(motion, truth).mean(axis=0))
    unknown = sorted(set(range(len(JOINT_NAMES))) - set(compared.orientations()))
    orientation[unknown] = local[unknown] = np.nan
    return {
        JOINT_NAMES[row]: {
            "position_mm": float(position[row]),
            "orientation_deg": float(orientation[row]),
            "local_deg": float(local[row]),
        }
        for row in compared.positions()
    }


def evaluate_scene(estimate: Estimate, scene: Scene) -> Evaluation:
    """Every metric that the scene's truth allows.

    One yaw and one translation are removed from the whole scene, camera and wearers together; an estimate without
    camera does not tie wearers to each other, so there each one has its own.

    Raises:
        InputError: if estimate and scene do not hold the same wearers, no wearer has a truth, or nothing overlaps.
    """
    comparison = compare_scene(estimate, scene)
    if not comparison.wearers:
        raise InputError(f"scene '{scene.name}' holds no wearer's truth: expected at least one to compare with")
    table: dict[str, Metric] = {}
    wearers = {scene.names[index]: _wearer(estimate, scene, index, comparison) for index in comparison.wearers}
    for name in ("mpjpe", "mpjae", "scene_position_error", "length_error"):
        values = [evaluation.metrics[name] for evaluation in wearers.values()]
        table[name] = Metric(float(np.mean([metric.value for metric in values])), values[0].unit)
    gauge = comparison.gauge
    turn = yaw(gauge) if gauge is not None else None
    table |= error_metrics([error for error, _ in _calibration_pairs(estimate, scene, turn).values()])
    consistency, prior_gauge = _consistency(estimate, scene, comparison)
    cameras = {
        camera.estimate.name: _camera(camera, gauge, prior_gauge) | _association(camera)
        for camera in comparison.cameras
    }
    table |= _mean_of_cameras(list(cameras.values())) | consistency
    errors = {name: {metric: row[metric].value for metric in row} for name, row in cameras.items()}
    severity = estimate.verdict.severity
    return Evaluation(estimate.name, estimate.method, table, severity, cameras=errors, wearers=wearers)


def _wearer(estimate: Estimate, scene: Scene, index: int, scene_comparison: SceneComparison) -> Evaluation:
    """The usual evaluation of one wearer, headings in the scene's gauge, and positions in the true world."""
    recording, comparison = scene.wearers[index], scene_comparison.wearers[index]
    assert recording.truth is not None
    gauge = scene_comparison.gauges[index]
    turn = yaw(gauge) if scene_comparison.is_tied else None
    evaluation = _evaluate(estimate.wearers[index], recording.truth, comparison, turn)
    joints = comparison.compared.positions(POSITION_JOINTS)
    error = position_error(move_motion(comparison.motion, gauge), comparison.truth)[:, joints]
    metrics = {**evaluation.metrics, "scene_position_error": Metric(float(CM * error.mean()), "cm")}
    return replace(evaluation, metrics=metrics, verdict="")


def _calibration_pairs(estimate: Estimate, scene: Scene, gauge: float | None) -> dict[int, CalibrationPair]:
    """Errors of the sensors by wearer, of those that the truth knows."""
    truths = (recording.truth for recording in scene.wearers)
    return {
        index: (calibration_error(wearer.calibration, truth.calibration, gauge), wearer.calibration)
        for index, (wearer, truth) in enumerate(zip(estimate.wearers, truths, strict=True))
        if truth is not None and truth.calibration and wearer.calibration.keys() & truth.calibration.keys()
    }


def _camera(camera: CameraComparison, gauge: Alignment | None, prior_gauge: Alignment | None) -> dict[str, Metric]:
    """Errors of a camera's path, lens, clock and IMU, where estimated and known, and NEES of path and lens."""
    estimate, truth = camera.estimate, camera.truth
    table: dict[str, Metric] = {}
    if gauge is not None:
        off = camera_error(camera.pair, gauge)
        rotation, translation = (np.linalg.norm(part, axis=1).mean() for part in (off[:, :3], off[:, 3:]))
        table["camera_translation"] = Metric(float(translation), "m")
        table["camera_rotation"] = Metric(float(np.rad2deg(rotation)), "deg")
    if estimate.calibration is not None and truth.calibration is not None:
        turn = None if gauge is None else yaw(gauge)
        error = calibration_error({"camera": estimate.calibration}, {"camera": truth.calibration}, turn)
        table["camera_heading_error"] = Metric(float(np.rad2deg(error.heading_magnitude[0])), "deg")
        table["camera_mounting_error"] = Metric(float(np.rad2deg(error.mounting_magnitude[0])), "deg")
    table["time_offset_error"] = Metric(1e3 * (estimate.clock.offset - truth.clock.offset), "ms")
    if camera.model is not None and estimate.focal_sigma is not None:
        log_ratio = float(np.log(np.divide(estimate.model.focal, camera.model.focal)).mean())
        table["focal_length_error"] = Metric(100 * float(np.expm1(log_ratio)), "%")
        table["nees_focal_length"] = Metric((log_ratio / estimate.focal_sigma) ** 2, "")
    if prior_gauge is not None and estimate.covariance is not None:
        path_nees = nees(camera_error(camera.pair, prior_gauge), estimate.covariance[camera.instants])
        table |= consistency_metrics("camera", path_nees)
    return table


def _mean_of_cameras(cameras: Sequence[Metrics]) -> dict[str, Metric]:
    """The metrics of the only camera, or means of magnitudes over those of several that define them."""
    if len(cameras) == 1:
        return dict(cameras[0])
    table: dict[str, Metric] = {}
    for name in dict.fromkeys(name for camera in cameras for name in camera):
        metrics = [camera[name] for camera in cameras if name in camera]
        values = np.abs([metric.value for metric in metrics])
        known = values[np.isfinite(values)]
        table[name] = Metric(float(np.mean(known)) if len(known) else np.nan, metrics[0].unit)
    return table


def _consistency(
    estimate: Estimate, scene: Scene, comparison: SceneComparison
) -> tuple[dict[str, Metric], Alignment | None]:
    """NEES of headings and mountings, and the gauge of the graph's prior (see :func:`anchored_gauge`).

    Where a camera's path was given, and with it the world, there is no gauge. None where the anchor is not known.
    """
    is_world_known = any(camera.known_path is not None for camera in scene.cameras)
    pairs = _calibration_pairs(estimate, scene, 0.0)
    anchor = None if is_world_known else surest_heading(pairs)
    if not estimate.cameras or (anchor is None and not is_world_known):
        return {}, None
    gauge = Alignment(np.eye(3), np.zeros(3), np.ones(()))
    if anchor is not None:
        gauge = anchored_gauge(comparison.wearers[anchor[0]].pair, pairs[anchor[0]][0].heading[anchor[1]])
    return sensor_consistency(pairs, anchor), gauge


def _association(camera: CameraComparison) -> dict[str, Metric]:
    """Precision and recall of a camera's labels in percent, as VIP reports them on 3DPW (thesis 4.4.3).

    Raises:
        InputError: if the estimate labels other detections than the scene's.
    """
    labels, truth = camera.estimate.wearer_of_detection, camera.truth.wearer
    if not len(labels):
        return {}
    if len(labels) != len(truth):
        raise InputError(
            f"camera '{camera.estimate.name}': the estimate labels {len(labels)} detections, the scene holds "
            f"{len(truth)}: expected one label each; is it the estimate of this scene?"
        )
    return label_metrics(labels, truth)


def label_metrics(labels: np.ndarray, truth: np.ndarray) -> dict[str, Metric]:
    """How right labels ``(N,)`` of detections are against the true ones: index of the wearer, −1 for nobody.

    Precision: correct labels over labels given; recall: over detections that are a wearer's; NaN where there are none.
    """
    nobody = -1
    correct = ((truth != nobody) & (labels == truth)).sum()
    counts = {"precision": (labels != nobody).sum(), "recall": (truth != nobody).sum()}
    return {
        f"association_{name}": Metric(100 * float(correct / count) if count else float("nan"), "%")
        for name, count in counts.items()
    }
