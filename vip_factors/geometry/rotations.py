"""SO(3), batched: exponential, logarithm and right Jacobians, with their near-identity branches.

All functions take stacks: rotation vectors are ``(..., 3)`` in radians, matrices ``(..., 3, 3)``. Perturbations
act on the right, ``R Exp(δ)``, as GTSAM's ``Rot3.retract`` does. Formulas: Solà, Deray, Atchuthan, "A micro Lie
theory for state estimation in robotics", eqs. 132–146.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# Below this angle the closed forms lose digits to cancellation and their series, cut after the quartic term, is exact.
SMALL_ANGLE = 1e-2


def hat(v: ArrayLike) -> Array:
    """Skew-symmetric matrices ``(..., 3, 3)`` with ``hat(v) @ w == cross(v, w)``, from vectors ``(..., 3)``."""
    v = np.asarray(v, dtype=float)
    matrix = np.zeros((*v.shape, 3))
    matrix[..., 0, 1], matrix[..., 0, 2] = -v[..., 2], v[..., 1]
    matrix[..., 1, 0], matrix[..., 1, 2] = v[..., 2], -v[..., 0]
    matrix[..., 2, 0], matrix[..., 2, 1] = -v[..., 1], v[..., 0]
    return matrix


def _series(angle: Array, closed: Array, coefficients: tuple[float, float, float]) -> Array:
    square = angle * angle
    series = coefficients[0] + square * (coefficients[1] + square * coefficients[2])
    return np.where(angle < SMALL_ANGLE, series, closed)


def _sine_terms(angle: Array) -> tuple[Array, Array, Array]:
    """``sin θ/θ``, ``(1 − cos θ)/θ²`` and ``(θ − sin θ)/θ³``."""
    safe = np.where(angle < SMALL_ANGLE, 1.0, angle)
    sine, half_sine = np.sin(safe), np.sin(safe / 2)
    a = _series(angle, sine / safe, (1.0, -1 / 6, 1 / 120))
    b = _series(angle, 2 * half_sine**2 / safe**2, (0.5, -1 / 24, 1 / 720))
    c = _series(angle, (safe - sine) / safe**3, (1 / 6, -1 / 120, 1 / 5040))
    return a, b, c


def exp(rotation_vector: ArrayLike) -> Array:
    """Rotation matrices ``(..., 3, 3)`` of rotation vectors ``(..., 3)`` in radians (Rodrigues; thesis eq. 2.13)."""
    v = np.asarray(rotation_vector, dtype=float)
    a, b, _ = _sine_terms(np.linalg.norm(v, axis=-1))
    K = hat(v)
    return np.eye(3) + a[..., None, None] * K + b[..., None, None] * (K @ K)


def log(R: ArrayLike) -> Array:
    """Rotation vectors ``(..., 3)`` of angle in [0, π] radians, of rotation matrices ``(..., 3, 3)``.

    Accurate at the identity and at half turns: the quaternion of the matrix is found first, by the largest of its
    four components, and its vector part is scaled by ``2 atan2(|v|, w)/|v|``.
    """
    w, v = _quaternion_parts(np.asarray(R, dtype=float))
    sine = np.linalg.norm(v, axis=-1)
    safe = np.where(sine < 1e-12, 1.0, sine)
    scale = np.where(sine < 1e-12, 2.0, 2 * np.arctan2(sine, w) / safe)
    return scale[..., None] * v


def _quaternion_parts(R: Array) -> tuple[Array, Array]:
    """Scalar part ``(...)``, not negative, and vector part ``(..., 3)`` of the unit quaternion of R."""
    trace = np.trace(R, axis1=-2, axis2=-1)
    diagonal = np.diagonal(R, axis1=-2, axis2=-1)
    # Each column of 4 q qᵀ is q times four times one component; the longest column is the accurate one.
    outer = np.empty((*R.shape[:-2], 4, 4))
    outer[..., 0, 0] = 1 + trace
    outer[..., 0, 1:] = outer[..., 1:, 0] = np.stack(
        [R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], axis=-1
    )
    outer[..., 1:, 1:] = R + np.swapaxes(R, -1, -2)
    index = np.arange(3)
    outer[..., index + 1, index + 1] = 1 - trace[..., None] + 2 * diagonal
    best = np.argmax(np.diagonal(outer, axis1=-2, axis2=-1), axis=-1)
    q = np.take_along_axis(outer, best[..., None, None], axis=-1)[..., 0]
    q /= np.linalg.norm(q, axis=-1, keepdims=True)
    q *= np.where(q[..., :1] < 0, -1.0, 1.0)
    return q[..., 0], q[..., 1:]


def right_jacobian(rotation_vector: ArrayLike) -> Array:
    """``J_r`` with ``Exp(v + dv) ≈ Exp(v) Exp(J_r dv)``, ``(..., 3, 3)``; Solà et al. eq. 143."""
    v = np.asarray(rotation_vector, dtype=float)
    _, b, c = _sine_terms(np.linalg.norm(v, axis=-1))
    K = hat(v)
    return np.eye(3) - b[..., None, None] * K + c[..., None, None] * (K @ K)


def inverse_right_jacobian(rotation_vector: ArrayLike) -> Array:
    """``J_r⁻¹`` with ``Log(R Exp(δ)) ≈ Log(R) + J_r⁻¹ δ``, ``(..., 3, 3)``; Solà et al. eq. 144."""
    v = np.asarray(rotation_vector, dtype=float)
    angle = np.linalg.norm(v, axis=-1)
    safe = np.where(angle < SMALL_ANGLE, 1.0, angle)
    half = safe / 2
    # (1 − (θ/2) cot(θ/2))/θ²: finite up to θ < 2π.
    d = _series(angle, (1 - half * np.cos(half) / np.sin(half)) / safe**2, (1 / 12, 1 / 720, 1 / 30240))
    K = hat(v)
    return np.eye(3) + 0.5 * K + d[..., None, None] * (K @ K)


def inverse_left_jacobian(rotation_vector: ArrayLike) -> Array:
    """``J_l⁻¹`` with ``Log(Exp(δ) R) ≈ Log(R) + J_l⁻¹ δ``; it is the transpose of the right one."""
    return np.swapaxes(inverse_right_jacobian(rotation_vector), -1, -2)


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


def angle_between(R_a: ArrayLike, R_b: ArrayLike) -> Array:
    """Geodesic distance in radians, ``(...)``, between stacks of rotations (thesis eq. 2.74)."""
    return np.linalg.norm(log(transpose(R_a) @ np.asarray(R_b, dtype=float)), axis=-1)


def nearest_rotation(matrix: ArrayLike) -> Array:
    """The rotation nearest in Frobenius norm to each 3×3 matrix, by SVD."""
    U, _, Vt = np.linalg.svd(np.asarray(matrix, dtype=float))
    sign = np.sign(np.linalg.det(U @ Vt))
    U = U.copy()
    U[..., :, 2] *= sign[..., None]
    return U @ Vt


def mean_rotation(R: ArrayLike, weights: Array | None = None) -> Array:
    """Chordal mean ``(3, 3)`` of rotations ``(N, 3, 3)``, weighted if asked."""
    return nearest_rotation(np.average(np.asarray(R, dtype=float), axis=0, weights=weights))


def wrap_angle(angle: ArrayLike) -> Array:
    """Angles wrapped into [−π, π)."""
    return (np.asarray(angle, dtype=float) + np.pi) % (2 * np.pi) - np.pi


def yaw_of(R: ArrayLike) -> Array:
    """The angle γ about the vertical for which ``rotation_z(γ)`` is nearest to each rotation."""
    R = np.asarray(R, dtype=float)
    return np.arctan2(R[..., 1, 0] - R[..., 0, 1], R[..., 0, 0] + R[..., 1, 1])
