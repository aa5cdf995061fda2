"""Where one kind of detector puts its keypoints on people's bones: what recordings with a known motion teach.

Two things are unlike: the detector has a habit, the same before everybody, and people differ from each other about it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vip_factors.body.keypoints import OFFSET_KEYPOINTS
from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array

SHAPE = (len(OFFSET_KEYPOINTS), 3)


@dataclass(frozen=True)
class KeypointOffsets:
    """A Gaussian over the offsets of the :data:`~vip_factors.body.keypoints.OFFSET_KEYPOINTS` before one person.

    Attributes:
        mean: ``(K, 3)`` metres from where the table has a keypoint, of the left side, bone axes; on the right side x
            is mirrored.
        sigma: ``(K, 3)`` metres, positive.
    """

    mean: Array
    sigma: Array

    def __post_init__(self) -> None:
        mean, sigma = np.asarray(self.mean, float), np.asarray(self.sigma, float)
        if mean.shape != SHAPE or sigma.shape != SHAPE:
            raise InputError(f"keypoint offsets: mean {mean.shape} and sigma {sigma.shape}: expected {SHAPE} of both")
        if not (np.all(np.isfinite(mean)) and np.all(np.isfinite(sigma)) and np.all(sigma > 0)):
            raise InputError("keypoint offsets: expected finite means and sigmas above zero")
        object.__setattr__(self, "mean", mean)
        object.__setattr__(self, "sigma", sigma)


@dataclass(frozen=True)
class PooledOffsets:
    """What several people taught of one detector.

    Attributes:
        offsets: to expect before the next person.
        people: how many taught it; one who was recorded twice counts twice.
    """

    offsets: KeypointOffsets
    people: int


@dataclass(frozen=True)
class OffsetTraining:
    """How much a few recordings are believed."""

    # As so many people the usual sigmas count, when it is asked how far people scatter about a detector's habit.
    prior_people: float = 4.0
    # Of the usual variance the habit's share, which all people have in common; the rest is from one to the next.
    habit_share: float = 0.5
    least_sigma_m: float = 0.003  # truths are no better: markers on the skin, joints by regression


def pooled_offsets(
    found: Sequence[KeypointOffsets], usual: Array, settings: OffsetTraining | None = None
) -> PooledOffsets:
    """What to expect of a detector before the next person; with nobody to learn from, zero and the usual sigmas.

    Every keypoint by itself: the spread of people, alike in all axes for few tell little, is the mean of what is usual
    and of what was found, the noise of each taken off; the habit's mean is weighted by that spread, and drawn to zero
    by its share of the usual.

    Args:
        found: of each person, with the sigmas of what was found.
        usual: ``(K, 3)`` metres, sigmas of a detector of which nothing is known.
        settings: of the training.
    """
    settings = settings or OffsetTraining()
    habit, people = settings.habit_share * usual**2, (1 - settings.habit_share) * usual**2
    if not found:
        return PooledOffsets(KeypointOffsets(np.zeros(SHAPE), usual), 0)
    mean, noise = np.stack([one.mean for one in found]), np.stack([one.sigma**2 for one in found])
    # Who was seen too vaguely to say how people scatter counts less. About its own mean a sum of squares is smaller.
    sure = (people / (people + noise)) ** 2
    own = sure / np.sum(sure, axis=0)
    squares = np.sum(sure * (mean - np.sum(own * mean, axis=0)) ** 2, axis=0)
    of_noise = np.sum(sure * (1 - own) * noise, axis=0)
    count = np.sum(sure * (1 - own), axis=0)
    seen, count = (one.mean(axis=1, keepdims=True) for one in (squares - of_noise, count))
    spread = (settings.prior_people * people + seen) / (settings.prior_people + count)
    spread = np.maximum(spread, settings.least_sigma_m**2)
    weight = 1 / (spread + noise)
    information = np.sum(weight, axis=0) + 1 / habit
    sigma = np.sqrt(spread + 1 / information)
    return PooledOffsets(KeypointOffsets(np.sum(weight * mean, axis=0) / information, sigma), len(found))
