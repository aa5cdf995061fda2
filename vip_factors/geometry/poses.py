"""SE(3), batched: poses that move on the right by steps ``(rotation, translation)``, as GTSAM's ``Pose3`` does."""

import numpy as np

from vip_factors.geometry.rotations import SMALL_ANGLE, Array, exp, hat, right_jacobian


def retract_pose(R: Array, p: Array, steps: Array) -> tuple[Array, Array]:
    """``T Exp(ξ)`` of poses ``(..., 3, 3)`` and ``(..., 3)`` by steps ``(..., 6)``: the translation turns along."""
    turned = right_jacobian(-steps[..., :3]) @ steps[..., 3:, None]
    return R @ exp(steps[..., :3]), p + (R @ turned)[..., 0]


def pose_right_jacobian(steps: Array) -> Array:
    """``J_r`` with ``Exp(ξ + dξ) ≈ Exp(ξ) Exp(J_r dξ)``, ``(..., 6, 6)``, of steps ``(..., 6)``.

    Barfoot, "State Estimation for Robotics", eqs. 7.85–7.86 (there left, translation first): ``J_r(ξ) = J_l(−ξ)``, with
    SO(3)'s on the diagonal, and below it ``Q``.
    """
    steps = np.asarray(steps, dtype=float)
    J = np.zeros((*steps.shape[:-1], 6, 6))
    J[..., :3, :3] = J[..., 3:, 3:] = right_jacobian(steps[..., :3])
    J[..., 3:, :3] = _translation_by_rotation(-steps[..., :3], -steps[..., 3:])
    return J


def _translation_by_rotation(turn: Array, shift: Array) -> Array:
    """``Q`` ``(..., 3, 3)`` of the left Jacobian."""
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
