"""How well each person in a video frame fits each wearer: the body moved to where its keypoints are seen.

In normalised coordinates a keypoint at ``(u, v)`` and a body point at ``p + t`` agree where ``p_x + t_x = u (p_z + t_z)``
and likewise for y: linear in the translation ``t``. So all wearers and persons of all frames are solved at once, and
the errors come out in metres at the person's depth, as those of the batch association do.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vip_factors.associate.features import FITTING_M, MAJOR_JOINTS
from vip_factors.associate.hypothesis import LEAST_CONFIDENCE, keypoint_sigma
from vip_factors.body.keypoints import KeypointSet
from vip_factors.body.kinematics import BodyState
from vip_factors.body.skeleton import Skeleton
from vip_factors.geometry.rotations import Array
from vip_factors.sensors.camera_model import CameraModel

CAUCHY = 2.0  # sigmas at which a keypoint starts to be doubted: left and right swap, limbs hide
NEAREST_M = 0.5  # depth at least: nobody is whole in the image nearer
FREE_M = 100.0  # sideways the shape may lie anywhere: that is for the position to say
LEAST_WEIGHT = 1e-6
FULL_CONFIDENCE = 0.3  # above the least, from which a keypoint counts fully


@dataclass(frozen=True)
class People:
    """Persons of ``F`` video frames, padded to ``N`` a frame.

    Attributes:
        rays: ``(F, N, K, 2)`` undistorted coordinates at depth one; 0 where the weight is.
        weight: ``(F, N, K)`` confidence; 0 for what is not there or no more than guessed.
        there: ``(F, N)`` whether there is such a person.
    """

    rays: Array
    weight: Array
    there: np.ndarray


@dataclass(frozen=True)
class Fit:
    """All ``(F, W, N)`` pairs of wearers and persons.

    Attributes:
        shape: robust mean of the keypoints' squared errors in sigmas, the body moved to where it fits.
        fitting: how many major joints are near where they should be.
        seen: how many are seen; both count keypoints of little confidence in part.
        position: squared Mahalanobis distance of that move.
    """

    shape: Array
    fitting: Array
    seen: Array
    position: Array


def people_of(pixels: Sequence[Array], confidence: Sequence[Array], model: CameraModel) -> People:
    """Persons of video frames ``(N, K, 2)``, ``(N, K)``, padded to the most crowded frame."""
    F, N = len(pixels), max(len(one) for one in pixels)
    K = pixels[0].shape[1]
    rays, weight, there = np.zeros((F, N, K, 2)), np.zeros((F, N, K)), np.zeros((F, N), bool)
    for f, (seen, sure) in enumerate(zip(pixels, confidence, strict=True)):
        n = len(seen)
        usable = (sure >= LEAST_CONFIDENCE) & np.isfinite(seen).all(axis=-1)
        weight[f, :n] = np.where(usable, np.minimum(sure, 1.0), 0.0)
        rays[f, :n] = np.where(usable[..., None], seen, model.centre)
        there[f, :n] = True
    return People(np.where(weight[..., None] > 0, model.normalise(rays), 0.0), weight, there)


class BodyFitter:
    """The keypoints of some wearers, and what is constant about them.

    Args:
        keypoints: of the detector.
        skeletons: of the ``W`` wearers.
        depth_share: standard deviation of a depth, as a share of it, besides what the caller says: limbs that are
            predicted wrongly look shorter or longer than they are.
        side_m: the like across the view, metres.
    """

    def __init__(
        self, keypoints: KeypointSet, skeletons: Sequence[Skeleton], depth_share: float, side_m: float
    ) -> None:
        places = [keypoints.on_body(skeleton) for skeleton in skeletons]
        names = keypoints.keypoints
        self.known = np.array([[place is not None for place in one] for one in places])
        self.bone = np.array([[0 if place is None else place.bone for place in one] for one in places])
        offsets = [[np.zeros(3) if place is None else place.p_bone_point for place in one] for one in places]
        self.offset = np.array(offsets, dtype=float)
        self.precision = 1 / keypoint_sigma(keypoints) ** 2
        self.major = np.array([name.split("_")[-1] in MAJOR_JOINTS for name in names])
        self.depth_share, self.side_m = depth_share, side_m

    def points(self, bodies: Sequence[BodyState], R_world_camera: Array, p_world_camera: Array) -> Array:
        """Keypoints ``(W, K, 3)`` of one frame in the camera's axes, metres."""
        p_world = np.stack(
            [
                body.p_world_joint[0, bone] + (body.R_world_bone[0, bone] @ offset[:, :, None])[:, :, 0]
                for body, bone, offset in zip(bodies, self.bone, self.offset, strict=True)
            ]
        )
        return (p_world - p_world_camera) @ R_world_camera

    def middle(self, points: Array) -> Array:
        """Mean ``(..., W, 3)`` of known keypoints ``(..., W, K, 3)``."""
        share = self.known / np.maximum(self.known.sum(axis=-1, keepdims=True), 1)
        return np.asarray(np.einsum("...wki,wk->...wi", points, share))

    def fit(self, points: Array, people: People, covariance: Array) -> Fit:
        """Compare everybody with everybody.

        Args:
            points: ``(F, W, K, 3)`` predicted keypoints in the camera's axes.
            people: of the ``F`` frames.
            covariance: ``(F, W, 3, 3)`` m², camera axes, of where the wearer is before the camera.
        """
        w = people.weight[:, None] * self.known[:, None]  # (F, W, N, K)
        total = np.maximum(w.sum(axis=-1), LEAST_WEIGHT)
        centre = self.middle(points)
        depth = np.maximum(centre[..., 2], NEAREST_M)
        local = (points - centre[..., None, :])[:, :, None]  # (F, W, 1, K, 3)
        rays = people.rays[:, None]
        place = np.stack([centre[..., 0], centre[..., 1], depth], axis=-1)
        t, information = self._place(local, rays, w, depth, covariance[..., 2, 2])
        error = self._error(local, rays, t)
        square = np.einsum("fwnki,fwnki->fwnk", error, error)
        scaled = square * self.precision
        shape = np.sum(w * CAUCHY**2 * np.log1p(scaled / CAUCHY**2), axis=-1) / total
        fits = np.exp(-0.5 * square / FITTING_M**2)
        sure = np.clip((w[..., self.major] - LEAST_CONFIDENCE) / FULL_CONFIDENCE, 0, 1)
        moved = t - place[:, :, None]
        slack = self._slack(depth)
        around = covariance[:, :, None] + slack[:, :, None] + np.linalg.inv(information)
        position = np.einsum("fwni,fwni->fwn", moved, np.linalg.solve(around, moved[..., None])[..., 0])
        return Fit(shape, np.sum(sure * fits[..., self.major], axis=-1), sure.sum(axis=-1), position)

    def _slack(self, depth: Array) -> Array:
        diagonal = np.stack([np.full(depth.shape, self.side_m**2)] * 2 + [(self.depth_share * depth) ** 2 / 4], axis=-1)
        return diagonal[..., None] * np.eye(3)

    def _place(self, local: Array, rays: Array, w: Array, depth: Array, depth_variance: Array) -> tuple[Array, Array]:
        """Where the body's middle is for each person ``(F, W, N, 3)``, and the information on it, robustly."""
        prior = 1 / ((self.depth_share * depth) ** 2 + depth_variance)[..., None]
        u2 = np.einsum("fwnki,fwnki->fwnk", rays, rays) + 0 * w
        x, z = local[..., :2], local[..., 2]
        target = rays * z[..., None] - x  # t_xy − u t_z = u z − x
        ut = np.einsum("fwnki,fwnki->fwnk", rays, target)
        each = w * self.precision
        t = np.zeros(0)
        for turn in range(3):
            A = np.zeros((*each.shape[:-1], 3, 3))
            b = np.zeros((*each.shape[:-1], 3))
            total = each.sum(axis=-1)
            mean_u = np.einsum("fwnk,fwnki->fwni", each, rays + 0 * local[..., :2])
            A[..., 0, 0] = A[..., 1, 1] = total + 1 / FREE_M**2
            A[..., :2, 2] = A[..., 2, :2] = -mean_u
            A[..., 2, 2] = np.sum(each * u2, axis=-1) + prior
            b[..., :2] = (each[..., None, :] @ target)[..., 0, :]
            b[..., 2] = prior * depth[..., None] - np.sum(each * ut, axis=-1)
            t = np.linalg.solve(A, b[..., None])[..., 0]
            t[..., 2] = np.maximum(t[..., 2], NEAREST_M)
            if turn < 2:
                error = self._error(local, rays, t)
                square = np.einsum("fwnki,fwnki->fwnk", error, error) * self.precision
                each = w * self.precision / (1 + square / CAUCHY**2)
        return t, A

    @staticmethod
    def _error(local: Array, rays: Array, t: Array) -> Array:
        p = local + t[..., None, :]
        return p[..., :2] - rays * p[..., 2:]
