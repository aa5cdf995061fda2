"""Foot contact: a foot that bears the body does not move. It is what keeps an inertial root path from running away.

Linear in the two positions: derivatives ``−1/step`` and ``1/step``, each times the identity.
"""

from dataclasses import dataclass, field

from vip_factors.geometry.rotations import Array
from vip_factors.terms.robust import Loss, RobustLoss


@dataclass(frozen=True)
class FootContactSettings:
    """How still a foot in contact is."""

    use: bool = True  # without it only accelerations place the root, and it drifts by metres in a minute
    sigma: float = 0.15  # m/s: the rolling ankle of a planted foot, and contacts found a frame late
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.CAUCHY, 2.0))  # a wrong contact must let go


def foot_contact_residual(p_now: Array, p_after: Array, step: float) -> Array:
    """Velocity of a contact point between two frames, ``(..., 3)`` m/s, from its positions ``(..., 3)`` in metres."""
    return (p_after - p_now) / step
