"""SO(3), batched: exponential, logarithm, right Jacobians and Euler sequences.

All functions take stacks: rotation vectors are ``(..., 3)`` in radians, matrices ``(..., 3, 3)``. Perturbations act on
the right, ``R Exp(δ)``, as in GTSAM's ``Rot3.retract``. Formulas: Solà, Deray, Atchuthan, "A micro Lie
theory for state estimation in robotics", eqs. 132–146.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vip_factors.compiled import compiled

Array = NDArray[np.float64]

SMALL_ANGLE = 1e-2  # below it closed forms lose digits, and the series up to the quartic term is exact


# hat(v), trace and skew part as single matrix products: many small operations are slow on few rotations.
_HAT = np.zeros((3, 9))
_HAT[0, 7], _HAT[1, 2], _HAT[2, 3] = 1.0, 1.0, 1.0
_HAT[0, 5], _HAT[1, 6], _HAT[2, 1] = -1.0, -1.0, -1.0
_TRACE_AND_SKEW = np.column_stack([np.eye(3).ravel(), _HAT.T])
_EYE = np.eye(3).ravel()


@compiled((3,), (3, 3))
def hat(v: ArrayLike) -> Array:
    """Skew-symmetric matrices ``(..., 3, 3)`` with ``hat(v) @ w == cross(v, w)``, from vectors ``(..., 3)``."""
    v = np.asarray(v, dtype=float)
    return (v @ _HAT).reshape(*v.shape, 3)


def _square(v: Array) -> Array:
    """Squared lengths ``(..., 1)`` of vectors ``(..., 3)``."""
    return np.einsum("...i,...i->...", v, v)[..., None]


def _combined(v: Array, of_identity: Array, of_hat: Array | float, of_outer: Array) -> Array:
    """``one I + of_hat hat(v) + of_outer v vᵀ`` of vectors ``(..., 3)``; the coefficients are ``(..., 1)``."""
    matrix = ((of_outer * v)[..., :, None] * v[..., None, :]).reshape(*v.shape[:-1], 9)
    matrix += of_identity * _EYE
    matrix += (of_hat * v) @ _HAT
    return matrix.reshape(*v.shape, 3)


def _sine_terms(square: Array) -> tuple[Array, Array, Array]:
    """Compute ``sin θ/θ``, ``(1 − cos θ)/θ²`` and ``(θ − sin θ)/θ³`` from θ²."""
    small = square < SMALL_ANGLE**2
    safe = np.where(small, 1.0, np.sqrt(square))
    sine, half_sine = np.sin(safe), np.sin(safe / 2)
    a = np.where(small, 1 + square * (-1 / 6 + square / 120), sine / safe)
    b = np.where(small, 0.5 + square * (-1 / 24 + square / 720), 2 * half_sine**2 / safe**2)
    c = np.where(small, 1 / 6 + square * (-1 / 120 + square / 5040), (safe - sine) / safe**3)
    return a, b, c


@compiled((3,), (3, 3))
def exp(rotation_vector: ArrayLike) -> Array:
    """Rotation matrices ``(..., 3, 3)`` of rotation vectors ``(..., 3)`` in radians (Rodrigues; thesis eq. 2.13)."""
    v = np.asarray(rotation_vector, dtype=float)
    square = _square(v)
    a, b, _ = _sine_terms(square)
    return _combined(v, 1 - b * square, a, b)  # hat(v)² = v vᵀ − θ² I


@compiled((3, 3), (3,))
def log(R: ArrayLike) -> Array:
    """Rotation vectors ``(..., 3)`` with angles in [0, π] radians of rotation matrices ``(..., 3, 3)``.

    Up to 120° it is the skew part, of length ``sin θ``, scaled to the angle. Beyond, the axis is taken from the
    symmetric part, since the skew part vanishes at half a turn.
    """
    R = np.asarray(R, dtype=float)
    trace_and_skew = R.reshape(*R.shape[:-2], 9) @ _TRACE_AND_SKEW
    trace, skew = trace_and_skew[..., :1], trace_and_skew[..., 1:]
    sine = 0.5 * np.sqrt(_square(skew))
    angle, tiny = np.arctan2(sine, 0.5 * (trace - 1)), sine < 1e-12
    v = np.where(tiny, 0.5, 0.5 * angle / np.where(tiny, 1.0, sine)) * skew
    far = trace[..., 0] < 0
    if far.any():
        v[far] = angle[far] * _axis_of_large(R[far], trace[far], skew[far])
    return v


def _axis_of_large(R: Array, trace: Array, skew: Array) -> Array:
    """Axes ``(n, 3)`` of rotations ``(n, 3, 3)`` by more than a right angle, from ``(1 − cos θ) a aᵀ``.

    The longest column is the most accurate; the sign is that of the skew part.
    """
    outer = R + transpose(R) - (trace - 1)[..., None] * np.eye(3)
    largest = np.argmax(np.einsum("nii->ni", outer), axis=1)
    axis = outer[np.arange(len(R)), largest]
    axis *= np.where(np.sum(axis * skew, axis=1) < 0, -1.0, 1.0)[:, None] / np.sqrt(_square(axis))
    return axis


@compiled((3,), (3, 3))
def right_jacobian(rotation_vector: ArrayLike) -> Array:
    """Right Jacobian ``(..., 3, 3)``: ``Exp(v + dv) ≈ Exp(v) Exp(J_r dv)``; Solà et al. eq. 143."""
    v = np.asarray(rotation_vector, dtype=float)
    square = _square(v)
    _, b, c = _sine_terms(square)
    return _combined(v, 1 - c * square, -b, c)


@compiled((3,), (3, 3))
def inverse_right_jacobian(rotation_vector: ArrayLike) -> Array:
    """Inverse right Jacobian ``(..., 3, 3)``: ``Log(R Exp(δ)) ≈ Log(R) + J_r⁻¹ δ``; Solà et al. eq. 144."""
    v = np.asarray(rotation_vector, dtype=float)
    square = _square(v)
    small = square < SMALL_ANGLE**2
    half = np.where(small, 0.5, 0.5 * np.sqrt(square))
    cotangent = half / np.tan(half)
    of_identity = np.where(small, 1 - square * (1 / 12 + square * (1 / 720 + square / 30240)), cotangent)
    # (1 − (θ/2) cot(θ/2))/θ²: finite up to θ < 2π.
    outer = np.where(small, 1 / 12 + square * (1 / 720 + square / 30240), (1 - cotangent) / np.where(small, 1, square))
    return _combined(v, of_identity, 0.5, outer)


def rotation_x(angle: ArrayLike) -> Array:
    """Rotations about x by ``angle`` radians, ``(..., 3, 3)``."""
    return _about_axis(angle, 0)


def rotation_y(angle: ArrayLike) -> Array:
    """Rotations about y by ``angle`` radians, ``(..., 3, 3)``."""
    return _about_axis(angle, 1)


def rotation_z(angle: ArrayLike) -> Array:
    """Rotations about z, the vertical of the world, by ``angle`` radians, ``(..., 3, 3)``."""
    return _about_axis(angle, 2)


def _about_axis(angle: ArrayLike, axis: int) -> Array:
    angle = np.asarray(angle, dtype=float)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R = np.zeros((*angle.shape, 3, 3))
    R[..., axis, axis] = 1.0
    R[..., i, i] = R[..., j, j] = np.cos(angle)
    R[..., j, i] = np.sin(angle)
    R[..., i, j] = -R[..., j, i]
    return R


def transpose(R: ArrayLike) -> Array:
    """Inverse of rotations: the transpose of the last two axes (a view)."""
    return np.swapaxes(np.asarray(R, dtype=float), -1, -2)


def rotation_between(start: ArrayLike, end: ArrayLike) -> Array:
    """Smallest rotations ``(..., 3, 3)`` that take directions ``(..., 3)`` to others, which must not be opposite."""
    a, b = (np.asarray(v, dtype=float) / np.linalg.norm(v, axis=-1, keepdims=True) for v in (start, end))
    axis = hat(np.cross(a, b))
    return np.eye(3) + axis + axis @ axis / (1 + np.sum(a * b, axis=-1)[..., None, None])


def angle_between(R_a: ArrayLike, R_b: ArrayLike) -> Array:
    """Geodesic distance in radians, ``(...)``, between stacks of rotations (thesis eq. 2.74)."""
    return np.linalg.norm(log(transpose(R_a) @ np.asarray(R_b, dtype=float)), axis=-1)


def nearest_rotation(matrix: ArrayLike) -> Array:
    """Rotation nearest to each 3×3 matrix in Frobenius norm, by SVD."""
    U, _, Vt = np.linalg.svd(np.asarray(matrix, dtype=float))
    sign = np.sign(np.linalg.det(U @ Vt))
    U = U.copy()
    U[..., :, 2] *= sign[..., None]
    return U @ Vt


def mean_rotation(R: ArrayLike, weights: Array | None = None) -> Array:
    """Chordal mean ``(3, 3)`` of rotations ``(N, 3, 3)``, optionally weighted."""
    return nearest_rotation(np.average(np.asarray(R, dtype=float), axis=0, weights=weights))


def wrap_angle(angle: ArrayLike) -> Array:
    """Wrap angles into [−π, π)."""
    return (np.asarray(angle, dtype=float) + np.pi) % (2 * np.pi) - np.pi


def yaw_of(R: ArrayLike) -> Array:
    """Angle γ about the vertical for which ``rotation_z(γ)`` is nearest to each rotation."""
    R = np.asarray(R, dtype=float)
    return np.arctan2(R[..., 1, 0] - R[..., 0, 1], R[..., 0, 0] + R[..., 1, 1])


_LOCKED = 1e-9  # sine or cosine of the middle angle: gimbal lock


def sequence_of_rotation(R: Array, axes: str) -> Array:
    """Euler angles ``(..., 3)`` in radians of rotations ``(..., 3, 3)``; ``"zxy"`` means ``Rz(a) Rx(b) Ry(c)``.

    The middle angle lies in [−π/2, π/2] for three different axes, in [0, π] if the first axis is repeated; the outer
    ones in (−π, π]. In gimbal lock the last angle is zero.
    """
    R = np.asarray(R, dtype=float)
    i, j = "xyz".index(axes[0]), "xyz".index(axes[1])
    k = 3 - i - j
    sign = 1.0 if (j - i) % 3 == 1 else -1.0
    if axes[2] == axes[0]:  # R = R_i(a) R_j(b) R_i(c): its row i and column i hold sin b times a sine or a cosine
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
    """Choose equivalent Euler angles ``(T, ..., 3)`` about three different axes that are continuous over frames.

    Every rotation has two triples, ``(a, b, c)`` and ``(a + π, π − b, c + π)``, each up to full turns.
    """
    triple = np.asarray(angles, dtype=float)
    alternative = triple * [1.0, -1.0, 1.0] + np.pi
    same, across = (
        np.abs(wrap_angle(to[1:] - triple[:-1])).sum(axis=-1, keepdims=True) for to in (triple, alternative)
    )
    changes = np.zeros((*triple.shape[:-1], 1), dtype=int)  # between the two triples
    changes[1:] = across < same
    return np.unwrap(np.where(np.cumsum(changes, axis=0) % 2 == 1, alternative, triple), axis=0)
