"""Logistic regressions from features to costs, trained on labelled scenes (thesis 4.4.1), and confidence of a choice.

The confidence is a regression too, over the features of each hypothesis and the support of the choices around it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import msgspec
import numpy as np

from vip_factors.associate.assignment import AssignmentProblem
from vip_factors.associate.features import INTER, INTRA, INTRA_CAMERA, UNARY, UNARY_CAMERA, Context
from vip_factors.associate.tracklets import sums_around
from vip_factors.errors import FileFormatError, InputError
from vip_factors.geometry.rotations import Array

_SUPPORT = ("odds", "inter_support", "intra_support", "beside", "support_around", "share_around")
VERDICT = (*UNARY, *_SUPPORT)
VERDICT_CAMERA = (*UNARY_CAMERA, *_SUPPORT)


def verdict_features(
    context: Context, unary: Array, odds: Array, problem: AssignmentProblem, chosen: np.ndarray
) -> Array:
    """Features ``(C, len(VERDICT))`` of the ``C`` ``chosen`` ``(H,)`` hypotheses of a problem.

    ``unary`` ``(H, ...)`` and ``odds`` ``(H,)`` are the features and log-odds of single hypotheses.
    """
    most_support = 12.0  # log-odds, at which support is clipped
    a, b = problem.edges.T
    is_chosen = chosen[a] & chosen[b]
    a, b, support = a[is_chosen], b[is_chosen], -problem.edge_cost[is_chosen]
    between_frames = problem.frame[a] != problem.frame[b]
    H = len(chosen)

    def summed(which: np.ndarray, values: Array) -> Array:
        per_choice = np.bincount(a[which], values[which], H) + np.bincount(b[which], values[which], H)
        return np.asarray(per_choice, dtype=float)

    inter, intra = summed(between_frames, support), summed(~between_frames, support)
    neighbours = summed(~between_frames, np.ones(len(a)))
    total = np.clip(odds + inter + intra, -most_support, most_support)
    around, share = _around(context, problem, chosen, total)
    columns = [
        np.clip(support, -most_support, most_support)[chosen]
        for support in (odds, inter, intra, neighbours, around, share)
    ]
    return np.concatenate([unary[chosen], np.stack(columns, axis=1)], axis=1)


def _around(context: Context, problem: AssignmentProblem, chosen: np.ndarray, value: Array) -> tuple[Array, Array]:
    """Mean value of the choices for the same wearer nearby in time, and the share of frames with any."""
    around_s = 2.0  # over which neighbours' support is averaged
    half = max(1, round(around_s / 2 * context.rate))
    key = problem.wearer * (len(context.time) + 3 * half) + problem.frame
    total, count = sums_around(key, half, key[chosen], value[chosen])
    return total / np.maximum(count, 1), count / (2 * half + 1)


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
    """Log-odds that a hypothesis (or both of two) is right: ``weights`` ``(n,)`` times features plus ``bias``."""

    weights: Array
    bias: float

    def log_odds(self, features: Array) -> Array:
        """Log-odds ``(P,)`` of features ``(P, n)``."""
        return features @ self.weights + self.bias


@dataclass(frozen=True)
class AssociationWeights:
    """Regressions by name (:data:`FEATURES`), and a line about their origin."""

    logistic: Mapping[str, Logistic]
    provenance: str = "unknown"

    def __post_init__(self) -> None:
        for name, features in FEATURES.items():
            if name not in self.logistic or self.logistic[name].weights.shape != (len(features),):
                raise InputError(
                    f"association weights: '{name}' needs {len(features)} weights; train them again with "
                    "'python -m tests.studies train-association' in a clone"
                )


class _Regression(msgspec.Struct, frozen=True):
    weights: dict[str, float]
    bias: float


@cache
def load_weights(path: Path = SHIPPED_WEIGHTS) -> AssociationWeights:
    """Trained weights; those shipped with the package if no path is given.

    Raises:
        FileFormatError: if the file is not of this kind.
    """
    try:
        content = msgspec.json.decode(path.read_bytes(), type=dict[str, object])
        provenance = str(content["provenance"])
        tables = msgspec.convert({name: content[name] for name in FEATURES}, dict[str, _Regression])
        logistic = {
            name: Logistic(np.array([table.weights[feature] for feature in FEATURES[name]]), table.bias)
            for name, table in tables.items()
        }
        return AssociationWeights(logistic, provenance)
    except (OSError, KeyError, ValueError, RecursionError) as error:
        raise FileFormatError(
            f"{path}: not association weights ({error}); expected JSON as the shipped file has it"
        ) from error
