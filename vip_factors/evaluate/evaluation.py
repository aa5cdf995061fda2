"""All metrics of one estimate against the truth, as one table."""

import warnings
from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass, field

import numpy as np

from vip_factors.body.kinematics import Motion
from vip_factors.body.skeleton import JOINT_NAMES, joint_index
from vip_factors.estimate import Estimate, PoseCovariance
from vip_factors.evaluate import consistency, joint_angle, metrics, trajectory
from vip_factors.evaluate.body import body_metrics, joint_centre_error, length_table
from vip_factors.evaluate.calibration import calibration_error, heading_error_over_time, mean_and_95th, share_sensors
from vip_factors.evaluate.calibration_metrics import calibration_metrics, consistency_metrics, sensor_table
from vip_factors.evaluate.frames import common_frames
from vip_factors.evaluate.joints import Compared
from vip_factors.evaluate.summary import summary_lines
from vip_factors.evaluate.table import Metric, json_text, metric_lines, row_lines
from vip_factors.sensors.calibration import Calibration, Placement
from vip_factors.sensors.recording import Truth

SHOWN = 3  # names of sensors in a sentence


class EvaluationWarning(UserWarning):
    """Something that could not be compared, and why."""


@dataclass(frozen=True)
class Evaluation:
    """How good an estimate is.

    Attributes:
        name, method: of the estimate.
        frames: how many were compared.
        metrics: by name, in the order of the table.
        joints: per joint: ``position_mm`` and ``orientation_deg`` after the alignment of MPJPE, ``local_deg`` in the
            parent's frame, ``centre_mm`` from its true place on the bone above; with a covariance ``nees``.
        sensors: per sensor: ``heading_deg`` (signed, after the gauge) and ``mounting_deg``.
        lengths: of the body: ``estimate_mm``, ``truth_mm``, ``error_mm``.
    """

    name: str
    method: str
    frames: int
    metrics: Mapping[str, Metric]
    joints: Mapping[str, Mapping[str, float]]
    sensors: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    lengths: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def __getitem__(self, metric: str) -> float:
        return self.metrics[metric].value

    def __str__(self) -> str:
        return "\n".join([*self.summary(), "", self.to_table().rstrip()])

    def summary(self) -> list[str]:
        """Five lines, each with the gauge that its errors are in."""
        return summary_lines(self.metrics, {self.name: self.metrics})

    def to_table(self) -> str:
        """Markdown: the metrics, then joints, lengths and sensors."""
        lines = metric_lines(self.metrics) + row_lines("joint", self.joints) + row_lines("length", self.lengths)
        return "\n".join(lines + row_lines("sensor", self.sensors)) + "\n"

    def to_json(self) -> str:
        """Everything, as JSON; what is not defined is null."""
        return json_text(asdict(self))


def evaluate(
    estimate: Estimate, truth: Truth, placement: Placement | None = None, gauge: float | None = None
) -> Evaluation:
    """Every metric that the truth allows.

    Args:
        estimate, truth: of one wearer.
        placement: to tell the sensors of feet and hands from the rest.
        gauge: radians by which the estimate's world is known to be turned against the true one (that of a whole
            scene); if None, the mean heading error is taken for it.

    Raises:
        InputError: if the two share no frame.

    Warns:
        EvaluationWarning: if both carry a calibration but share no sensor: headings and mountings are left out.
    """
    motion, reference, chosen = common_frames(estimate.motion, truth.motion)
    compared = Compared.of(truth.known_bones)
    table = _motion_metrics(motion, reference, compared) | {
        "jitter": Metric(trajectory.jitter(motion), "m/s³"),
        # Of the truth as given: interpolated to other frames it would seem to shake.
        "jitter_truth": Metric(trajectory.jitter(truth.motion), "m/s³"),
    }
    lengths = length_table(motion.skeleton, reference.skeleton, compared)
    table |= body_metrics(lengths, estimate.body, motion, reference, compared)
    joints = _joint_table(motion, reference, compared)
    if estimate.covariance is not None:
        covariance = PoseCovariance(estimate.covariance.joints[chosen], estimate.covariance.root[chosen])
        values = consistency.joint_nees(motion, reference, covariance)
        table |= consistency_metrics("joints", values[:, _turns(compared)], 3)
        for name, row in joints.items():
            row["nees"] = consistency.summarise(values[:, joint_index(name)], 3).nees
    sensors: dict[str, Mapping[str, float]] = {}
    if estimate.calibration and truth.calibration and not share_sensors(estimate.calibration, truth.calibration):
        warnings.warn(EvaluationWarning(_other_sensors(estimate.calibration, truth.calibration)), stacklevel=2)
    elif estimate.calibration and truth.calibration:
        error = calibration_error(estimate.calibration, truth.calibration, gauge)
        table |= calibration_metrics(error, estimate.calibration, placement, mean_gauge=gauge is None)
        if any(len(one.heading_path) for one in estimate.calibration.values()):
            over_time = heading_error_over_time(estimate.calibration, truth.calibration, motion.time, gauge)
            table["heading_error_over_time"] = Metric(mean_and_95th(np.abs(list(over_time.values())))[0], "deg")
        sensors = sensor_table(error)
    return Evaluation(estimate.name, estimate.method, len(motion), table, joints, sensors, lengths)


