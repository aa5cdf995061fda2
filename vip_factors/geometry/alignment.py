"""Least-squares alignment of point sets: rigid, with scale, and about the vertical only."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from vip_factors.geometry.rotations import Array, nearest_rotation, rotation_z


@dataclass(frozen=True)
class Alignment:
    """``target ≈ scale · R_target_source @ source + p_target_source``; stacks carry leading axes."""

    R_target_source: Array
    p_target_source: Array
    scale: Array

    def apply(self, points: ArrayLike) -> Array:
        """Move points ``(..., N, 3)`` of the source frame into the target frame."""
        rotated = np.einsum("...ij,...nj->...ni", self.R_target_source, np.asarray(points, dtype=float))
        return self.scale[..., None, None] * rotated + self.p_target_source[..., None, :]


def _centred(source: ArrayLike, target: ArrayLike) -> tuple[Array, Array, Array, Array]:
    source, target = np.asarray(source, dtype=float), np.asarray(target, dtype=float)
    mean_source, mean_target = source.mean(axis=-2), target.mean(axis=-2)
    return source - mean_source[..., None, :], target - mean_target[..., None, :], mean_source, mean_target


def _compose(R: Array, scale: Array, mean_source: Array, mean_target: Array) -> Alignment:
    moved = scale[..., None] * np.einsum("...ij,...j->...i", R, mean_source)
    return Alignment(R, mean_target - moved, scale)


def align_rigid(source: ArrayLike, target: ArrayLike) -> Alignment:
    """Rotation and translation taking points ``(..., N, 3)`` onto target in the least-squares sense (Kabsch)."""
    s, t, mean_source, mean_target = _centred(source, target)
    R = nearest_rotation(np.einsum("...ni,...nj->...ij", t, s))
    return _compose(R, np.ones(R.shape[:-2]), mean_source, mean_target)


def align_similarity(source: ArrayLike, target: ArrayLike) -> Alignment:
    """Rotation, translation and scale, as :func:`align_rigid` with scale (Umeyama 1991)."""
    s, t, mean_source, mean_target = _centred(source, target)
    covariance = np.einsum("...ni,...nj->...ij", t, s)
    R = nearest_rotation(covariance)
    spread = np.sum(s * s, axis=(-1, -2))
    scale = np.einsum("...ij,...ij->...", R, covariance) / np.where(spread > 0, spread, 1.0)
    return _compose(R, scale, mean_source, mean_target)


def align_yaw(source: ArrayLike, target: ArrayLike) -> Alignment:
    """Rotation about the vertical (z) and translation: the gauge of an inertial reconstruction."""
    s, t, mean_source, mean_target = _centred(source, target)
    cosine = np.sum(s[..., 0] * t[..., 0] + s[..., 1] * t[..., 1], axis=-1)
    sine = np.sum(s[..., 0] * t[..., 1] - s[..., 1] * t[..., 0], axis=-1)
    R = rotation_z(np.arctan2(sine, cosine))
    return _compose(R, np.ones(R.shape[:-2]), mean_source, mean_target)
