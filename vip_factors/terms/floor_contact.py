"""Floor contact: a foot that bears the body stands on the floor. Without it a whole scene may tilt unnoticed.

Its derivative by the point is the row ``e_zᵀ``.
"""

from dataclasses import dataclass, field

from vip_factors.geometry.rotations import Array
from vip_factors.terms.robust import Loss, RobustLoss


@dataclass(frozen=True)
class FloorContactSettings:
    """How level the floor is."""

    use: bool = True  # off for slopes and stairs, where it only costs: a robust loss lets a storey go, not a ramp
    sigma: float = 0.15  # m: 3–5 cm of soles, carpets and late contacts, which last: not so many independent facts
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.CAUCHY, 2.0))  # a step or a chair must let go


def floor_contact_residual(p_world_contact: Array) -> Array:
    """Height ``(..., 1)`` in metres of a contact point, ``(..., 3)``, over the floor at z = 0."""
    return p_world_contact[..., 2:]