def _other_sensors(estimate: Calibration, truth: Calibration) -> str:
    return (
        f"headings and mountings are not compared: the estimate's sensors are called {_some(estimate)}, those of the "
        f"truth {_some(truth)}"
    )


def _some(names: Collection[str]) -> str:
    return ", ".join(list(names)[:SHOWN]) + (" …" if len(names) > SHOWN else "")


def evaluate_motion(estimate: Motion, truth: Motion) -> Evaluation:
    """The metrics of two motions alone."""
    return evaluate(Estimate(estimate.name, "motion", estimate, {}), Truth(truth))


def _motion_metrics(motion: Motion, truth: Motion, compared: Compared) -> dict[str, Metric]:
    root_cm, root_percent = trajectory.root_translation_error(motion, truth)
    flexion = [[joint_angle.knee_flexion_of(one, side) for one in (motion, truth)] for side in _legs(compared)]
    knees, knees_centred = (
        float(np.mean([compare(*pair) for pair in flexion])) if flexion else float("nan")
        for compare in (joint_angle.rmse, joint_angle.rmse_without_offset)
    )
    return {
        "mpjpe": Metric(metrics.mpjpe(motion, truth, compared), "mm"),
        "mpjpe_true_body": Metric(metrics.mpjpe_true_body(motion, truth, compared), "mm"),
        "mpjae": Metric(metrics.mpjae(motion, truth, compared), "deg"),
        "mpjae_local": Metric(metrics.local_mpjae(motion, truth, compared), "deg"),
        "pa_mpjpe": Metric(metrics.pa_mpjpe(motion, truth, compared), "mm"),
        "root_relative_mpjpe": Metric(metrics.root_relative_mpjpe(motion, truth, compared), "mm"),
        "global_position_error": Metric(metrics.global_position_error(motion, truth, compared), "cm"),
        "yaw_aligned_position_error": Metric(trajectory.yaw_aligned_position_error(motion, truth, compared), "cm"),
        "root_translation_error": Metric(root_cm, "cm"),
        "root_translation_error_percent": Metric(root_percent, "%"),
        "w_mpjpe": Metric(trajectory.w_mpjpe(motion, truth, compared), "mm"),
        "wa_mpjpe": Metric(trajectory.wa_mpjpe(motion, truth, compared), "mm"),
        "foot_sliding": Metric(trajectory.foot_sliding(motion, truth, compared), "mm"),
        "foot_sliding_truth": Metric(trajectory.foot_sliding(truth, truth, compared), "mm"),
        "knee_flexion_rmse": Metric(knees, "deg"),
        "knee_flexion_rmse_without_offset": Metric(knees_centred, "deg"),
    }


def _joint_table(motion: Motion, truth: Motion, compared: Compared) -> dict[str, dict[str, float]]:
    """Joints whose place is known; their angles are not defined where the bone's turn is not known."""
    alignment = metrics.align_frames(motion, truth, compared=compared)
    position = metrics.MM * metrics.position_error(motion, truth, alignment).mean(axis=0)
    orientation = np.rad2deg(metrics.orientation_error(motion, truth, alignment).mean(axis=0))
    local = np.rad2deg(metrics.local_orientation_error(motion, truth).mean(axis=0))
    centre = metrics.MM * joint_centre_error(motion.skeleton, truth.skeleton)
    unknown = sorted(set(range(len(JOINT_NAMES))) - set(compared.orientations()))
    orientation[unknown] = local[unknown] = np.nan
    return {
        JOINT_NAMES[row]: {
            "position_mm": float(position[row]),
            "orientation_deg": float(orientation[row]),
            "local_deg": float(local[row]),
            "centre_mm": float(centre[row]),
        }
        for row in compared.positions()
    }


def _turns(compared: Compared) -> list[int]:
    """Joints whose rotation against the bone above is known; the pelvis has none."""
    return [row for row in compared.orientations() if row in compared.positions() and row]


def _legs(compared: Compared) -> list[str]:
    """Sides of which thigh and shank are known."""
    return [side for side in ("left", "right") if len(compared.orientations((f"{side}_hip", f"{side}_knee"))) == 2]
