"""Tracklets: detections of one person in successive frames, linked in the image alone and only where that is plain.

A tracklet is one person: whoever is a wearer for long is not somebody else in between. Two people of one frame are two
persons. If one's tracklet is a wearer, the other's is not, then or at any other time: strangers move alike for a while,
and in a pose that all hold nobody can be told apart.
"""

import numpy as np
from scipy.optimize import linear_sum_assignment

from vip_factors.geometry.rotations import Array

FURTHEST = 0.35  # of the person's size, from one frame to the next: more is another person, or a lost one
RIVAL = 1.8  # how many times further off the next best must be; nearer, at a crossing, the tracklet ends
LONGEST_GAP_S = 0.1  # without a detection: a blink of the detector
UNFOUND = 1e3


def sums_around(key: Array, half: float, of: Array, values: Array) -> tuple[Array, np.ndarray]:
    """Sums ``(m, ...)`` of the ``values`` ``(n, ...)`` whose keys ``of`` are within ``half`` of each key ``(m,)``, and
    how many they are.
    """
    order = np.argsort(of, kind="stable")
    low = np.searchsorted(of[order], key - half, "left")
    high = np.searchsorted(of[order], key + half, "right")
    total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values[order], axis=0)])
    return total[high] - total[low], high - low


def person_size(rays: Array, weight: Array) -> Array:
    """Size ``(N,)`` of each detection: the longer side of the box about its keypoints, at depth one."""
    known = weight > 0
    low = np.where(known[..., None], rays, np.inf).min(axis=1)
    high = np.where(known[..., None], rays, -np.inf).max(axis=1)
    size = np.max(high - low, axis=1)
    return np.where(np.isfinite(size), np.maximum(size, 1e-4), 1e-4)


def keypoint_distance(rays_a: Array, rays_b: Array, weight_a: Array, weight_b: Array, size: Array) -> Array:
    """Weighted mean distance ``(...)`` of keypoints ``(..., K, 2)`` that both show, over the persons' size."""
    w = np.sqrt(weight_a * weight_b)
    gap = np.linalg.norm(np.where(w[..., None] > 0, rays_a - rays_b, 0.0), axis=-1)
    total = w.sum(axis=-1)
    return np.where(
        total > 0.5, np.sum(w * np.minimum(gap, 4 * size[..., None]), axis=-1) / np.maximum(total, 0.5) / size, UNFOUND
    )


def tracklets(frame: np.ndarray, rays: Array, weight: Array, rate: float) -> np.ndarray:
    """Number ``(N,)`` of the tracklet of each detection.

    Args:
        frame: ``(N,)`` video frame of each detection, not decreasing.
        rays, weight: ``(N, K, 2)`` undistorted coordinates and ``(N, K)`` confidences.
        rate: video frames per second.
    """
    size = person_size(rays, weight)
    track = np.arange(len(frame))
    starts = np.searchsorted(frame, np.unique(frame))
    blocks = np.split(np.arange(len(frame)), starts[1:]) if len(frame) else []
    reach = max(1, round(LONGEST_GAP_S * rate))
    open_ends: np.ndarray = np.zeros(0, int)
    for block in blocks:
        open_ends = open_ends[frame[open_ends] >= frame[block[0]] - reach]
        for i, j in _links(open_ends, block, rays, weight, size):
            track[j] = track[i]
        continued = np.isin(track[open_ends], track[block])
        open_ends = np.concatenate([open_ends[~continued], block])
    return np.unique(track, return_inverse=True)[1]


def _links(before: np.ndarray, now: np.ndarray, rays: Array, weight: Array, size: Array) -> list[tuple[int, int]]:
    """Plain continuations from detections ``before`` to those ``now``."""
    if not (len(before) and len(now)):
        return []
    larger = np.maximum(size[before][:, None], size[now][None])
    gap = keypoint_distance(rays[before][:, None], rays[now][None], weight[before][:, None], weight[now][None], larger)
    pairs = []
    for a, b in zip(*linear_sum_assignment(np.minimum(gap, UNFOUND)), strict=True):
        rivals = np.concatenate([np.delete(gap[a], b), np.delete(gap[:, b], a)])
        if gap[a, b] < FURTHEST and (not len(rivals) or rivals.min() > RIVAL * gap[a, b]):
            pairs.append((int(before[a]), int(now[b])))
    return pairs


SURE, UNSURE = 12.0, 0.5  # log-odds of a single choice as evidence, at most and at least
WHOLE = 0.75  # of the keypoints that the best tenth shows: half hidden people are not asked to be found by motion


def contradicted(frame: np.ndarray, track: np.ndarray, wearer: np.ndarray, odds: Array) -> np.ndarray:
    """Which choices ``(N,)`` are of tracklets beside which another one was the wearer, with much more evidence.

    Args:
        frame, track: ``(N,)`` video frame and tracklet of each detection.
        wearer: ``(N,)`` who was chosen, −1 for nobody.
        odds: ``(N,)`` log-odds of each choice on its own; anything elsewhere, NaN too.
    """
    both_frames = 5  # in which both are there and the one is chosen: links are blurred for a moment at crossings
    much_more = 2.0  # times the evidence: tracklets are linked where that is plain, and still a few hold two people
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
            beside = (np.sum((at >= there[0]) & (at <= there[-1])) for much, at in rivals if much > much_more * own[k])
            if any(count >= both_frames for count in beside):
                wrong |= (wearer == w) & (track == k)
    return wrong


def brief_choices(track: np.ndarray, wearer: np.ndarray, weight: Array, rate: float) -> np.ndarray:
    """Which choices ``(N,)`` lie in long tracklets that hardly ever are the wearer; none if they are all there are.

    Arguments as of :func:`contradicted` and :func:`tracklets`.
    """
    long_s = 1.0  # tracklets of which that is asked
    least_share = 0.2  # of a tracklet's whole people that must be the wearer: nobody is so for a moment only
    wrong = np.zeros(len(wearer), bool)
    if not len(wearer):
        return wrong
    seen = np.sum(weight > 0, axis=1)
    whole = seen >= WHOLE * np.quantile(seen, 0.9)
    size = np.bincount(track[whole], minlength=int(track.max()) + 1)
    for w in range(int(wearer.max()) + 1):
        own = np.bincount(track[whole & (wearer == w)], minlength=len(size))
        hardly = ((size >= long_s * rate) & (own < least_share * size))[track] & (wearer == w)
        if np.sum(hardly) < np.sum(wearer == w):
            wrong |= hardly
    return wrong
