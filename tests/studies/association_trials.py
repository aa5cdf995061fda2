"""Who is who among bystanders (thesis 4.4.3): precision, recall and time, from what an inertial tracker gives."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter

import numpy as np

from tests.studies.crowd import CrowdTrials, crowd_scene, held_out_motions
from tests.studies.thesis import ASSOCIATION_3DPW
from tests.studies.vip_table import plain
from vip_factors.associate.associate import associate
from vip_factors.errors import InputError
from vip_factors.evaluate.association import AssociationScore, association_score
from vip_factors.pipeline import smooth_scene
from vip_factors.sensors.frames import resample_streams
from vip_factors.sensors.scene import Scene
from vip_factors.settings import Settings
from vip_factors.stages.associated_cameras import gravity_in_camera
from vip_factors.stages.decode import motion_of
from vip_factors.stages.inertial import inertial_tracker
from vip_factors.stages.scene_frames import scene_frames
from vip_factors.stages.solver import Solver

Tell = Callable[[str, float], None]
FRAMES = 3000  # for which the time is told


@dataclass(frozen=True)
class AssociationTrial:
    """One scene.

    Attributes:
        seed, camera: which.
        frames, detections: of the video.
        after: ``"inertial tracker"``, or ``"fusion"``: the labels that the whole pipeline ends with.
        visible: share of video frames in which a wearer, on average, is detected.
        score: the labels against the truth.
        tracker_seconds, seconds: of the inertial tracker, and of the association (of all stages after fusion).
    """

    seed: int
    camera: str
    frames: int
    detections: int
    after: str
    visible: float
    score: AssociationScore
    tracker_seconds: float
    seconds: float


def run_association(
    motions: Path, trials: CrowdTrials, tell: Tell | None = None, whole: bool = False
) -> list[AssociationTrial]:
    """Associate the detections of several scenes.

    Args:
        motions: folder of the held-out clips.
        trials: which scenes.
        tell: called with what is done and the fraction of it.
        whole: also run the pipeline to its end, whose second association knows camera and headings.
    """
    clips, results = held_out_motions(motions), []
    for seed in range(trials.seeds):
        if tell is not None:
            tell("benchmark", seed / trials.seeds)
        scene = crowd_scene(clips, trials, seed)
        results.append(first_association(scene, trials.settings, seed, trials.camera))
        if whole:
            results.append(_last_association(scene, trials.settings, seed, trials.camera))
    return results


def first_association(scene: Scene, settings: Settings, seed: int = 0, camera: str = "") -> AssociationTrial:
    """The association as the pipeline begins with it: of what IMUs alone say.

    Raises:
        InputError: if the scene has no camera or no truth.
    """
    if scene.camera is None or scene.truth is None:
        raise InputError(f"scene '{scene.name}' lacks a camera or its truth: expected a simulated one")
    begin = perf_counter()
    solver = Solver(settings.solve, lambda stage, fraction: None)
    time = scene_frames(scene, settings.frame_rate, settings.coarse_factor).coarse
    motions = []
    for wearer in scene.wearers:
        streams = resample_streams([wearer.imus[name] for name in wearer.placed], time)
        tracked = inertial_tracker(wearer, streams, settings, solver)
        motions.append(motion_of(tracked.model, tracked.state))
    tracked_at = perf_counter()
    detections = scene.camera.timed_detections
    gravity = gravity_in_camera(scene.camera, detections.time)
    found = associate(detections, scene.camera.model, motions, settings.association, gravity_camera=gravity)
    end = perf_counter()
    return _trial(scene, found.wearer, "inertial tracker", seed, camera, tracked_at - begin, end - tracked_at)


def _last_association(scene: Scene, settings: Settings, seed: int, camera: str) -> AssociationTrial:
    begin = perf_counter()
    labels = smooth_scene(scene, settings).wearer_of_detection
    return _trial(scene, labels, "fusion", seed, camera, float("nan"), perf_counter() - begin)


def _trial(
    scene: Scene, labels: np.ndarray, after: str, seed: int, camera: str, tracker_seconds: float, seconds: float
) -> AssociationTrial:
    assert scene.camera is not None
    assert scene.truth is not None
    detections, truth = scene.camera.detections, scene.truth.wearer
    frames = len(detections.time)
    if not len(labels):  # nobody was found: everybody is left out
        labels = np.full(len(truth), -1)
    seen = [len(np.unique(detections.frame[truth == w])) / frames for w in range(len(scene.wearers))]
    return AssociationTrial(
        seed, camera, frames, len(truth), after, float(np.mean(seen)), association_score(labels, truth),
        tracker_seconds, seconds,
    )  # fmt: skip


def pooled(trials: Sequence[AssociationTrial]) -> tuple[float, float]:
    """Precision and recall in percent over all labels of all scenes."""
    correct = sum(one.score.correct for one in trials)
    given, true = (sum(getattr(one.score, name) for one in trials) for name in ("given", "true"))
    return (100 * correct / given if given else float("nan")), (100 * correct / true if true else float("nan"))


def association_table(trials: Sequence[AssociationTrial], settings: CrowdTrials) -> str:
    """Markdown."""
    head = [
        "after", "seed", "frames", "detections", "wearers visible %", "precision %", "recall %", "swapped",
        "strangers", "missed", "tracker s", "s", f"s for {FRAMES} frames",
    ]  # fmt: skip
    lines = [
        f"{settings.wearers} wearers among {settings.bystanders} bystanders, {settings.camera} camera",
        "",
        f"| {' | '.join(head)} |",
        "|---|" + "---:|" * (len(head) - 1),
    ]
    for after in dict.fromkeys(one.after for one in trials):
        own = [one for one in trials if one.after == after]
        for one in own:
            score = one.score
            cells = [
                after, one.seed, one.frames, one.detections, f"{100 * one.visible:.0f}",
                f"{100 * score.precision:.2f}", f"{100 * score.recall:.2f}", score.swapped, score.strangers,
                score.missed, f"{one.tracker_seconds:.1f}", f"{one.seconds:.1f}",
                f"{one.seconds * FRAMES / one.frames:.1f}",
            ]  # fmt: skip
            lines.append(f"| {' | '.join(map(str, cells))} |")
        precision, recall = pooled(own)
        lines.append(f"| **{after}, all** | | | | | **{precision:.2f}** | **{recall:.2f}** | | | | | | |")
    lines.append(f"| thesis, 3DPW | | | | | {ASSOCIATION_3DPW[0]:.1f} | {ASSOCIATION_3DPW[1]:.1f} | | | | | | |")
    return "\n".join(lines) + "\n"


def association_json(trials: Sequence[AssociationTrial], settings: CrowdTrials) -> str:
    """Every scene, and the settings."""
    content = {"trials": [asdict(one) for one in trials], "settings": asdict(settings)}
    return json.dumps(plain(content), indent=2) + "\n"
