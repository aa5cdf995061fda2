"""SE(3), batched: retraction on the right as GTSAM's ``Pose3`` does, and alignment of point sets."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from vip_factors.compiled import compiled
from vip_factors.geometry.rotations import SMALL_ANGLE, Array, exp, hat, nearest_rotation, right_jacobian, rotation_z


def retract_pose(R: Array, p: Array, steps: Array) -> tuple[Array, Array]:
    """Retract poses ``(..., 3, 3)`` and ``(..., 3)`` by steps ``(..., 6)``, rotation first: ``T Exp(ξ)``."""
    turned = right_jacobian(-steps[..., :3]) @ steps[..., 3:, None]
    return R @ exp(steps[..., :3]), p + (R @ turned)[..., 0]


@compiled((6,), (6, 6))
def pose_right_jacobian(steps: ArrayLike) -> Array:
    """Right Jacobian ``(..., 6, 6)`` at steps ``(..., 6)``: ``Exp(ξ + dξ) ≈ Exp(ξ) Exp(J_r dξ)``.

    Barfoot, "State Estimation for Robotics", eqs. 7.85–7.86 (left Jacobian, translation first): ``J_r(ξ) = J_l(−ξ)``,
    with that of SO(3) on the diagonal and ``Q`` below it.
    """
    steps = np.asarray(steps, dtype=float)
    J = np.zeros((*steps.shape[:-1], 6, 6))
    J[..., :3, :3] = J[..., 3:, 3:] = right_jacobian(steps[..., :3])
    J[..., 3:, :3] = _translation_by_rotation(-steps[..., :3], -steps[..., 3:])
    return J


def _translation_by_rotation(turn: Array, shift: Array) -> Array:
    """Block ``Q`` ``(..., 3, 3)`` of the left Jacobian."""
    square = np.sum(turn * turn, axis=-1)[..., None, None]
    small = square < SMALL_ANGLE**2
    angle = np.where(small, 1.0, np.sqrt(square))
    a = np.where(small, 1 / 6 - square / 120, (angle - np.sin(angle)) / angle**3)
    b = np.where(small, 1 / 24 - square / 720, (angle**2 / 2 + np.cos(angle) - 1) / angle**4)
    c = np.where(small, 1 / 120 - square / 2520, 0.5 * (b + 3 * (angle - np.sin(angle) - angle**3 / 6) / angle**5))
    P, S = hat(turn), hat(shift)
    PS, SP = P @ S, S @ P
    PSP = PS @ P
    return S / 2 + a * (PS + SP + PSP) + b * (P @ PS + SP @ P - 3 * PSP) + c * (PSP @ P + P @ PSP)


@dataclass(frozen=True)
class Alignment:
    """Similarity ``target ≈ scale · R_target_source @ source + p_target_source``; stacks have leading axes."""

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
