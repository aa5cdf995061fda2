"""Is the reported covariance honest (NEES)? On noise as the factors assume it, and on realistic noise."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np

from tests.studies.gaussian_scene import GaussianScene, GaussianSettings, gaussian_scene
from tests.studies.sip import find_clips
from tests.studies.vip_suite import VipTrials, scene_of
from vip_factors.assembly.objective import SceneObjective
from vip_factors.body.held_out_clips import held_out_names
from vip_factors.body.motion import Motion
from vip_factors.errors import SolveError
from vip_factors.evaluate.consistency import SeedConsistency, nees, over_seeds
from vip_factors.evaluate.scene import evaluate_scene
from vip_factors.geometry.rotations import Array, log, transpose, wrap_angle
from vip_factors.io.motions.files import read_motion
from vip_factors.pipeline import smooth_scene
from vip_factors.problem.blocks import CAMERA
from vip_factors.problem.layout import ROOT, Owner, OwnerId
from vip_factors.problem.state import CameraState
from vip_factors.sensors.placement import PRESETS
from vip_factors.simulate.scene_settings import CameraKind
from vip_factors.solve.levenberg_marquardt import SolveSettings, levenberg_marquardt
from vip_factors.solve.marginals import chain_marginals
from vip_factors.stages.scene_decode import static_covariance

Tell = Callable[[str, float], None]
# From the truth, to the last digit: what is asked is whether the covariance is right, not whether the start was good.
TO_THE_END = SolveSettings(max_iterations=50, relative_decrease=1e-9)
WHAT = {"headings": 1, "mountings": 3, "camera": 6, "joints": 3}  # dimension of one of each
JOINTS_AT = 5  # frames of a run at which all joints together are judged


@dataclass(frozen=True)
class ConsistencyTrials:
    """How much is run."""

    seeds: int = 20  # at least as many as the bounds are to mean something
    camera: CameraKind = "fixed"
    seconds: float = 4.0  # of each clip of the realistic scenes
    # Of the Gaussian noise, against what the factors suppose. At full size the problem bends within the errors, and a
    # covariance of its linearisation is too small by that; at a quarter of it only mistakes are left to be seen.
    sizes: tuple[float, ...] = (0.25, 1.0)
    gaussian: GaussianSettings = field(default_factory=GaussianSettings)
    realistic: VipTrials = field(default_factory=VipTrials)


@dataclass(frozen=True)
class ConsistencyResult:
    """NEES over seeds by noise, and by what was estimated."""

    tables: Mapping[str, Mapping[str, SeedConsistency]]
    camera: str
    failures: tuple[str, ...] = ()


def run_consistency(
    trials: ConsistencyTrials, motions: Path | None = None, tell: Tell | None = None
) -> ConsistencyResult:
    """NEES over seeds.

    Args:
        trials: how much.
        motions: folder of the held-out clips; without it only Gaussian noise is run.
        tell: called with what is done and the fraction of it.
    """
    told, failures = tell or (lambda stage, fraction: None), []
    tables = {}
    for size in trials.sizes:
        settings = replace(trials.gaussian, moving=trials.camera != "fixed", noise=size)
        gaussian = []
        for seed in range(trials.seeds):
            told(f"Gaussian noise, size {size:g}", seed / trials.seeds)
            gaussian.append(gaussian_nees(gaussian_scene(settings, seed)))
        tables[f"Gaussian, {size:g} of what is assumed"] = _over_seeds(gaussian, _whole_dimensions(settings))
    if motions is not None:
        names = held_out_names()
        files = find_clips(motions, names)
        made = replace(trials.realistic, seconds=trials.seconds, camera=trials.camera)
        realistic = []
        for seed in range(trials.seeds):
            told("realistic noise", seed / trials.seeds)
            name = names[seed % len(names)]
            try:
                realistic.append(realistic_nees(read_motion(files[name]), name, made, seed))
            except SolveError as error:
                failures.append(f"{name}, seed {seed}: {error}")
        tables["realistic"] = _over_seeds(realistic, WHAT)
    return ConsistencyResult(tables, trials.camera, tuple(failures))


def _whole_dimensions(settings: GaussianSettings) -> dict[str, int]:
    """Dimension of each vector that is judged as a whole, so that its NEES is one chi-square sample."""
    sensors = len(PRESETS[settings.placement])
    return {"headings": sensors, "mountings": 3 * sensors, "camera": 6, "joints": ROOT, "root": 3}


def _over_seeds(runs: Sequence[Mapping[str, Array]], dimensions: Mapping[str, int]) -> dict[str, SeedConsistency]:
    table = {}
    for name, dimension in dimensions.items():
        values = [np.asarray(run[name]) for run in runs if name in run]
        if any(np.any(np.isfinite(one)) for one in values):
            table[name] = over_seeds(values, dimension)
    return table


def gaussian_nees(scene: GaussianScene) -> dict[str, Array]:
    """NEES over dimension of one scene, each of all headings, all mountings, the camera, all joints of a frame.

    Raises:
        SolveError: if the problem is not determined.
    """
    objective = SceneObjective(scene.model)
    state, _ = levenberg_marquardt(objective, scene.truth, TO_THE_END)
    marginals = chain_marginals(objective.linearise(state))
    own, true, owner = state.wearers[0], scene.truth.wearers[0], OwnerId(Owner.WEARER)
    headings = static_covariance(objective, owner, "headings", marginals)
    mountings = static_covariance(objective, owner, "R_bone_sensor", marginals)
    keys = objective.frame_keys(owner)
    assert headings is not None
    assert mountings is not None
    assert keys is not None
    heading = wrap_angle(true.headings - own.headings)
    mounting = log(transpose(own.R_bone_sensor) @ true.R_bone_sensor).ravel()
    frames = np.unique(np.linspace(0, len(own.p_world_pelvis) - 1, JOINTS_AT).astype(int))
    of_frames = np.stack([marginals[keys[t]] for t in frames])
    joints = log(transpose(own.R_parent_child[frames]) @ true.R_parent_child[frames]).reshape(len(frames), -1)
    root = (true.p_world_pelvis - own.p_world_pelvis)[frames]
    return {
        "headings": nees(heading[None], headings[None]),
        "mountings": nees(mounting[None], mountings[None]),
        "camera": _camera_nees(objective, state.camera, scene.truth.camera, marginals, frames),
        "joints": nees(joints, of_frames[:, :ROOT, :ROOT]),
        "root": nees(root, of_frames[:, ROOT:, ROOT:]),
    }


def _camera_nees(
    objective: SceneObjective, camera: CameraState, truth: CameraState, marginals: Mapping[int, Array],
    frames: np.ndarray,
) -> Array:  # fmt: skip
    R = camera.poses.R_world_camera
    turn = log(transpose(R) @ truth.poses.R_world_camera)
    shift = np.einsum("tji,tj->ti", R, truth.poses.p_world_camera - camera.poses.p_world_camera)
    tangent = np.concatenate([turn, shift], axis=1)
    path = objective.frame_keys(CAMERA)
    if path is None:
        standing = static_covariance(objective, CAMERA, "poses", marginals)
        assert standing is not None
        return nees(tangent, standing[None])
    return nees(tangent[frames], np.stack([marginals[path[t]] for t in frames]))


def realistic_nees(motion: Motion, name: str, trials: VipTrials, seed: int) -> dict[str, Array]:
    """Mean NEES of one scene of the suite as the pipeline reports it.

    Raises:
        SolveError: if the problem is not determined.
    """
    scene = scene_of(motion, name, trials, seed)
    evaluation = evaluate_scene(smooth_scene(scene, replace(trials.settings, covariance=True)), scene)
    found = {"headings": "nees_heading", "mountings": "nees_mounting", "camera": "nees_camera"}
    values = {what: evaluation.metrics[key].value for what, key in found.items() if key in evaluation.metrics}
    wearer = evaluation.wearers[scene.wearers[0].subject.name]
    if "nees_joints" in wearer.metrics:
        values["joints"] = wearer.metrics["nees_joints"].value
    return {what: np.array([value]) for what, value in values.items()}


def consistency_table(result: ConsistencyResult) -> str:
    """Markdown."""
    lines = [
        f"NEES over dimension, {result.camera} camera: 1 is honest, above it the estimator is too sure of itself; "
        "its square root is by how much errors exceed their standard deviations",
        "",
        "| noise | of | seeds | NEES | 95 % bounds | within | errors / sigmas |",
        "|---|---|---:|---:|---:|---|---:|",
    ]
    for noise, table in result.tables.items():
        for name, one in table.items():
            lines.append(
                f"| {noise} | {name} | {one.runs} | {one.nees:.2f} | {one.low:.2f} to {one.high:.2f} | "
                f"{'yes' if one.honest else 'no'} | {np.sqrt(one.nees):.2f} |"
            )
    return "\n".join([*lines, *[f"- not solved: {failure}" for failure in result.failures]]) + "\n"


def consistency_json(result: ConsistencyResult) -> str:
    """The same, as JSON."""
    return json.dumps(asdict(result), indent=2) + "\n"
