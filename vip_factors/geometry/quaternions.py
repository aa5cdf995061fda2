"""Conversion of quaternions in files, messages and viewers, with explicit storage order; interpolation."""

from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike

from vip_factors.errors import InputError
from vip_factors.geometry.rotations import Array, exp, log, transpose

UNIT_TOLERANCE = 0.05  # deviation from unit length beyond which a quaternion is an error


class Order(StrEnum):
    """Storage order of quaternions."""

    WXYZ = "wxyz"
    XYZW = "xyzw"


def matrix_from_quaternion(quaternion: ArrayLike, order: Order | str) -> Array:
    """Rotation matrices ``(..., 3, 3)`` of quaternions ``(..., 4)``, which are normalised first.

    Raises:
        InputError: if a quaternion is not finite or not of unit length within 5 %; for an unknown order.
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
    """Unit quaternions ``(..., 4)``, scalar part not negative, of rotations ``(..., 3, 3)``.

    Raises:
        InputError: for an unknown order.
    """
    w, v = _quaternion_parts(np.asarray(R, dtype=float))
    components = [w[..., None], v] if _scalar_first(order) else [v, w[..., None]]
    return np.concatenate(components, axis=-1)


def _scalar_first(order: Order | str) -> bool:
    """True if the scalar part comes first."""
    if order not in list(Order):
        raise InputError(f"quaternion order '{order}': expected {' or '.join(Order)}")
    return order == Order.WXYZ


def interpolate_rotations(time: ArrayLike, R: ArrayLike, query: ArrayLike) -> Array:
    """Spherical linear interpolation of rotations ``(N, 3, 3)`` at ``time`` ``(N,)`` to ``query`` ``(M,)``.

    Queries outside the range take the nearest end.
    """
    time, R, query = np.asarray(time, float), np.asarray(R, float), np.asarray(query, float)
    if len(time) == 1:
        return np.repeat(R, len(query), axis=0)
    index = np.clip(np.searchsorted(time, query, side="right") - 1, 0, len(time) - 2)
    fraction = np.clip((query - time[index]) / (time[index + 1] - time[index]), 0.0, 1.0)
    step = log(transpose(R[index]) @ R[index + 1])
    return R[index] @ exp(fraction[:, None] * step)


def interpolate_points(time: ArrayLike, points: ArrayLike, query: ArrayLike) -> Array:
    """Linear interpolation of points ``(N, D)`` at ``time`` ``(N,)`` to ``query`` ``(M,)``: ``(M, D)``.

    Queries outside the range take the nearest end.
    """
    time, points, query = np.asarray(time, float), np.asarray(points, float), np.asarray(query, float)
    return np.stack([np.interp(query, time, column) for column in points.T], axis=1)


def continuous(q: Array) -> Array:
    """Choose signs of quaternions ``(N, ..., 4)`` of either order such that they are continuous."""
    turned = np.sum(q[1:] * q[:-1], axis=-1, keepdims=True) < 0
    return np.concatenate([q[:1], q[1:] * np.cumprod(np.where(turned, -1.0, 1.0), axis=0)])


def interpolate_smoothly(time: ArrayLike, R: ArrayLike, query: ArrayLike) -> Array:
    """Interpolate rotations ``(N, ..., 3, 3)`` at ``time`` ``(N,)`` to ``query`` ``(M,)`` with continuous rates.

    Normalised cubic spline through unit quaternions. Queries outside the range take the nearest end.
    """
    time, query = np.asarray(time, float), np.asarray(query, float)
    q = continuous(quaternion_from_matrix(R, Order.WXYZ))
    from scipy.interpolate import make_interp_spline  # slow import

    q_query = make_interp_spline(time, q, k=min(3, len(time) - 1))(np.clip(query, time[0], time[-1]))
    return matrix_from_quaternion(q_query / np.linalg.norm(q_query, axis=-1, keepdims=True), Order.WXYZ)


def _outer_of_matrix() -> tuple[Array, Array]:
    """Linear map ``(16, 9)`` and constant ``(16,)`` from a rotation to 4 q qᵀ, both in row order."""
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
    # each column of 4 q qᵀ is a multiple of q; the longest is the most accurate
    outer = (R.reshape(-1, 9) @ _OF_MATRIX.T + _CONSTANT).reshape(-1, 4, 4)
    largest = np.argmax(outer[:, range(4), range(4)], axis=-1)
    q = outer[np.arange(len(outer)), largest]
    q /= np.where(q[:, :1] < 0, -1.0, 1.0) * np.sqrt((q * q).sum(axis=-1, keepdims=True))
    q = q.reshape(*R.shape[:-2], 4)
    return q[..., 0], q[..., 1:]
