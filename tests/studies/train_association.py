"""The association's weights, learned from labelled scenes (thesis 4.4.1)."""

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from scipy.optimize import minimize

from tests.studies.association_scenes import LabelledScene, SceneMaking, labelled, make_scene, usable
from tests.studies.pose_prior_training import DAMAGED_CLIPS, held_out_names
from tests.studies.study import Tell
from tests.studies.train_prior import Trained, Training
from vip_factors.associate.associate import build_assignment, choose, gated, inter_edges, intra_edges, make_context
from vip_factors.associate.features import Context, inter_features, unary_features
from vip_factors.associate.weights import FEATURES, AssociationWeights, Logistic, verdict_features
from vip_factors.atomic import atomic_path, check_target
from vip_factors.body.kinematics import Motion
from vip_factors.cli.options import Output
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array
from vip_factors.io.motions.files import motion_files, read_motion
from vip_factors.ranges import NotNegativeInt
from vip_factors.settings import AssociationSettings

RIDGE = 1e-3  # of the standardised weights: a feature that adds nothing stays near zero


@dataclass(frozen=True, kw_only=True)
class TrainAssociation(Training):
    """Learn the weights of the association from scenes simulated with a folder of motions."""

    motions: Path
    """Folder of motion files, searched with all folders below it; those that the package evaluates on are left out."""
    out: Annotated[Path, Output(".json")]
    """File (.json) to write; --overwrite replaces it."""
    scenes: int = 40
    """How many scenes to simulate; each trains both passes."""
    seed: NotNegativeInt = 0
    """Of the scenes."""
    making: Annotated[SceneMaking, tyro.conf.arg(name="", prefix_name=False)] = field(default_factory=SceneMaking)

    def rows(self, tell: Tell) -> Iterator[Trained]:
        check_target(self.out, self.overwrite)
        if not self.motions.is_dir():
            raise InputError(f"{self.motions}: expected a folder of motion files")
        if self.scenes < 1:
            raise InputError(f"--scenes {self.scenes}: expected at least 1")
        left_out = {*DAMAGED_CLIPS, *held_out_names()}
        train_on = [path for path in motion_files(self.motions) if path.stem not in left_out]
        if not train_on:
            raise InputError(f"{self.motions}: no motion file to train on")
        tell("simulating and learning", 0.0)
        clips, source = [read_motion(path) for path in train_on], f"clips in the folder '{self.motions.name}'"
        weights = trained(clips, self.scenes, self.seed, self.making, source)
        with atomic_path(self.out, self.overwrite) as partial:
            save_weights(weights, partial)
        yield Trained(self.out, weights.provenance)


def trained(clips: Iterable[Motion], scenes: int, seed: int, making: SceneMaking, source: str) -> AssociationWeights:
    """Weights learned from scenes made of clips, each for both passes."""
    sound = usable(clips)
    examples = []
    for number in range(seed, seed + scenes):
        scene = make_scene(sound, number, making)
        examples += [labelled(scene, number, second_pass, making) for second_pass in (False, True)]
    provenance = (
        f"logistic regressions on {scenes} simulated scenes of {making.seconds:g} s (seeds {seed} to "
        f"{seed + scenes - 1}), {making.wearers} wearers and {making.bystanders[0]} to {making.bystanders[1]} "
        f"bystanders each, from {len(sound)} {source} without those held out; by "
        "'python -m tests.studies train-association'"
    )
    return train_association(examples, provenance)


def train_association(
    scenes: Iterable[LabelledScene], provenance: str, settings: AssociationSettings | None = None
) -> AssociationWeights:
    """Fit all regressions."""
    settings = settings or AssociationSettings()
    prepared = [
        (scene, make_context(scene.detections, scene.model, scene.motions, scene.camera, scene.gravity_camera))
        for scene in scenes
    ]
    for name, present in (("with", True), ("without", False)):
        if not any((context.camera is not None) == present for _, context in prepared):
            raise InputError(f"training the association: no scenes {name} a camera path; give some for each pass")
    logistic: dict[str, Logistic] = {}
    for suffix in ("", "_camera"):
        here = [(scene, context) for scene, context in prepared if (context.camera is not None) == bool(suffix)]
        logistic |= _train_pass(here, suffix, settings)
    return AssociationWeights(logistic, provenance)


