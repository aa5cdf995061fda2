"""Tracklets: detections of one person in successive frames, linked in the image alone and only where that is plain."""

import numpy as np
from scipy.optimize import linear_sum_assignment

from vip_factors.geometry.rotations import Array

FURTHEST = 0.35  # of the person's size, from one frame to the next: more is another person, or a lost one
RIVAL = 1.8  # how many times further off the next best must be; nearer, at a crossing, the tracklet ends
LONGEST_GAP_S = 0.1  # without a detection: a blink of the detector
UNFOUND = 1e3


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
