"""From features to costs: logistic regressions, trained on labelled scenes (thesis 4.4.1)."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize

from vip_factors.associate.features import INTER, INTRA, INTRA_CAMERA, UNARY, UNARY_CAMERA
from vip_factors.associate.verdict import VERDICT, VERDICT_CAMERA
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import Array

SHIPPED_WEIGHTS = Path(__file__).parent / "data" / "association_weights.json"
FEATURES: dict[str, tuple[str, ...]] = {
    "unary": UNARY,
    "inter": INTER,
    "intra": INTRA,
    "verdict": VERDICT,
    "unary_camera": UNARY_CAMERA,
    "inter_camera": INTER,
    "intra_camera": INTRA_CAMERA,
    "verdict_camera": VERDICT_CAMERA,
}
RIDGE = 1e-3  # of the standardised weights: a feature that adds nothing stays near zero


@dataclass(frozen=True)
class Logistic:
    """The log-odds that a hypothesis (or both of two) is right: linear in the features.

    Attributes:
        weights: ``(n,)`` per unit of each feature.
        bias: log-odds where all features are zero.
    """

    weights: Array
    bias: float

    def log_odds(self, features: Array) -> Array:
        """Log-odds ``(P,)`` of features ``(P, n)``."""
        return features @ self.weights + self.bias


@dataclass(frozen=True)
class AssociationWeights:
    """The regressions by name (:data:`FEATURES`), and a line about where they come from."""

    logistic: Mapping[str, Logistic]
    provenance: str = "unknown"

    def __post_init__(self) -> None:
        for name, features in FEATURES.items():
            if name not in self.logistic or self.logistic[name].weights.shape != (len(features),):
                raise InputError(
                    f"association weights: '{name}' needs {len(features)} weights; train them again with "
                    "'python -m tests.studies train-association' in a clone"
                )


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


@cache
def load_weights(path: Path = SHIPPED_WEIGHTS) -> AssociationWeights:
    """Trained weights; those shipped with the package if no path is given.

    Raises:
        FileFormatError: if the file is not of this kind.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        logistic = {
            name: Logistic(
                np.array([_finite(content[name]["weights"][one]) for one in features]), _finite(content[name]["bias"])
            )
            for name, features in FEATURES.items()
        }
        return AssociationWeights(logistic, str(content["provenance"]))
    except (OSError, KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
        raise FileFormatError(
            f"{path}: not association weights ({error}); expected JSON as the shipped file has it"
        ) from error


def _finite(value: Any) -> float:
    number = float(value)
    if not math.isfinite(number):
        raise ValueError(f"{value} instead of a number")
    return number
