"""People followed in the image alone, from video frame to video frame, and what speaks for each of them over time."""

from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import linear_sum_assignment

from vip_factors.associate.tracklets import FURTHEST, LONGEST_GAP_S, RIVAL, keypoint_distance, person_size
from vip_factors.geometry.rotations import Array

KEPT_S = 1.0  # that a track which has ended is remembered: frames within the lag may still be decided again
UNCERTAIN = 0.5  # share of the evidence that survives each frame of a crossing where people could have been exchanged
STILL_THE_SAME_S = 1e-6


def image_gap(rays_a: Array, rays_b: Array, weight_a: Array, weight_b: Array) -> Array:
    """Mean distance ``(..., A, B)`` between keypoints ``(..., A, K, 2)`` and ``(..., B, K, 2)``, over people's size."""
    K = rays_a.shape[-2]
    size_a = person_size(rays_a.reshape(-1, K, 2), weight_a.reshape(-1, K)).reshape(weight_a.shape[:-1])
    size_b = person_size(rays_b.reshape(-1, K, 2), weight_b.reshape(-1, K)).reshape(weight_b.shape[:-1])
    return keypoint_distance(
        rays_a[..., :, None, :, :], rays_b[..., None, :, :, :], weight_a[..., :, None, :], weight_b[..., None, :, :],
        np.maximum(size_a[..., :, None], size_b[..., None, :]),
    )  # fmt: skip


@dataclass
class PersonTracks:
    """Tracks of everybody, the wearers' or not.

    Args:
        wearers: how many there are.
        keypoints: of the detector.
        memory_s: over which evidence is averaged; it starts at zero and has grown up after that time.
    """

    wearers: int
    keypoints: int
    memory_s: float
    number: np.ndarray = field(init=False)
    time: Array = field(init=False)
    rays: Array = field(init=False)
    weight: Array = field(init=False)
    evidence: Array = field(init=False)  # (W, M) mean log-odds of the appearance

    def __post_init__(self) -> None:
        self.number, self.time = np.zeros(0, int), np.zeros(0)
        self.rays, self.weight = np.zeros((0, self.keypoints, 2)), np.zeros((0, self.keypoints))
        self.evidence = np.zeros((self.wearers, 0))
        self._next = 0

    def link(self, time: float, rays: Array, weight: Array) -> np.ndarray:
        """Rows ``(N,)`` of the tracks that persons ``(N, K, 2)`` continue or begin; they then end at this frame."""
        self._keep(self.time >= time - KEPT_S)
        row = np.full(len(rays), -1)
        evidence = np.zeros((self.wearers, len(rays)))
        open_ends = np.flatnonzero(self.time >= time - LONGEST_GAP_S - STILL_THE_SAME_S)
        if len(open_ends) and len(rays):
            self._continue(open_ends, row, evidence, rays, weight)
        fresh = np.flatnonzero(row < 0)
        if len(fresh):
            row[fresh] = len(self.number) + np.arange(len(fresh))
            self._begin(evidence[..., fresh])
        self.rays[row], self.weight[row], self.time[row] = rays, weight, time
        return row

    def _continue(self, open_ends: np.ndarray, row: np.ndarray, evidence: Array, rays: Array, weight: Array) -> None:
        """Fill in the rows of plain continuations, and what is inherited of others."""
        gap = image_gap(self.rays[open_ends], rays, self.weight[open_ends], weight)
        near = np.sort(gap, axis=1)[:, :2], np.sort(gap, axis=0)[:2]
        for a, b in zip(*linear_sum_assignment(np.minimum(gap, 10 * FURTHEST)), strict=True):
            if gap[a, b] >= FURTHEST:
                continue
            # The second of a row or column is a rival; if another is even nearer, that one is.
            plain = all(len(one) < 2 or one[1] > RIVAL * gap[a, b] for one in (near[0][a], near[1][:, b]))
            if plain:
                row[b] = open_ends[a]
            else:
                evidence[..., b] = UNCERTAIN * self.evidence[..., open_ends[a]]

    def _begin(self, evidence: Array) -> None:
        count = evidence.shape[1]
        self.number = np.append(self.number, self._next + np.arange(count))
        self._next += count
        self.time = np.append(self.time, np.zeros(count))
        self.rays = np.concatenate([self.rays, np.zeros((count, self.keypoints, 2))])
        self.weight = np.concatenate([self.weight, np.zeros((count, self.keypoints))])
        self.evidence = np.concatenate([self.evidence, evidence], axis=1)

    def _keep(self, which: np.ndarray) -> None:
        if which.all():
            return
        self.number, self.time, self.evidence = self.number[which], self.time[which], self.evidence[..., which]
        self.rays, self.weight = self.rays[which], self.weight[which]

    def hear(self, row: np.ndarray, log_odds: Array, elapsed: float) -> None:
        """Take in what one more frame says of tracks ``row``, ``(W, N)``, after ``elapsed`` seconds."""
        share = 1 - np.exp(-max(elapsed, 0.0) / self.memory_s)
        self.evidence[..., row] += share * (log_odds - self.evidence[..., row])

    def evidence_of(self, number: np.ndarray) -> Array:
        """Evidence ``(W, ...)`` of tracks by number; zero for a track that is not remembered."""
        if not len(self.number):
            return np.zeros((self.wearers, *number.shape))
        place = np.minimum(np.searchsorted(self.number, number), len(self.number) - 1)
        return np.where(self.number[place] == number, self.evidence[:, place], 0.0)
