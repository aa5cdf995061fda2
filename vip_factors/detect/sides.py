"""Left and right that a model confused in some frames, set right by the frames around them.

Nobody turns about in a few frames: where the trunk's left and right lie the other way round than just before, one of
the two is wrong. Which of them is decided by the majority of the frames that hang together so. The trunk of somebody
who really turns is narrow in between, and tells nothing until it is wide again.
"""

import numpy as np

from vip_factors.body.keypoints import KeypointSet
from vip_factors.geometry.rotations import Array

WIDTHS = ("shoulder", "hip")
# Of a vote, in squares of the trunk's length; people seen from the front or behind vote with about 0.4, those who turn
# about within half a second with 0.1 at most.
CLEAR = 0.12


def confused(keypoints: KeypointSet, pixels: Array, confidence: Array, reach: int) -> np.ndarray:
    """``(F,)`` in which frames of one person left and right are to be exchanged.

    Args:
        keypoints: of the poses; with shoulders and hips.
        pixels: ``(F, K, 2)`` of the person in successive frames.
        confidence: ``(F, K)`` in [0, 1].
        reach: how many frames before it a frame is compared with: a quarter of a second.
    """
    across, weight = _across(keypoints, pixels, confidence)
    sign = np.ones(len(pixels))
    start, linked = 0, 0
    for frame in range(1, len(pixels)):
        before = slice(max(start, frame - reach), frame)
        both = weight[before] * weight[frame]
        votes = np.sum(both * np.sum(across[before] * across[frame], axis=-1), axis=1)
        mean = float(np.sum(votes * sign[before]) / max(np.sum(both), 1e-9))
        sign[frame] = sign[linked]
        if abs(mean) >= CLEAR:
            sign[frame], linked = np.sign(mean), frame
        elif frame - linked >= reach:  # the end of frames that hang together
            _settle(sign[start : linked + 1])
            sign[linked + 1 : frame + 1], start, linked = 1, frame, frame
    _settle(sign[start:])
    return sign < 0


def _settle(sign: Array) -> None:
    """The model is right more often than not."""
    if sign.sum() < 0:
        sign *= -1


def _across(keypoints: KeypointSet, pixels: Array, confidence: Array) -> tuple[Array, Array]:
    """From right to left ``(F, 2, 2)`` at shoulders and hips, in lengths of the trunk, and weights ``(F, 2)``."""
    left, right = ([keypoints.keypoints.index(f"{side}_{name}") for name in WIDTHS] for side in ("left", "right"))
    shoulders, hips = np.moveaxis((pixels[:, left] + pixels[:, right]) / 2, 1, 0)
    length = max(float(np.median(np.linalg.norm(shoulders - hips, axis=1))), 1e-9)
    return (pixels[:, left] - pixels[:, right]) / length, np.minimum(confidence[:, left], confidence[:, right])
