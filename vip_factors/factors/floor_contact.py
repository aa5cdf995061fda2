"""Floor contact: a foot that bears the body stands on the floor. Without it a whole scene may tilt unnoticed."""

from dataclasses import dataclass, field

import gtsam
import numpy as np

from vip_factors.body.skeleton import Skeleton, ancestors
from vip_factors.factors.adapter import custom_factor
from vip_factors.factors.chain import FrameKeys, chain_state, split_blocks
from vip_factors.factors.robust import Loss, RobustLoss
from vip_factors.geometry.rotations import Array


@dataclass(frozen=True)
class FloorContactSettings:
    """How level the floor is."""

    use: bool = True  # off for slopes and stairs, where it only costs: a robust loss lets a storey go, not a ramp
    sigma: float = 0.15  # m: 3–5 cm of soles, carpets and late contacts, which last: not so many independent facts
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.CAUCHY, 2.0))  # a step or a chair must let go


def floor_contact_residual(p_world_contact: Array) -> Array:
    """Height ``(..., 1)`` in metres of a contact point, ``(..., 3)``, over the floor at z = 0."""
    return p_world_contact[..., 2:]


def floor_contact_factor(
    skeleton: Skeleton, keys: FrameKeys, bone: int, p_bone_point: Array, confidence: float,
    settings: FloorContactSettings,
) -> gtsam.CustomFactor:  # fmt: skip
    """The GTSAM factor of one contact point in one frame, on its chain of joints and its root.

    ``confidence`` in (0, 1] divides the variance.
    """

    def evaluate(values: gtsam.Values) -> tuple[Array, list[Array]]:
        body = chain_state(skeleton, values, keys, bone, with_root=True)
        _, by_joints = body.point_jacobian(bone, p_bone_point)
        residual = floor_contact_residual(body.point(bone, p_bone_point))[0]
        return residual, [*split_blocks(by_joints[:, :, 2:]), np.eye(3)[2:]]

    noise = settings.loss.noise_model(np.full(1, settings.sigma / np.sqrt(confidence)))
    return custom_factor(
        "floor contact", noise, [*keys.chain(bone), keys.root], [3] * (len(ancestors(bone)) + 1), evaluate
    )
