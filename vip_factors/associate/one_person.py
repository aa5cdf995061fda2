"""A tracklet is one person: whoever is a wearer for long is not somebody else in between.

Two people of one frame are two persons. If one's tracklet is found to be a wearer much more often than the other's,
choices of that other one, made while both are in the picture, were mistakes: strangers move alike for a while.
"""

import numpy as np

from vip_factors.geometry.rotations import Array

MUCH_OFTENER = 2.0  # times: tracklets are linked where that is plain, and still a few hold two people
LEAST_SHARE = 0.2  # of a tracklet's whole people that must be the wearer: nobody is so for a moment only
LONG_S = 1.0  # tracklets of which that is asked
WHOLE = 0.75  # of the keypoints that the best tenth shows: half hidden people are not asked to be found by motion


def contradicted(frame: np.ndarray, track: np.ndarray, wearer: np.ndarray) -> np.ndarray:
    """Which choices ``(N,)`` another tracklet in the same frame, which is the wearer much oftener, speaks against.

    Args:
        frame, track: ``(N,)`` video frame and tracklet of each detection.
        wearer: ``(N,)`` who was chosen, −1 for nobody.
    """
    wrong = np.zeros(len(wearer), bool)
    if not len(wearer):
        return wrong
    often = np.zeros((int(wearer.max()) + 1, int(track.max()) + 1), int)
    np.add.at(often, (wearer[wearer >= 0], track[wearer >= 0]), 1)
    first, last = np.full(often.shape[1], int(frame.max())), np.zeros(often.shape[1], int)
    np.minimum.at(first, track, frame)
    np.maximum.at(last, track, frame)
    for w, own in enumerate(often):
        rival = np.zeros(int(frame.max()) + 1, int)  # how often the oftenest tracklet that lasts over a frame is w
        for k in np.flatnonzero((own > 0) & (own == often.max(axis=0))):
            lasts = slice(first[k], last[k] + 1)
            rival[lasts] = np.maximum(rival[lasts], own[k])
        wrong |= (wearer == w) & (rival[frame] > MUCH_OFTENER * own[track])
    return wrong


def passing(track: np.ndarray, wearer: np.ndarray, weight: Array, rate: float) -> np.ndarray:
    """Which choices ``(N,)`` lie in long tracklets that hardly ever are the wearer; none if they are all there are.

    Args:
        track: ``(N,)`` tracklet of each detection.
        wearer: ``(N,)`` who was chosen, −1 for nobody.
        weight: ``(N, K)`` confidences of keypoints, 0 for those that are not seen.
        rate: video frames per second.
    """
    wrong = np.zeros(len(wearer), bool)
    if not len(wearer):
        return wrong
    seen = np.sum(weight > 0, axis=1)
    whole = seen >= WHOLE * np.quantile(seen, 0.9)
    size = np.bincount(track[whole], minlength=int(track.max()) + 1)
    for w in range(int(wearer.max()) + 1):
        own = np.bincount(track[whole & (wearer == w)], minlength=len(size))
        hardly = ((size >= LONG_S * rate) & (own < LEAST_SHARE * size))[track] & (wearer == w)
        if np.sum(hardly) < np.sum(wearer == w):
            wrong |= hardly
    return wrong
