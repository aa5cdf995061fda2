"""From features to costs: logistic regressions, trained on labelled scenes (thesis 4.4.1)."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

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
