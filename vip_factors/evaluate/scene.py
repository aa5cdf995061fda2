"""All metrics of a scene's estimate: each wearer, the camera, who was assigned to what, and how they lie together."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from itertools import combinations

import numpy as np

from vip_factors.errors import InputError
from vip_factors.estimate import CameraEstimate, SceneEstimate
from vip_factors.evaluate.camera import camera_error, camera_metrics, common_instants, seen_instants
from vip_factors.evaluate.evaluation import Evaluation, evaluate
from vip_factors.evaluate.frames import common_frames
from vip_factors.evaluate.joints import POSITION_JOINTS, Compared
from vip_factors.evaluate.metrics import CM, position_error
from vip_factors.evaluate.pairs import relative_position_error
from vip_factors.evaluate.scene_metrics import association, camera_imu, honesty, reprojection, sensors
from vip_factors.evaluate.summary import summary_lines
from vip_factors.evaluate.table import Metric, json_text, metric_lines, row_lines
from vip_factors.geometry.poses import Alignment
from vip_factors.sensors.camera_path import MotionPair, PathPair, move_motion, scene_gauge, yaw
from vip_factors.sensors.scene import Scene, SceneTruth


@dataclass(frozen=True)
class SceneEvaluation:
    """How good a scene's estimate is.

    Attributes:
        name, method: of the estimate.
        metrics: of the scene as a whole, by name, in the order of the table.
        wearers: by subject.
        pairs: of wearers, ``"one - other"``: ``relative_mm``, ``distance_mm`` and their 95th percentiles.
    """

    name: str
    method: str
    metrics: Mapping[str, Metric]
    wearers: Mapping[str, Evaluation]
    pairs: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def __getitem__(self, metric: str) -> float:
        return self.metrics[metric].value

    def __str__(self) -> str:
        return "\n".join([*self.summary(), "", self.to_table().rstrip()])

    def summary(self) -> list[str]:
        """Five lines, each with the gauge that its errors are in."""
        return summary_lines(self.metrics, {name: one.metrics for name, one in self.wearers.items()})

    def to_table(self) -> str:
        """Markdown: the scene, pairs of wearers, then every wearer."""
        lines = [f"## {self.name}, {self.method}", "", *metric_lines(self.metrics), *row_lines("pair", self.pairs)]
        for name, evaluation in self.wearers.items():
            lines += ["", f"## {name}", "", evaluation.to_table().rstrip()]
        return "\n".join(lines) + "\n"

    def to_json(self) -> str:
        """Everything, as JSON; what is not defined is null."""
        return json_text(asdict(self))


def evaluate_scene(estimate: SceneEstimate, scene: Scene) -> SceneEvaluation:
    """Every metric that the scene's truth allows.

    One yaw and one translation are removed from the whole scene, camera and wearers together; an estimate without
    camera does not tie wearers to each other, so there each one has its own, and pairs are not compared.

    Raises:
        InputError: if estimate and scene do not hold the same wearers, no wearer has a truth, or nothing overlaps.
    """
    if len(estimate.wearers) != len(scene.wearers):
        raise InputError(
            f"estimate of {len(estimate.wearers)} wearers for a scene of {len(scene.wearers)}: expected the same; "
            "is it the estimate of this scene?"
        )
    pairs: dict[int, MotionPair] = {}
    for index, (one, wearer) in enumerate(zip(estimate.wearers, scene.wearers, strict=True)):
        if wearer.truth is not None:
            pairs[index] = common_frames(one.motion, wearer.truth.motion)[:2]
    if not pairs:
        raise InputError(f"scene '{scene.name}' holds no wearer's truth: expected at least one to compare with")
    camera, chosen = _camera_pair(estimate.camera, scene.truth)
    tied = estimate.camera is not None
    gauges = _gauges(pairs, camera, tied)
    table: dict[str, Metric] = {}
    wearers = {
        scene.wearers[index].subject.name: _wearer(estimate, scene, index, pair, gauges[index], tied)
        for index, pair in pairs.items()
    }
    for name in ("mpjpe", "mpjpe_true_body", "mpjae", "scene_position_error", "length_error", "joint_centre_error"):
        each = [evaluation.metrics[name] for evaluation in wearers.values()]
        table[name] = Metric(float(np.mean([one.value for one in each])), each[0].unit)
    turn = yaw(next(iter(gauges.values()))) if tied else None
    table |= sensors(estimate, scene, turn)
    if camera is not None and estimate.camera is not None:
        seen = seen_instants(estimate.camera.residual_px, estimate.camera.path, chosen)
        table |= camera_metrics(camera_error(camera, next(iter(gauges.values()))), seen)
    table |= camera_imu(estimate, scene, turn)
    table |= honesty(estimate, scene, pairs, camera, chosen)
    table |= reprojection(estimate, scene) | association(estimate, scene)
    together = {
        f"{scene.wearers[i].subject.name} - {scene.wearers[j].subject.name}": relative_position_error(
            pairs[i], pairs[j], gauges[i]
        )
        for i, j in (combinations(pairs, 2) if tied else ())
    }
    return SceneEvaluation(estimate.name, estimate.method, table, wearers, together)


def _camera_pair(camera: CameraEstimate | None, truth: SceneTruth | None) -> tuple[PathPair | None, np.ndarray]:
    if camera is None or truth is None:
        return None, np.zeros(0, int)
    estimated, true, chosen = common_instants(camera.path, truth.camera)
    return (estimated, true), chosen


def _gauges(pairs: Mapping[int, MotionPair], camera: PathPair | None, tied: bool) -> dict[int, Alignment]:
    if tied:
        return dict.fromkeys(pairs, scene_gauge(list(pairs.values()), camera))
    return {index: scene_gauge([pair]) for index, pair in pairs.items()}


def _wearer(
    estimate: SceneEstimate, scene: Scene, index: int, pair: MotionPair, gauge: Alignment, tied: bool
) -> Evaluation:
    """The usual evaluation of one wearer, headings in the scene's gauge, and positions in the true world."""
    recording = scene.wearers[index]
    assert recording.truth is not None
    one = evaluate(estimate.wearers[index], recording.truth, recording.placement, yaw(gauge) if tied else None)
    known = Compared.of(recording.truth.known_bones).positions(POSITION_JOINTS)
    error = position_error(move_motion(pair[0], gauge), pair[1])[:, known]
    metrics = {**one.metrics, "scene_position_error": Metric(float(CM * error.mean()), "cm")}
    return replace(one, metrics=metrics)
