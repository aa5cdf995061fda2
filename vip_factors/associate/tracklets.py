"""Tracklets: detections of one person in successive frames, linked in the image only and where this is unambiguous.

A tracklet is one person, and two detections in one frame are two persons. If the tracklet of one person is a wearer,
simultaneous ones are not, then or at any other time: strangers move alike only for a while.
"""

import numpy as np
from scipy.optimize import linear_sum_assignment

from vip_factors.geometry.rotations import Array

FURTHEST = 0.35  # of the person's size, from one frame to the next; further is another person
RIVAL = 1.8  # ratio of distances to the next best; below it, at a crossing, the tracklet ends
LONGEST_GAP_S = 0.1  # without a detection
NO_OVERLAP = 1e3


def sums_around(key: Array, half: float, of: Array, values: Array) -> tuple[Array, np.ndarray]:
    """Sums ``(m, ...)`` of ``values`` ``(n, ...)`` whose keys ``of`` are within ``half`` of each ``key`` ``(m,)``."""
    order = np.argsort(of, kind="stable")
    low = np.searchsorted(of[order], key - half, "left")
    high = np.searchsorted(of[order], key + half, "right")
    total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values[order], axis=0)])
    return total[high] - total[low], high - low


def person_size(rays: Array, weight: Array) -> Array:
    """Size ``(N,)`` of each detection: longer side of the box around its keypoints, at depth one."""
    is_visible = weight > 0
    low = np.where(is_visible[..., None], rays, np.inf).min(axis=1)
    high = np.where(is_visible[..., None], rays, -np.inf).max(axis=1)
    size = np.max(high - low, axis=1)
    return np.where(np.isfinite(size), np.maximum(size, 1e-4), 1e-4)


def keypoint_distance(rays_a: Array, rays_b: Array, weight_a: Array, weight_b: Array, size: Array) -> Array:
    """Weighted mean distance ``(...)`` of keypoints ``(..., K, 2)`` visible in both, over the persons' size."""
    w = np.sqrt(weight_a * weight_b)
    gap = np.linalg.norm(np.where(w[..., None] > 0, rays_a - rays_b, 0.0), axis=-1)
    total = w.sum(axis=-1)
    return np.where(
        total > 0.5,
        np.sum(w * np.minimum(gap, 4 * size[..., None]), axis=-1) / np.maximum(total, 0.5) / size,
        NO_OVERLAP,
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


def _links(open_ends: np.ndarray, new: np.ndarray, rays: Array, weight: Array, size: Array) -> list[tuple[int, int]]:
    """Unambiguous continuations from detections at ``open_ends`` to ``new`` ones."""
    if not (len(open_ends) and len(new)):
        return []
    larger = np.maximum(size[open_ends][:, None], size[new][None])
    both_rays, both_weights = ((values[open_ends][:, None], values[new][None]) for values in (rays, weight))
    gap = keypoint_distance(*both_rays, *both_weights, larger)
    pairs = []
    for a, b in zip(*linear_sum_assignment(np.minimum(gap, NO_OVERLAP)), strict=True):
        rivals = np.concatenate([np.delete(gap[a], b), np.delete(gap[:, b], a)])
        if gap[a, b] < FURTHEST and (not len(rivals) or rivals.min() > RIVAL * gap[a, b]):
            pairs.append((int(open_ends[a]), int(new[b])))
    return pairs


SURE, UNSURE = 12.0, 0.5  # greatest and least log-odds of a single choice as evidence
WHOLE_SHARE = 0.75  # of the keypoints that the best tenth shows, for a person to count as entirely visible


def contradicted(frame: np.ndarray, track: np.ndarray, wearer: np.ndarray, odds: Array) -> np.ndarray:
    """Choices ``(N,)`` in tracklets that are simultaneous with one of the same wearer that has much more evidence.

    Args:
        frame, track: ``(N,)`` video frame and tracklet of each detection.
        wearer: ``(N,)`` associated wearers, −1 for nobody.
        odds: ``(N,)`` log-odds of each choice on its own; ignored for nobody, NaN too.
    """
    least_frames = 5  # in which both exist and the other is chosen: links are ambiguous for a moment at crossings
    evidence_ratio = 2.0  # times the evidence; a few tracklets contain two people
    wrong = np.zeros(len(wearer), bool)
    if not np.any(wearer >= 0):
        return wrong
    evidence = np.zeros((int(wearer.max()) + 1, int(track.max()) + 1))
    is_chosen = wearer >= 0
    np.add.at(evidence, (wearer[is_chosen], track[is_chosen]), np.clip(np.nan_to_num(odds[is_chosen]), UNSURE, SURE))
    is_owner = (evidence > 0) & (evidence == evidence.max(axis=0))  # the wearer with most evidence for each tracklet
    for w, evidence_of_wearer in enumerate(evidence):
        rivals = [(evidence_of_wearer[k], frame[(track == k) & (wearer == w)]) for k in np.flatnonzero(is_owner[w])]
        for k in np.flatnonzero(evidence_of_wearer > 0):
            frames = frame[track == k]
            least_evidence = evidence_ratio * evidence_of_wearer[k]
            stronger = (rival for evidence_of_rival, rival in rivals if evidence_of_rival > least_evidence)
            simultaneous = (np.sum((rival >= frames[0]) & (rival <= frames[-1])) for rival in stronger)
            if any(count >= least_frames for count in simultaneous):
                wrong |= (wearer == w) & (track == k)
    return wrong


def brief_choices(track: np.ndarray, wearer: np.ndarray, weight: Array, rate: float) -> np.ndarray:
    """Choices ``(N,)`` in long tracklets that are rarely the wearer; none if these are all of the wearer's choices.

    Arguments as for :func:`contradicted` and :func:`tracklets`.
    """
    long_s = 1.0  # from which a tracklet is long
    least_share = 0.2  # of a tracklet's entirely visible people that must be the wearer
    wrong = np.zeros(len(wearer), bool)
    if not len(wearer):
        return wrong
    keypoint_count = np.sum(weight > 0, axis=1)
    is_whole = keypoint_count >= WHOLE_SHARE * np.quantile(keypoint_count, 0.9)
    size = np.bincount(track[is_whole], minlength=int(track.max()) + 1)
    for w in range(int(wearer.max()) + 1):
        frames_of_wearer = np.bincount(track[is_whole & (wearer == w)], minlength=len(size))
        hardly = ((size >= long_s * rate) & (frames_of_wearer < least_share * size))[track] & (wearer == w)
        if np.sum(hardly) < np.sum(wearer == w):
            wrong |= hardly
    return wrong
