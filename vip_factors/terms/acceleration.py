"""Acceleration: the second difference of the sensor's position against what its accelerometer says.

The residual is linear in the three positions, with coefficients ``(1, −2, 1)/step²``, each times the identity; how a
position moves with the joints is the body's (:func:`~vip_factors.body.kinematics.twists_at`). The heading turns the
force alone: ``∂(−Rz(γ) f)/∂γ = −e_z × Rz(γ) f``.
"""

from dataclasses import dataclass, field

import numpy as np

from vip_factors.geometry.rotations import Array, rotation_z
from vip_factors.terms.robust import Loss, RobustLoss

GRAVITY = np.array([0.0, 0.0, -9.81])  # m/s², world
_QUARTER = np.array(
    [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
)  # of rows: what turns about −z, as it sets out


@dataclass(frozen=True)
class AccelerationSettings:
    """How far a model point's acceleration is from its sensor's."""

    # m/s², each row: soft tissue wobbles by 1–3 at the limbs in brisk motion (1.3–2.5 below 8 Hz on a walk with optical
    # reference), less at rest.
    sigma: float = 1.5
    # With six sensors acceleration alone tells where thighs and upper arms are, and is worth its bias: as in the
    # thesis, whose weight of it is larger for SIP (3.4.1) than for VIP (4.4.1).
    sparse_sigma: float = 0.5
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.HUBER, 2.0))  # foot strikes ring the straps


def acceleration_residual(
    p_before: Array, p_now: Array, p_after: Array, step: float, heading: float | Array, specific_force_inertial: Array
) -> Array:
    """Model less measured acceleration, ``(..., 3)`` m/s², world axes (thesis eqs. 4.24–4.26).

    ``(p(t−1) − 2 p(t) + p(t+1))/step² − (Rz(γ) f + g)``, with the positions of the sensor ``(..., 3)`` in metres and
    its specific force ``f`` in its inertial frame, averaged over the triangular window of half-width ``step``.
    """
    return (p_before - 2 * p_now + p_after) / step**2 - _turned(heading, specific_force_inertial) - GRAVITY


def acceleration_by_heading(heading: float | Array, specific_force_inertial: Array) -> Array:
    """Derivative of :func:`acceleration_residual` by the heading, ``(..., 3)`` m/s² per radian."""
    turned = _turned(heading, specific_force_inertial)
    return turned @ _QUARTER


def _turned(heading: float | Array, specific_force_inertial: Array) -> Array:
    return (rotation_z(heading) @ specific_force_inertial[..., None])[..., 0]
