"""Association of detections with wearers: precision and recall as VIP reports them on 3DPW (thesis 4.4.3)."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from vip_factors.errors import InputError

NOBODY = -1


@dataclass(frozen=True)
class AssociationScore:
    """How right the labels are; NaN where nothing was given, or nothing was there to be found.

    Attributes:
        given: labels that name a wearer.
        true: detections that are a wearer's.
        correct: labels that name the right wearer.
        swapped: labels that name another wearer than the detection's.
        strangers: labels given to detections of bystanders, or of nobody.
        missed: wearers' detections that were given to nobody.
        recall_of: recall of each wearer, by index.
    """

    given: int
    true: int
    correct: int
    swapped: int
    strangers: int
    missed: int
    recall_of: Mapping[int, float]

    @property
    def precision(self) -> float:
        """Correct labels over labels given."""
        return self.correct / self.given if self.given else float("nan")

    @property
    def recall(self) -> float:
        """Correct labels over true labels."""
        return self.correct / self.true if self.true else float("nan")


def association_score(labels: np.ndarray, truth: np.ndarray) -> AssociationScore:
    """Score labels ``(N,)`` of detections against the true ones: index of the wearer, −1 for nobody.

    Raises:
        InputError: if they are not of the same detections.
    """
    labels, truth = np.asarray(labels), np.asarray(truth)
    if labels.shape != truth.shape or labels.ndim != 1:
        raise InputError(
            f"{labels.shape} labels for {truth.shape} true ones: expected one each per detection; are estimate and "
            "truth of the same scene?"
        )
    given, is_true = labels != NOBODY, truth != NOBODY
    correct = is_true & (labels == truth)
    return AssociationScore(
        given=int(given.sum()),
        true=int(is_true.sum()),
        correct=int(correct.sum()),
        swapped=int((given & is_true & ~correct).sum()),
        strangers=int((given & ~is_true).sum()),
        missed=int((is_true & ~given).sum()),
        recall_of={int(w): float(correct[truth == w].mean()) for w in np.unique(truth[is_true])},
    )
