"""Training of the association's weights on labelled scenes (thesis 4.4.1)."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from vip_factors.associate.associate import build_programme, choose, gated, inter_edges, intra_edges, make_context
from vip_factors.associate.features import Context, inter_features, unary_features
from vip_factors.associate.settings import AssociationSettings
from vip_factors.associate.verdict import verdict_features
from vip_factors.associate.weights import FEATURES, AssociationWeights, Logistic, fit_logistic
from vip_factors.body.motion import Motion
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.camera_model import CameraModel
from vip_factors.sensors.camera_path import CameraPath
from vip_factors.sensors.detections import Detections


@dataclass(frozen=True)
class LabelledScene:
    """What the association is given, and what it should find.

    Attributes:
        detections, model, motions, camera, gravity_camera: as of :func:`vip_factors.associate.associate.associate`;
            with a camera the scene trains the second pass, without the first.
        wearer: ``(N,)`` index of the wearer behind each detection, −1 for nobody.
    """

    detections: Detections
    model: CameraModel
    motions: Sequence[Motion]
    wearer: np.ndarray
    camera: CameraPath | None = None
    gravity_camera: Array | None = None


def train_association(
    scenes: Iterable[LabelledScene], provenance: str, settings: AssociationSettings | None = None
) -> AssociationWeights:
    """Fit all regressions.

    Args:
        scenes: of both passes, in any order.
        provenance: one line: which scenes.
        settings: gate, rivals and offsets are used.

    Raises:
        InputError: if scenes of one pass are missing, or show nothing wrong or nothing right.
    """
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
        programme, rows = build_programme(context, odds, found, settings)
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