def _train_pass(
    prepared: list[tuple[LabelledScene, Context]], suffix: str, settings: AssociationSettings
) -> dict[str, Logistic]:
    features = [unary_features(context) for _, context in prepared]
    right = [scene.wearer[context.hypotheses.detection] == context.hypotheses.wearer for scene, context in prepared]
    unary = fit_logistic(np.concatenate(features), np.concatenate(right))
    inter: list[tuple[Array, np.ndarray]] = []
    intra: list[tuple[Array, np.ndarray]] = []
    for (_, context), f, y in zip(prepared, features, right, strict=True):
        odds = unary.log_odds(f)
        rows = np.flatnonzero(gated(context, odds, settings))
        a, b = inter_edges(context, rows, settings)
        inter.append((inter_features(context, a, b), y[a] & y[b]))
        intra += [(pair, y[a] & y[b]) for a, b, pair in intra_edges(context, rows, odds)]
    found = {
        "unary" + suffix: unary,
        "inter" + suffix: _fit_evidence(inter, len(FEATURES["inter" + suffix])),
        "intra" + suffix: _fit_evidence(intra, len(FEATURES["intra" + suffix])),
    }
    verdicts = []
    for (_, context), f, y in zip(prepared, features, right, strict=True):
        odds = unary.log_odds(f)
        programme, rows = build_assignment(context, odds, found, settings)
        chosen = choose(context, programme, settings)
        verdicts.append((verdict_features(context, f[rows], odds[rows], programme, chosen), y[rows][chosen]))
    return {**found, "verdict" + suffix: _fit_verdict(verdicts, FEATURES["verdict" + suffix])}


def _fit_verdict(parts: list[tuple[Array, np.ndarray]], names: tuple[str, ...]) -> Logistic:
    """Log-odds of a choice; those of its hypothesis alone where no choice, or every one, is right."""
    x, y = (np.concatenate(part) for part in zip(*parts, strict=True))
    if y.all() or not y.any():
        return Logistic(np.array([float(name == "odds") for name in names]), 0.0)
    return fit_logistic(x, y)


def _fit_evidence(parts: list[tuple[Array, np.ndarray]], width: int) -> Logistic:
    """Log-odds of pairs beyond what a pair has anyhow; nothing, where all pairs are right, or none is."""
    right = np.concatenate([y for _, y in parts]) if parts else np.zeros(0, bool)
    if right.all() or not right.any():
        return Logistic(np.zeros(width), 0.0)
    fit = fit_logistic(np.concatenate([x for x, _ in parts]), right)
    # What two hypotheses say together comes on top of what each says alone: the evidence without the prior odds.
    return Logistic(fit.weights, fit.bias - float(np.log(right.sum() / (~right).sum())))


def fit_logistic(features: Array, right: np.ndarray, weight: Array | None = None) -> Logistic:
    """Logistic regression of labels ``(P,)`` on features ``(P, n)``, with a light ridge on standardised weights."""
    if not (right.any() and (~right).any()):
        raise InputError("training the association needs right and wrong hypotheses: give scenes with bystanders")
    mean, scale = features.mean(axis=0), features.std(axis=0) + 1e-9
    x = np.concatenate([(features - mean) / scale, np.ones((len(features), 1))], axis=1)
    y, w = np.where(right, 1.0, -1.0), np.ones(len(right)) if weight is None else weight

    def loss(theta: Array) -> tuple[float, Array]:
        z = y * (x @ theta)
        value = np.sum(w * np.logaddexp(0, -z)) / w.sum()
        gradient = -(x * (w * y / (1 + np.exp(np.clip(z, -500, 500))))[:, None]).sum(axis=0) / w.sum()
        ridge = np.append(RIDGE * theta[:-1], 0.0)
        return float(value + 0.5 * theta @ ridge), gradient + ridge

    theta = minimize(loss, np.zeros(x.shape[1]), jac=True, method="L-BFGS-B").x
    return Logistic(theta[:-1] / scale, float(theta[-1] - np.sum(theta[:-1] * mean / scale)))


def save_weights(weights: AssociationWeights, path: str | Path) -> None:
    """Write weights as JSON, every one beside its feature's name."""
    content = {
        "provenance": weights.provenance,
        **{
            name: {
                "bias": round(one.bias, 5),
                "weights": dict(zip(FEATURES[name], (round(float(w), 5) for w in one.weights), strict=True)),
            }
            for name, one in weights.logistic.items()
        },
    }
    Path(path).write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
