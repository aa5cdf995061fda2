"""Several wearers, one camera: how exactly they are placed relative to one another."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from time import perf_counter

import numpy as np

from tests.studies.crowd import CrowdTrials, crowd_scene, held_out_motions
from tests.studies.vip_table import plain
from vip_factors.errors import RecordingError, SolveError
from vip_factors.evaluate.scene import evaluate_scene
from vip_factors.pipeline import smooth_scene
from vip_factors.sensors.scene import Scene
from vip_factors.settings import Settings
from vip_factors.simulate.scene_settings import CameraKind

Tell = Callable[[str, float], None]
CAMERAS: tuple[CameraKind, ...] = ("fixed", "hand-held")
METRICS = (
    "mpjpe", "mpjae", "heading_error", "mounting_error", "camera_translation", "camera_rotation",
    "association_precision", "association_recall",
)  # fmt: skip
PAIRS = ("relative_mm", "relative_95th_mm", "distance_mm", "distance_95th_mm")


@dataclass(frozen=True)
class WearersTrial:
    """One scene: the scene's metrics, and of every pair of wearers the error of the vector between them."""

    camera: str
    seed: int
    metrics: dict[str, float]
    pairs: dict[str, dict[str, float]]
    seconds: float
    findings: tuple[str, ...] = ()
    failure: str = ""


def run_wearers(
    motions: Path, trials: CrowdTrials, cameras: Sequence[CameraKind] = CAMERAS, tell: Tell | None = None
) -> list[WearersTrial]:
    """Reconstruct scenes of several wearers, with each kind of camera.

    Args:
        motions: folder of the held-out clips.
        trials: which scenes; their camera is replaced.
        cameras: what films.
        tell: called with what is done and the fraction of it.
    """
    clips, results = held_out_motions(motions), []
    work = [(camera, seed) for seed in range(trials.seeds) for camera in cameras]
    for done, (camera, seed) in enumerate(work):
        if tell is not None:
            tell("benchmark", done / len(work))
        scene = crowd_scene(clips, replace(trials, camera=camera), seed)
        results.append(wearers_trial(scene, trials.settings, camera, seed))
    return results


def wearers_trial(scene: Scene, settings: Settings, camera: str = "", seed: int = 0) -> WearersTrial:
    """One scene, reconstructed and measured."""
    begin = perf_counter()
    try:
        estimate = smooth_scene(scene, settings)
    except (SolveError, RecordingError) as error:
        return WearersTrial(camera, seed, {}, {}, perf_counter() - begin, failure=str(error))
    seconds, evaluation = perf_counter() - begin, evaluate_scene(estimate, scene)
    metrics = {name: evaluation.metrics[name].value for name in METRICS if name in evaluation.metrics}
    pairs = {name: dict(row) for name, row in evaluation.pairs.items()}
    return WearersTrial(camera, seed, metrics, pairs, seconds, estimate.findings)


def wearers_table(trials: Sequence[WearersTrial], settings: CrowdTrials) -> str:
    """Markdown: means over scenes and pairs, by camera; then every scene."""
    columns = [*PAIRS, *METRICS, "seconds"]
    lines = [
        f"{settings.wearers} wearers, {settings.bystanders} bystanders, {settings.seconds:g} s; relative: of the "
        "vector between two pelves, after the scene's common yaw; distance: of its length, which no gauge touches",
        "",
        f"| camera | {' | '.join(columns)} |",
        "|---|" + "---:|" * len(columns),
    ]
    for camera in dict.fromkeys(one.camera for one in trials):
        own = [one for one in trials if one.camera == camera]
        rows = [_row(one) for one in own]
        for one, row in zip(own, rows, strict=True):
            lines.append(f"| {camera}, seed {one.seed} | {_cells(row)} |")
        solved = [row for row in rows if np.any(np.isfinite(row[: len(PAIRS)]))]
        if solved:
            lines.append(f"| **{camera}, mean** | {_cells(list(np.mean(solved, axis=0)))} |")
    failures = [f"- {one.camera}, seed {one.seed}: not solved: {one.failure}" for one in trials if one.failure]
    findings = [f"- {one.camera}, seed {one.seed}: {finding}" for one in trials for finding in one.findings]
    return "\n".join([*lines, *([""] if failures or findings else []), *failures, *findings]) + "\n"


def _row(trial: WearersTrial) -> list[float]:
    nan = float("nan")
    pairs = [float(np.mean([row[name] for row in trial.pairs.values()])) if trial.pairs else nan for name in PAIRS]
    return [*pairs, *(trial.metrics.get(name, nan) for name in METRICS), trial.seconds]


def _cells(row: Sequence[float]) -> str:
    return " | ".join(f"{value:.2f}" if np.isfinite(value) else "n/a" for value in row)


def wearers_json(trials: Sequence[WearersTrial], settings: CrowdTrials) -> str:
    """Every scene, and the settings."""
    content = {"trials": [asdict(one) for one in trials], "settings": asdict(settings)}
    return json.dumps(plain(content), indent=2) + "\n"
