"""Euler angles, which live only in files: about z, then the new x, then the new y, as BVH files have them."""

import numpy as np

from vip_factors.geometry.rotations import Array

LOCKED = 1e-7  # cosine of the middle angle below which the outer two are one: what was rounded off decides nothing


def zxy_angles(R: Array) -> Array:
    """Angles ``(..., 3)`` in radians about z, x and y with ``R = Rz Rx Ry``, of rotations ``(..., 3, 3)``."""
    cosine = np.hypot(R[..., 2, 0], R[..., 2, 2])
    locked = cosine < LOCKED
    z = np.where(locked, np.arctan2(R[..., 1, 0], R[..., 0, 0]), np.arctan2(-R[..., 0, 1], R[..., 1, 1]))
    y = np.where(locked, 0.0, np.arctan2(-R[..., 2, 0], R[..., 2, 2]))
    return np.stack([z, np.arctan2(R[..., 2, 1], cosine), y], axis=-1)


def without_jumps(angles: Array) -> Array:
    """The same rotations by angles ``(T, ..., 3)`` that follow each other: of a frame's triples the one next to the
    frame before, so that programs which draw curves through the angles do not spin.
    """
    found = np.array(angles, dtype=float)
    for frame in range(1, len(found)):
        before, one = found[frame - 1], found[frame]
        other = np.stack([one[..., 0] + np.pi, np.pi - one[..., 1], one[..., 2] + np.pi], axis=-1)
        one, other = (near + 2 * np.pi * np.round((before - near) / (2 * np.pi)) for near in (one, other))
        nearer = np.abs(other - before).sum(axis=-1) < np.abs(one - before).sum(axis=-1)
        found[frame] = np.where(nearer[..., None], other, one)
    return found
