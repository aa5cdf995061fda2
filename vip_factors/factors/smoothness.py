"""Smoothness: joints that no sensor sees turn no faster than people turn them.

Six sensors leave thighs, upper arms and the trunk free between two poses that fit. Acceleration ties them together
over time, but its noise, summed twice, lets them wander; a Gaussian over their speed holds them.
"""

from dataclasses import dataclass

import gtsam
import numpy as np

from vip_factors.body.pose_prior import PosePrior
from vip_factors.factors.adapter import custom_factor
from vip_factors.factors.chain import FrameKeys
from vip_factors.geometry.rotations import Array, inverse_right_jacobian, log, transpose

JOINTS = range(1, 24)


@dataclass(frozen=True)
class SmoothnessSettings:
    """How fast joints turn."""

    use: bool = True  # without it six sensors lose a third more: see the changelog
    # s in which a joint crosses one standard deviation of the pose prior, at one standard deviation of its speed.
    time: float = 0.07


def smoothness_residual(
    R_parent_child: Array, R_parent_child_after: Array, step: float, prior: PosePrior, settings: SmoothnessSettings
) -> Array:
    """``time · L Log(R(t)ᵀ R(t+1)) / step``, whitened, ``(T, 69)``.

    The Gaussian is the pose prior's, ``Σ⁻¹ = Lᵀ L``, of rotation over a time instead of from the mean: joints that
    deviate together turn together. Rotations are ``(T, 23, 3, 3)``, of joints 1 … 23; the difference is taken on the
    group, for rotation vectors jump at half a turn.
    """
    turn = log(transpose(R_parent_child) @ R_parent_child_after)
    return settings.time / step * turn.reshape(len(turn), -1) @ prior.whitening.T


def turn_jacobians(turn: Array) -> tuple[Array, Array]:
    """Derivatives of ``Log(R(t)ᵀ R(t+1))`` ``(..., 3)`` by the rotation now and the one after, ``(..., 3, 3)``."""
    right = inverse_right_jacobian(turn)
    return -transpose(right), right  # the left one is the transpose


def smoothness_factor(
    now: FrameKeys, after: FrameKeys, step: float, prior: PosePrior, settings: SmoothnessSettings
) -> gtsam.CustomFactor:
    """The GTSAM factor on joints 1 … 23 of two consecutive frames."""
    keys = [[frame.joints[joint] for joint in JOINTS] for frame in (now, after)]
    L = (settings.time / step * prior.whitening).reshape(69, 23, 3).swapaxes(0, 1)

    def evaluate(values: gtsam.Values) -> tuple[Array, list[Array]]:
        R, R_after = (np.stack([values.atRot3(key).matrix() for key in frame])[None] for frame in keys)
        blocks = [block for J in turn_jacobians(log(transpose(R) @ R_after)[0]) for block in L @ J]
        return smoothness_residual(R, R_after, step, prior, settings)[0], blocks

    return custom_factor("smoothness", gtsam.noiseModel.Unit.Create(69), [*keys[0], *keys[1]], [3] * 46, evaluate)
