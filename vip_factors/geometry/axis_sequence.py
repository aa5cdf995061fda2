"""Rotations as three successive turns about axes, each in the frame that the turns before it made."""

import numpy as np

from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array, rotation_x, rotation_y, rotation_z, wrap_angle

_ABOUT = {"x": rotation_x, "y": rotation_y, "z": rotation_z}
# Below this sine or cosine of the middle angle only a sum or difference of the outer two is determined.
_LOCKED = 1e-9


def rotation_of_sequence(angles: Array, axes: str) -> Array:
    """Rotations ``(..., 3, 3)`` of angles ``(..., 3)`` in radians: of ``"zxy"``, ``Rz(a) Rx(b) Ry(c)``."""
    first, middle, last = _checked(axes)
    angles = np.asarray(angles, dtype=float)
    return _ABOUT[first](angles[..., 0]) @ _ABOUT[middle](angles[..., 1]) @ _ABOUT[last](angles[..., 2])


def sequence_of_rotation(R: Array, axes: str) -> Array:
    """Angles ``(..., 3)`` in radians of rotations ``(..., 3, 3)``; the inverse of :func:`rotation_of_sequence`.

    The middle angle lies in [−π/2, π/2] of three different axes, and in [0, π] where the first axis comes again; the
    outer ones in (−π, π]. At the ends of the middle one's range they cannot be told apart: the last is then zero.

    Raises:
        InputError: for other axes than three of x, y, z of which neighbours differ.
    """
    first, middle, last = _checked(axes)
    R = np.asarray(R, dtype=float)
    i, j = "xyz".index(first), "xyz".index(middle)
    k = 3 - i - j
    sign = 1.0 if (j - i) % 3 == 1 else -1.0
    if last == first:  # R = R_i(a) R_j(b) R_i(c): its row i and column i hold sin b times a sine or a cosine
        sine = np.hypot(R[..., i, j], R[..., i, k])
        b = np.arctan2(sine, R[..., i, i])
        a = np.arctan2(R[..., j, i], -sign * R[..., k, i])
        c = np.arctan2(R[..., i, j], sign * R[..., i, k])
        locked = sine < _LOCKED
    else:
        cosine = np.hypot(R[..., i, i], R[..., i, j])
        b = np.arctan2(sign * R[..., i, k], cosine)
        a = np.arctan2(-sign * R[..., j, k], R[..., k, k])
        c = np.arctan2(-sign * R[..., i, j], R[..., i, i])
        locked = cosine < _LOCKED
    a = np.where(locked, np.arctan2(sign * R[..., k, j], R[..., j, j]), a)
    return np.stack([a, b, np.where(locked, 0.0, c)], axis=-1)


def continuous(angles: Array) -> Array:
    """The same rotations by angles ``(T, ..., 3)`` about three different axes, each frame's next to the frame before.

    Every rotation has two triples, ``(a, b, c)`` and ``(a + π, π − b, c + π)``, and each angle any number of turns.
    """
    one = np.asarray(angles, dtype=float)
    other = one * [1.0, -1.0, 1.0] + np.pi
    same, across = (np.abs(wrap_angle(to[1:] - one[:-1])).sum(axis=-1, keepdims=True) for to in (one, other))
    changes = np.zeros((*one.shape[:-1], 1), dtype=int)  # from one triple to the other: back is as far
    changes[1:] = across < same
    return np.unwrap(np.where(np.cumsum(changes, axis=0) % 2 == 1, other, one), axis=0)


def _checked(axes: str) -> tuple[str, ...]:
    if len(axes) != 3 or set(axes) - set("xyz") or axes[0] == axes[1] or axes[1] == axes[2]:
        raise InputError(f"axes '{axes}': expected three of x, y, z, no two neighbours the same, such as 'zxy'")
    return tuple(axes)
