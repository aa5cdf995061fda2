"""All metrics of an estimate against the truth: of one wearer, and of a scene with its camera and several wearers."""

import warnings
from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass, field, replace

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import JOINT_NAMES, joint_index
from vip_factors.display import Summarised
from vip_factors.errors import InputError
from vip_factors.estimate import Estimate, PoseCovariance, WearerEstimate
from vip_factors.evaluate import metrics
from vip_factors.evaluate.calibration import (
    body_metrics,
    calibration_error,
    calibration_metrics,
    camera_error,
    camera_metrics,
    consistency_metrics,
    joint_nees,
    knee_flexion_of,
    length_table,
    rmse,
    sensor_table,
    share_sensors,
)
from vip_factors.evaluate.comparison import Comparison, SceneComparison, compare_motion, compare_scene
from vip_factors.evaluate.metrics import CM, POSITION_JOINTS, Compared, position_error
from vip_factors.evaluate.scene_metrics import (
    association,
    camera_imu,
    honesty,
    sensors,
)
from vip_factors.evaluate.table import Metric, json_text, metric_lines, row_lines, summary_lines
from vip_factors.sensors.camera import move_motion, yaw
from vip_factors.sensors.recording import Truth
from vip_factors.sensors.scene import Scene


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
    wearers: Mapping[str, "Evaluation"] = field(default_factory=dict)

    def __getitem__(self, metric: str) -> float:
        return self.metrics[metric].value

    def __str__(self) -> str:
        return "\n".join([*self.summary()[1:], "", self.to_table().rstrip()])

    def summary(self) -> list[str]:
        """A title, and five lines, each with the gauge that its errors are in."""
        wearers = {name: one.metrics for name, one in self.wearers.items()}
        lines = summary_lines(self.metrics, wearers or {self.name: self.metrics})
        return [f"evaluation of '{self.name}', {self.method}", *lines]

    def to_table(self) -> str:
        """Markdown: the metrics, then joints, lengths and sensors, or every wearer of a scene."""
        lines = [f"## {self.name}, {self.method}", ""] if self.wearers else []
        lines += metric_lines(self.metrics) + row_lines("joint", self.joints) + row_lines("length", self.lengths)
        lines += row_lines("sensor", self.sensors)
        for name, one in self.wearers.items():
            lines += ["", f"## {name}", "", one.to_table().rstrip()]
        return "\n".join(lines) + "\n"

    def to_json(self) -> str:
        """Everything, as JSON; a number that is not defined is null, what is empty is left out."""
        return json_text(asdict(self))


def evaluate(estimate: WearerEstimate, truth: Truth, gauge: float | None = None) -> Evaluation:
    """Every metric that the truth allows.

    Args:
        estimate, truth: of one wearer.
        gauge: radians by which the estimate's world is known to be turned against the true one (that of a whole
            scene); if None, the mean heading error is taken for it.

    Raises:
        InputError: if the two share no frame.

    Warns:
        EvaluationWarning: if both carry a calibration but share no sensor: headings and mountings are left out.
    """
    return _evaluate(estimate, truth, compare_motion(estimate.motion, truth), gauge)


def _evaluate(estimate: WearerEstimate, truth: Truth, comparison: Comparison, gauge: float | None) -> Evaluation:
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
            known = values[np.isfinite(values[:, joint_index(name)]), joint_index(name)]
            row["nees"] = float(known.mean()) if len(known) else float("nan")
    sensors: dict[str, Mapping[str, float]] = {}
    if estimate.calibration and truth.calibration and not share_sensors(estimate.calibration, truth.calibration):
        ours, true = _some(estimate.calibration), _some(truth.calibration)
        sentence = f"the estimate's sensors are called {ours}, those of the truth {true}"
        warnings.warn(EvaluationWarning(f"headings and mountings are not compared: {sentence}"), stacklevel=3)
    elif estimate.calibration and truth.calibration:
        error = calibration_error(estimate.calibration, truth.calibration, gauge)
        table |= calibration_metrics(error, estimate.calibration, mean_gauge=gauge is None)
        sensors = sensor_table(error)
    told = Estimate.of_one(estimate).verdict.severity
    return Evaluation(estimate.name, estimate.method, table, told, len(motion), joints, sensors, lengths)


def _some(names: Collection[str]) -> str:
    shown = 3  # names of sensors in a sentence
    return ", ".join(list(names)[:shown]) + (" …" if len(names) > shown else "")


def evaluate_motion(estimate: Motion, truth: Motion) -> Evaluation:
    """The metrics of two motions alone."""
    return evaluate(WearerEstimate(estimate.name, "motion", estimate, {}), Truth(truth))


def _motion_metrics(motion: Motion, truth: Motion, compared: Compared) -> dict[str, Metric]:
    root_cm, root_percent = metrics.root_translation_error(motion, truth)
    legs = [side for side in ("left", "right") if len(compared.orientations((f"{side}_hip", f"{side}_knee"))) == 2]
    flexion = [[knee_flexion_of(one, side) for one in (motion, truth)] for side in legs]
    knees = float(np.mean([rmse(*pair) for pair in flexion])) if flexion else float("nan")
    return {
        "mpjpe": Metric(metrics.mpjpe(motion, truth, compared), "mm"),
        "mpjae": Metric(metrics.mpjae(motion, truth, compared), "deg"),
        "mpjae_local": Metric(metrics.local_mpjae(motion, truth, compared), "deg"),
        "pa_mpjpe": Metric(metrics.pa_mpjpe(motion, truth, compared), "mm"),
        "root_relative_mpjpe": Metric(metrics.root_relative_mpjpe(motion, truth, compared), "mm"),
        "global_position_error": Metric(metrics.global_position_error(motion, truth, compared), "cm"),
        "yaw_aligned_position_error": Metric(metrics.yaw_aligned_position_error(motion, truth, compared), "cm"),
        "root_translation_error": Metric(root_cm, "cm"),
        "root_translation_error_percent": Metric(root_percent, "%"),
        "w_mpjpe": Metric(metrics.w_mpjpe(motion, truth, compared), "mm"),
        "wa_mpjpe": Metric(metrics.wa_mpjpe(motion, truth, compared), "mm"),
        "foot_sliding": Metric(metrics.foot_sliding(motion, truth, compared), "mm"),
        "knee_flexion_rmse": Metric(knees, "deg"),
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
    wearers = {
        scene.wearers[index].subject.name: _wearer(estimate, scene, index, comparison) for index in comparison.wearers
    }
    for name in ("mpjpe", "mpjae", "scene_position_error", "length_error"):
        values = [evaluation.metrics[name] for evaluation in wearers.values()]
        table[name] = Metric(float(np.mean([metric.value for metric in values])), values[0].unit)
    gauge = comparison.gauge
    turn = yaw(gauge) if gauge is not None else None
    table |= sensors(estimate, scene, turn)
    if comparison.camera is not None and gauge is not None:
        table |= camera_metrics(camera_error(comparison.camera, gauge))
    table |= camera_imu(estimate, scene, turn)
    table |= honesty(estimate, scene, comparison)
    table |= association(estimate, scene)
    return Evaluation(estimate.name, estimate.method, table, estimate.verdict.severity, wearers=wearers)


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
