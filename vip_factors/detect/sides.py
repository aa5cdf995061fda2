"""Left and right that a model confused in some frames, set right by the frames around them.

Nobody turns about in a few frames: where a pose fits those before it better with its sides exchanged, one of the two is
wrong. Which of them is decided by the majority of the frames that hang together so.
"""

import numpy as np

from vip_factors.body.keypoints import KeypointSet
from vip_factors.geometry.rotations import Array

CLEAR = 0.15  # mean of the votes, in [−1, 1], that links a frame to those before; somebody seen side-on gives less
ENOUGH = 4  # keypoints, both sides counted, that two poses must have in common


def confused(keypoints: KeypointSet, pixels: Array, confidence: Array, reach: int) -> np.ndarray:
    """``(F,)`` in which frames of one person left and right are to be exchanged.

    Args:
        keypoints: of the poses.
        pixels: ``(F, K, 2)`` of the person in successive frames.
        confidence: ``(F, K)`` in [0, 1].
        reach: how many frames before it a frame is compared with: a quarter of a second, in which nobody turns about.
    """
    twin = keypoints.mirrored
    weight = confidence * (twin != np.arange(len(twin)))
    sign = np.ones(len(pixels))
    start, linked = 0, 0
    for frame in range(1, len(pixels)):
        before = slice(max(start, frame - reach), frame)
        votes = _votes(pixels[before], weight[before], pixels[frame], weight[frame], twin)
        mean = float(np.mean(votes * sign[before]))
        sign[frame] = -1 if mean < 0 else 1
        if abs(mean) >= CLEAR:
            linked = frame
        elif frame - linked >= reach:  # the end of frames that hang together
            _settle(sign[start : linked + 1])
            sign[linked + 1 : frame + 1], start, linked = 1, frame, frame
    _settle(sign[start:])
    return sign < 0


def _settle(sign: Array) -> None:
    """The model is right more often than not."""
    if sign.sum() < 0:
        sign *= -1


def _votes(before: Array, weight_before: Array, now: Array, weight_now: Array, twin: np.ndarray) -> Array:
    """``(B,)`` from 1, a pose has its sides as an earlier one, to −1, it has them exchanged; 0 where nothing tells."""
    weight = weight_before * np.minimum(weight_now, weight_now[twin])
    same = np.sum(weight * np.linalg.norm(now - before, axis=-1), axis=1)
    other = np.sum(weight * np.linalg.norm(now[twin] - before, axis=-1), axis=1)
    told = (np.sum(weight > 0, axis=1) >= ENOUGH) & (same + other > 0)
    return np.divide(other - same, other + same, out=np.zeros(len(before)), where=told)
