"""A tracklet is one person: whoever is a wearer for long is not somebody else in between.

Two people of one frame are two persons. If one's tracklet is a wearer, the other's is not, then or at any other time:
strangers move alike for a while, and in a pose that all hold nobody can be told apart.
"""

import numpy as np

from vip_factors.geometry.rotations import Array

MUCH_MORE = 2.0  # times the evidence: tracklets are linked where that is plain, and still a few hold two people
BOTH_FRAMES = 5  # in which both are there and the one is chosen: links are blurred for a moment at crossings
SURE, UNSURE = 12.0, 0.5  # log-odds of a single choice as evidence, at most and at least
LEAST_SHARE = 0.2  # of a tracklet's whole people that must be the wearer: nobody is so for a moment only
LONG_S = 1.0  # tracklets of which that is asked
WHOLE = 0.75  # of the keypoints that the best tenth shows: half hidden people are not asked to be found by motion


def contradicted(frame: np.ndarray, track: np.ndarray, wearer: np.ndarray, odds: Array) -> np.ndarray:
    """Which choices ``(N,)`` are of tracklets beside which another one was the wearer, with much more evidence.

    Args:
        frame, track: ``(N,)`` video frame and tracklet of each detection.
        wearer: ``(N,)`` who was chosen, −1 for nobody.
        odds: ``(N,)`` log-odds of each choice on its own; anything elsewhere, NaN too.
    """
    wrong = np.zeros(len(wearer), bool)
    if not np.any(wearer >= 0):
        return wrong
    evidence = np.zeros((int(wearer.max()) + 1, int(track.max()) + 1))
    given = wearer >= 0
    np.add.at(evidence, (wearer[given], track[given]), np.clip(np.nan_to_num(odds[given]), UNSURE, SURE))
    theirs = (evidence > 0) & (evidence == evidence.max(axis=0))  # whose each tracklet is most
    for w, own in enumerate(evidence):
        rivals = [(own[k], frame[(track == k) & (wearer == w)]) for k in np.flatnonzero(theirs[w])]
        for k in np.flatnonzero(own > 0):
            there = frame[track == k]
            beside = (np.sum((at >= there[0]) & (at <= there[-1])) for much, at in rivals if much > MUCH_MORE * own[k])
            if any(count >= BOTH_FRAMES for count in beside):
                wrong |= (wearer == w) & (track == k)
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
