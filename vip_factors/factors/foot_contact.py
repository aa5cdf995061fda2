"""Foot contact: a foot that bears the body does not move. It is what keeps an inertial root path from running away."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import gtsam
import numpy as np

from vip_factors.body.skeleton import Skeleton, ancestors
from vip_factors.factors.adapter import custom_factor
from vip_factors.factors.chain import FrameKeys, chain_state, split_blocks
from vip_factors.factors.robust import Loss, RobustLoss
from vip_factors.geometry.rotations import Array


@dataclass(frozen=True)
class FootContactSettings:
    """How still a foot in contact is."""

    use: bool = True  # without it only accelerations place the root, and it drifts by metres in a minute
    sigma: float = 0.15  # m/s: the rolling ankle of a planted foot, and contacts found a frame late
    loss: RobustLoss = field(default_factory=lambda: RobustLoss(Loss.CAUCHY, 2.0))  # a wrong contact must let go


def foot_contact_residual(p_now: Array, p_after: Array, step: float) -> Array:
    """Velocity of a contact point between two frames, ``(..., 3)`` m/s, from its positions ``(..., 3)`` in metres."""
    return (p_after - p_now) / step


def foot_contact_factor(
    skeleton: Skeleton,
    frames: Sequence[FrameKeys],
    bone: int,
    p_bone_point: Array,
    step: float,
    confidence: float,
    settings: FootContactSettings,
) -> gtsam.CustomFactor:
    """The GTSAM factor of one contact point over two frames, each with its chain of joints and its root.

    ``confidence`` in (0, 1] divides the variance.
    """

    def evaluate(values: gtsam.Values) -> tuple[Array, list[Array]]:
        positions, jacobians = [], []
        for keys, weight in zip(frames, (-1 / step, 1 / step), strict=True):
            body = chain_state(skeleton, values, keys, bone, with_root=True)
            positions.append(body.point(bone, p_bone_point))
            _, by_joints = body.point_jacobian(bone, p_bone_point)
            jacobians += [*split_blocks(weight * by_joints), weight * np.eye(3)]
        return foot_contact_residual(positions[0], positions[1], step)[0], jacobians

    noise = settings.loss.noise_model(np.full(3, settings.sigma / np.sqrt(confidence)))
    keys = [key for frame in frames for key in (*frame.chain(bone), frame.root)]
    return custom_factor("foot contact", noise, keys, [3] * (2 * (len(ancestors(bone)) + 1)), evaluate)
