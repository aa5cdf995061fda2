"""The joints that tell somebody from somebody else, and how much each of them counts where a detector gives few."""

from collections.abc import Sequence

import numpy as np

from vip_factors.geometry.rotations import Array

MAJOR_JOINTS = ("neck", "shoulder", "elbow", "wrist", "hip", "knee", "ankle")
ENOUGH_JOINTS = 7  # rightly found, for a detection to count as somebody's (thesis 4.4.3)
ALL_JOINTS = 12  # of which so many are enough: both sides, without the neck, which not every detector gives
GIVEN = 0.1  # of how often the most frequent keypoint is found: a rarer one is not among those a detector gives


def major_joints(names: Sequence[str]) -> np.ndarray:
    """Which keypoints ``(K,)`` are major joints."""
    return np.array([name.split("_")[-1] in MAJOR_JOINTS for name in names], dtype=bool)


def given_keypoints(found: Array) -> np.ndarray:
    """Which keypoints ``(K,)`` a detector gives, by how often ``(K,)`` each is found."""
    return np.asarray((found > 0) & (found >= GIVEN * found.max(initial=0.0)))


def counts_for(names: Sequence[str], found: Array) -> float:
    """For how many major joints each one counts: more than one where the detector gives fewer than usual.

    The choice of wearers was learned from people of whom twelve or thirteen can be seen.

    Args:
        names: of the ``K`` keypoints.
        found: ``(K,)`` how often each is.
    """
    given = int(np.sum(major_joints(names) & given_keypoints(found)))
    return max(1.0, ALL_JOINTS / given) if given else 1.0
