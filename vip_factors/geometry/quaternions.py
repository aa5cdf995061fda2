"""Quaternions, which live only at the edges: files, messages, viewers. Their storage order is said in every call."""

from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike

from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array, exp, log, transpose

# A quaternion further than this from unit length is not a rounded rotation but a mistake.
UNIT_TOLERANCE = 0.05


class Order(StrEnum):
    """Where the scalar part stands."""

    WXYZ = "wxyz"
    XYZW = "xyzw"


def matrix_from_quaternion(quaternion: ArrayLike, order: Order | str) -> Array:
    """Rotation matrices ``(..., 3, 3)`` of quaternions ``(..., 4)`` in the given order, normalised first.

    Raises:
        InputError: where a quaternion is not of unit length within 5 %, or not finite; for an unknown order.
    """
    q = np.asarray(quaternion, dtype=float)
    norm = np.linalg.norm(q, axis=-1)
    bad = ~(np.abs(norm - 1) < UNIT_TOLERANCE)
    if np.any(bad):
        where = tuple(int(i) for i in np.argwhere(bad)[0]) if q.ndim > 1 else 0
        raise InputError(
            f"quaternion {where} is {q[bad][0] if q.ndim > 1 else q}: expected unit length (within 5 %); "
            "check the columns and their order"
        )
    q = q / norm[..., None]
    w, x, y, z = np.moveaxis(q if _scalar_first(order) else np.roll(q, 1, axis=-1), -1, 0)
    R = np.empty((*q.shape[:-1], 3, 3))
    R[..., 0, 0], R[..., 0, 1], R[..., 0, 2] = (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y))
    R[..., 1, 0], R[..., 1, 1], R[..., 1, 2] = (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x))
    R[..., 2, 0], R[..., 2, 1], R[..., 2, 2] = (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y))
    return R


def quaternion_from_matrix(R: ArrayLike, order: Order | str) -> Array:
    """Unit quaternions ``(..., 4)`` in the given order, scalar part not negative, of rotations ``(..., 3, 3)``.

    Raises:
        InputError: for an unknown order.
    """
    w, v = _quaternion_parts(np.asarray(R, dtype=float))
    parts = [w[..., None], v] if _scalar_first(order) else [v, w[..., None]]
    return np.concatenate(parts, axis=-1)


def _scalar_first(order: Order | str) -> bool:
    """Whether the scalar part stands first; a plain string of the same letters is taken too."""
    if order not in list(Order):
        raise InputError(f"order of a quaternion '{order}': expected {' or '.join(Order)}")
    return order == Order.WXYZ


def interpolate_rotations(time: ArrayLike, R: ArrayLike, query: ArrayLike) -> Array:
    """Spherical linear interpolation of rotations ``(N, 3, 3)`` at ``time`` ``(N,)`` to ``query`` ``(M,)``.

    Queries outside the range take the nearest end.
    """
    time, R, query = np.asarray(time, float), np.asarray(R, float), np.asarray(query, float)
    if len(time) == 1:
        return np.repeat(R, len(query), axis=0)
    left = np.clip(np.searchsorted(time, query, side="right") - 1, 0, len(time) - 2)
    fraction = np.clip((query - time[left]) / (time[left + 1] - time[left]), 0.0, 1.0)
    step = log(transpose(R[left]) @ R[left + 1])
    return R[left] @ exp(fraction[:, None] * step)


def interpolate_points(time: ArrayLike, points: ArrayLike, query: ArrayLike) -> Array:
    """Linear interpolation of points ``(N, D)`` at ``time`` ``(N,)`` to ``query`` ``(M,)``: ``(M, D)``.

    Queries outside the range take the nearest end.
    """
    time, points, query = np.asarray(time, float), np.asarray(points, float), np.asarray(query, float)
    return np.stack([np.interp(query, time, column) for column in points.T], axis=1)


def continuous(q: Array) -> Array:
    """Quaternions ``(N, ..., 4)`` of either order with signs like those before them: the same rotations."""
    turned = np.sum(q[1:] * q[:-1], axis=-1, keepdims=True) < 0
    return np.concatenate([q[:1], q[1:] * np.cumprod(np.where(turned, -1.0, 1.0), axis=0)])


def interpolate_smoothly(time: ArrayLike, R: ArrayLike, query: ArrayLike) -> Array:
    """Rotations ``(N, ..., 3, 3)`` at ``time`` ``(N,)``, smoothly to ``query`` ``(M,)``: angular rates have no steps.

    A cubic spline through unit quaternions of like sign, normalised. Queries outside the range take the nearest end.
    """
    time, query = np.asarray(time, float), np.asarray(query, float)
    q = continuous(quaternion_from_matrix(R, Order.WXYZ))
    from scipy.interpolate import make_interp_spline  # takes a fifth of a second, which info need not wait for

    found = make_interp_spline(time, q, k=min(3, len(time) - 1))(np.clip(query, time[0], time[-1]))
    return matrix_from_quaternion(found / np.linalg.norm(found, axis=-1, keepdims=True), Order.WXYZ)


def _outer_of_matrix() -> tuple[Array, Array]:
    """``(16, 9)`` and ``(16,)`` that make 4 q qᵀ of a rotation, both row by row."""
    of_matrix, constant = np.zeros((4, 4, 3, 3)), np.eye(4)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        of_matrix[0, 0, i, i] = of_matrix[i + 1, i + 1, i, i] = 1.0
        of_matrix[i + 1, i + 1, [j, k], [j, k]] = -1.0
        of_matrix[[0, i + 1], [i + 1, 0], k, j], of_matrix[[0, i + 1], [i + 1, 0], j, k] = 1.0, -1.0
        of_matrix[[j + 1, k + 1], [k + 1, j + 1], j, k] = of_matrix[[j + 1, k + 1], [k + 1, j + 1], k, j] = 1.0
    return of_matrix.reshape(16, 9), constant.ravel()


_OF_MATRIX, _CONSTANT = _outer_of_matrix()


def _quaternion_parts(R: Array) -> tuple[Array, Array]:
    """Scalar part ``(...)``, not negative, and vector part ``(..., 3)`` of the unit quaternion of R."""
    # Each column of 4 q qᵀ is q times four times one component; the longest column is the accurate one.
    outer = (R.reshape(-1, 9) @ _OF_MATRIX.T + _CONSTANT).reshape(-1, 4, 4)
    best = np.argmax(outer[:, range(4), range(4)], axis=-1)
    q = outer[np.arange(len(outer)), best]
    q /= np.where(q[:, :1] < 0, -1.0, 1.0) * np.sqrt((q * q).sum(axis=-1, keepdims=True))
    q = q.reshape(*R.shape[:-2], 4)
    return q[..., 0], q[..., 1:]
