"""Evidence for each person in a video frame to be each wearer: fit of the body, and the track of the person.

The body is moved to its keypoints. In normalised coordinates a keypoint at ``(u, v)`` and a body point at ``p + t``
agree where ``p_x + t_x`` is ``u (p_z + t_z)``, and likewise for y: linear in the translation ``t``. All wearers and
persons of all frames are solved at once, and errors are in metres at the person's depth, as in the batch association.
Persons are tracked in the image only, and the evidence for each is averaged over time.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from vip_factors.associate.features import FITTING_M, joint_weight_of, major_joints
from vip_factors.associate.hypothesis import CAUCHY, LEAST_CONFIDENCE, keypoint_sigma
from vip_factors.associate.tracklets import FURTHEST, LONGEST_GAP_S, RIVAL, keypoint_distance, person_size
from vip_factors.body.keypoints import KeypointSet
from vip_factors.body.kinematics import BodyState
from vip_factors.body.skeleton import Skeleton
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.camera import CameraModel

NEAREST_M = 0.5  # least depth
FREE_M = 100.0  # prior sigma across the view, which leaves it free
LEAST_WEIGHT = 1e-6
TURNS = 3  # of the robust fit; the first is not robust
FULL_CONFIDENCE = 0.3  # above the least, from which a keypoint counts fully


@dataclass(frozen=True)
class People:
    """Persons of ``F`` video frames, padded to ``N`` in each.

    Attributes:
        rays: ``(F, N, K, 2)`` undistorted coordinates at depth one; 0 where the weight is.
        weight: ``(F, N, K)`` confidence; 0 for keypoints that are missing or uncertain.
        is_person: ``(F, N)`` whether there is such a person.
    """

    rays: Array
    weight: Array
    is_person: np.ndarray


@dataclass(frozen=True)
class Fit:
    """Fit of all ``(F, W, N)`` pairs of wearers and persons.

    Attributes:
        shape: robust mean of the squared keypoint errors in sigmas, after the body is moved to the person.
        fitting: number of major joints that fit.
        visible: number of major joints that are visible. Both weight keypoints by confidence, and count each for
            several where the detector gives few.
        position: squared Mahalanobis distance of that move.
    """

    shape: Array
    fitting: Array
    visible: Array
    position: Array


def people_of(pixels: Array, confidence: Array, model: CameraModel) -> People:
    """Persons ``(N, K, 2)``, ``(N, K)`` of one video frame."""
    weight = np.where(np.isfinite(pixels).all(axis=-1) & (confidence >= LEAST_CONFIDENCE), confidence, 0.0)
    rays = np.where(weight[..., None] > 0, model.normalise(pixels), 0.0)
    return People(rays[None], np.minimum(weight, 1.0)[None], np.ones((1, len(pixels)), bool))


def stack_people(frames: Sequence[People]) -> People:
    """Several single frames as one, padded to the largest number of persons."""
    N, K = max(frame.is_person.shape[1] for frame in frames), frames[0].rays.shape[2]
    people = People(np.zeros((len(frames), N, K, 2)), np.zeros((len(frames), N, K)), np.zeros((len(frames), N), bool))
    for f, frame in enumerate(frames):
        n = frame.is_person.shape[1]
        people.rays[f, :n], people.weight[f, :n], people.is_person[f, :n] = frame.rays[0], frame.weight[0], True
    return people


class BodyFitter:
    """Fits the keypoints of wearers to persons.

    Args:
        keypoints: keypoint set of the detector.
        skeletons: skeletons of the ``W`` wearers.
        depth_share: standard deviation of the depth that wrongly predicted limbs cause, as a share of it; added to the
            covariance of the caller.
        side_m: the same across the view, metres.
    """

    def __init__(
        self, keypoints: KeypointSet, skeletons: Sequence[Skeleton], depth_share: float, side_m: float
    ) -> None:
        points = [keypoints.on_body(skeleton) for skeleton in skeletons]
        self.has_keypoint = np.array([[point is not None for point in row] for row in points])
        self.bone = np.array([[0 if point is None else point.bone for point in row] for row in points])
        offsets = [[np.zeros(3) if point is None else point.p_bone_point for point in row] for row in points]
        self.offset = np.array(offsets, dtype=float)
        self.precision = 1 / keypoint_sigma(keypoints) ** 2
        self.major = major_joints(keypoints.keypoints)
        self._share = self.has_keypoint / np.maximum(self.has_keypoint.sum(axis=-1, keepdims=True), 1)
        self.sightings, self._joint_weight = np.zeros(len(self.major)), 1.0  # observations of each major joint
        self.depth_share, self.side_m = depth_share, side_m

    def count_keypoints(self, people: People) -> None:
        """Count the keypoints of one more video frame."""
        self.sightings += np.count_nonzero(people.weight, axis=(0, 1))
        self._joint_weight = joint_weight_of(self.major, self.sightings)

    def points(self, bodies: Sequence[BodyState], R_world_camera: Array, p_world_camera: Array) -> Array:
        """Keypoints ``(F, W, K, 3)`` in the camera's axes, metres.

        Args:
            bodies: bodies of the wearers in ``F`` frames.
            R_world_camera, p_world_camera: ``(F, 3, 3)`` and ``(F, 3)``.
        """
        placed = zip(bodies, self.bone, self.offset, strict=True)
        p_world = np.stack([body.points(bone, offset) for body, bone, offset in placed], axis=1)
        return np.asarray((p_world - p_world_camera[:, None, None]) @ R_world_camera[:, None])

    def middle(self, points: Array) -> Array:
        """Mean ``(..., W, 3)`` of known keypoints ``(..., W, K, 3)``."""
        return np.asarray((self._share[:, None] @ points)[..., 0, :])

    def fit(self, points: Array, people: People, covariance: Array) -> Fit:
        """Compare all wearers with all persons.

        Args:
            points: ``(F, W, K, 3)`` predicted keypoints in the camera's axes.
            people: persons of the ``F`` frames.
            covariance: ``(F, W, 3, 3)`` m², camera axes, of the wearer's position relative to the camera.
        """
        joint_weight = self._joint_weight
        w = people.weight[:, None] * self.has_keypoint[:, None]  # (F, W, N, K)
        place = self.middle(points)
        local = (points - place[..., None, :])[:, :, None]  # (F, W, 1, K, 3)
        place[..., 2] = np.maximum(place[..., 2], NEAREST_M)
        depth = place[..., 2, None]
        prior = 1 / ((self.depth_share * depth) ** 2 + covariance[..., 2, 2, None])
        t, doubt, square = self._moved(local, people.rays[:, None], w, depth, prior)
        shape = np.einsum("...k,...k->...", w, CAUCHY**2 * np.log1p(square * (self.precision / CAUCHY**2)))
        sure = np.clip((w[..., self.major] - LEAST_CONFIDENCE) / FULL_CONFIDENCE, 0, 1)
        fits = np.einsum("...k,...k->...", sure, np.exp(square[..., self.major] * (-0.5 / FITTING_M**2)))
        moved = t - place[:, :, None]
        slack = np.zeros((*depth.shape[:2], 3, 3))  # of a fitted position, due to wrongly predicted limbs
        slack[..., 0, 0] = slack[..., 1, 1] = self.side_m**2
        slack[..., 2, 2] = (self.depth_share * depth[..., 0] / 2) ** 2
        around = (covariance + slack)[:, :, None] + doubt
        position = np.sum(moved * np.linalg.solve(around, moved[..., None])[..., 0], axis=-1)
        shape = shape / np.maximum(w.sum(axis=-1), LEAST_WEIGHT)
        return Fit(shape, joint_weight * fits, joint_weight * sure.sum(axis=-1), position)

    def _moved(self, local: Array, rays: Array, w: Array, depth: Array, prior: Array) -> tuple[Array, Array, Array]:
        """Move the bodies to each person by a robust fit.

        Returns:
            Positions ``(F, W, N, 3)`` of their middles, the covariances of these, and squared residuals of the
            keypoints in m² ``(F, W, N, K)``.
        """
        x, z = local[..., :2], local[..., 2:]
        target = rays * z - x  # t_xy − u t_z = u z − x
        rays = np.broadcast_to(rays, target.shape)
        squares = [np.einsum("...i,...i->...", rays, factor)[..., None] for factor in (rays, target)]
        terms = np.concatenate([rays, target, *squares], axis=-1)
        precision = w * self.precision
        t, square = np.empty((*w.shape[:-1], 3)), np.zeros(0)
        for turn in range(TURNS):
            if turn:
                precision = w * self.precision / (1 + square * (self.precision / CAUCHY**2))
            sums = (precision[..., None, :] @ terms)[..., 0, :]
            total = precision.sum(axis=-1) + 1 / FREE_M**2
            mean_ray, mean_target = sums[..., :2] / total[..., None], sums[..., 2:4] / total[..., None]
            along = sums[..., 4] + prior - np.einsum("...i,...i->...", mean_ray, sums[..., :2])
            pull = np.einsum("...i,...i->...", mean_ray, sums[..., 2:4]) - sums[..., 5]
            t[..., 2] = np.maximum((prior * depth + pull) / along, NEAREST_M)
            t[..., :2] = mean_target + mean_ray * t[..., 2:]
            error = t[..., None, :2] - rays * t[..., None, 2:] - target
            square = np.einsum("...i,...i->...", error, error)
        direction = np.concatenate([mean_ray, np.ones((*w.shape[:-1], 1))], axis=-1)
        doubt = direction[..., :, None] * direction[..., None, :] / along[..., None, None]
        doubt[..., 0, 0] += 1 / total
        doubt[..., 1, 1] += 1 / total
        return t, doubt, square


STILL_THE_SAME_S = 1e-6


def image_gap(rays_a: Array, rays_b: Array, weight_a: Array, weight_b: Array) -> Array:
    """Mean distance ``(..., A, B)`` between keypoints ``(..., A, K, 2)`` and ``(..., B, K, 2)``, over body size."""
    K = rays_a.shape[-2]
    size_a = person_size(rays_a.reshape(-1, K, 2), weight_a.reshape(-1, K)).reshape(weight_a.shape[:-1])
    size_b = person_size(rays_b.reshape(-1, K, 2), weight_b.reshape(-1, K)).reshape(weight_b.shape[:-1])
    rays = rays_a[..., :, None, :, :], rays_b[..., None, :, :, :]
    weight = weight_a[..., :, None, :], weight_b[..., None, :, :]
    return keypoint_distance(*rays, *weight, np.maximum(size_a[..., :, None], size_b[..., None, :]))


class PersonTracks:
    """Tracks of all persons, wearers or not.

    Args:
        wearers: number of wearers.
        keypoints: number of keypoints of the detector.
        memory_s: time constant of the averaged evidence, which starts at zero.

    Attributes:
        number, time: ``(M,)`` of the tracks, and seconds of their last persons.
        rays, weight: ``(M, K, 2)`` and ``(M, K)`` of these persons, as in :class:`People`.
        evidence: ``(W, M)`` mean log-odds of the appearance.
    """

    def __init__(self, wearers: int, keypoints: int, memory_s: float) -> None:
        self.memory_s = memory_s
        self.number, self.time = np.zeros(0, int), np.zeros(0)
        self.rays, self.weight = np.zeros((0, keypoints, 2)), np.zeros((0, keypoints))
        self.evidence = np.zeros((wearers, 0))
        self._gap_from, self._gap = np.zeros(0, int), np.zeros((0, 0))
        self._next = 0

    def link(self, time: float, rays: Array, weight: Array) -> np.ndarray:
        """Link persons ``(N, K, 2)`` to tracks, or begin new ones: rows ``(N,)``, which then end at this frame."""
        lifetime_s = 1.0  # lifetime of an ended track: frames within the lag may be associated again
        kept = self.time >= time - lifetime_s
        if not kept.all():
            self.number, self.time, self.evidence = self.number[kept], self.time[kept], self.evidence[..., kept]
            self.rays, self.weight = self.rays[kept], self.weight[kept]
        row = np.full(len(rays), -1)
        evidence = np.zeros((len(self.evidence), len(rays)))
        open_ends = np.flatnonzero(self.time >= time - LONGEST_GAP_S - STILL_THE_SAME_S)
        self._gap_from, self._gap = self.number[open_ends], np.zeros((len(open_ends), len(rays)))
        if len(open_ends) and len(rays):
            self._continue(open_ends, row, evidence, rays, weight)
        fresh = np.flatnonzero(row < 0)
        if len(fresh):
            row[fresh] = len(self.number) + np.arange(len(fresh))
            self.number = np.append(self.number, self._next + np.arange(len(fresh)))
            self._next += len(fresh)
            self.time = np.append(self.time, np.zeros(len(fresh)))
            self.rays, self.weight = (
                np.concatenate([self.rays, rays[fresh]]),
                np.concatenate([self.weight, weight[fresh]]),
            )
            self.evidence = np.concatenate([self.evidence, evidence[..., fresh]], axis=1)
        self.rays[row], self.weight[row], self.time[row] = rays, weight, time
        return row

    def _continue(self, open_ends: np.ndarray, row: np.ndarray, evidence: Array, rays: Array, weight: Array) -> None:
        """Fill in the rows of unambiguous continuations, and the evidence inherited by ambiguous ones."""
        # Share of the evidence that remains after each frame in which people could have been exchanged
        uncertain = 0.5
        self._gap = gap = image_gap(self.rays[open_ends], rays, self.weight[open_ends], weight)
        near = np.sort(gap, axis=1)[:, :2], np.sort(gap, axis=0)[:2]
        for a, b in zip(*linear_sum_assignment(np.minimum(gap, 10 * FURTHEST)), strict=True):
            if gap[a, b] >= FURTHEST:
                continue
            # The second of a row or column is a rival; if another is even nearer, that one is.
            rivals = near[0][a], near[1][:, b]
            if all(len(rival) < 2 or rival[1] > RIVAL * gap[a, b] for rival in rivals):
                row[b] = open_ends[a]
            else:
                evidence[..., b] = uncertain * self.evidence[..., open_ends[a]]

    def gap(self, number: np.ndarray) -> Array:
        """:func:`image_gap` from the open ends of tracks by number ``(M,)`` to the persons linked last."""
        return self._gap[np.searchsorted(self._gap_from, number)]

    def accumulate(self, row: np.ndarray, log_odds: Array, elapsed: float) -> None:
        """Add the log-odds ``(W, N)`` of one more frame to tracks ``row``, after ``elapsed`` seconds."""
        share = 1 - np.exp(-max(elapsed, 0.0) / self.memory_s)
        self.evidence[..., row] += share * (log_odds - self.evidence[..., row])

    def evidence_of(self, number: np.ndarray) -> Array:
        """Evidence ``(W, ...)`` of tracks by number; zero for a track that is not remembered."""
        if not len(self.number):
            return np.zeros((len(self.evidence), *number.shape))
        place = np.minimum(np.searchsorted(self.number, number), len(self.number) - 1)
        return np.where(self.number[place] == number, self.evidence[:, place], 0.0)
