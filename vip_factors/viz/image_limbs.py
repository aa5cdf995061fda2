"""Which keypoints of a set a drawn skeleton joins."""

import numpy as np

from vip_factors.body.keypoints import LIMBS, KeypointSet

# Where a set has a neck, the head hangs on it; otherwise it would float above the shoulders.
_MORE = (("neck", "nose"), ("neck", "head_top"))


def limb_pairs(keypoints: KeypointSet) -> np.ndarray:
    """Indices ``(L, 2)`` of the keypoints to join by lines."""
    names = keypoints.keypoints
    found = [[names.index(a), names.index(b)] for a, b in (*LIMBS, *_MORE) if a in names and b in names]
    return np.array(found, dtype=int).reshape(-1, 2)
