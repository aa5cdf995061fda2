"""Gauge prior: IMUs alone see neither where the scene is nor how fast it drifts; somebody has to say."""

from dataclasses import dataclass

import gtsam
import numpy as np

from vip_factors.factors.adapter import custom_factor
from vip_factors.geometry.rotations import Array


@dataclass(frozen=True)
class GaugePriorSettings:
    """What fixes the free translation of an inertial reconstruction."""

    position_sigma: float = 0.01  # m: the first root position is a choice, so any small number does


def gauge_prior_residual(p_world_pelvis: Array, p_world_prior: Array) -> Array:
    """Root position less the chosen one, ``(3,)`` metres. Its derivative is the identity."""
    return p_world_pelvis - p_world_prior


def gauge_prior_factor(root_key: int, p_world_prior: Array, settings: GaugePriorSettings) -> gtsam.CustomFactor:
    """The GTSAM factor on the first frame's root."""

    def evaluate(values: gtsam.Values) -> tuple[Array, list[Array]]:
        return gauge_prior_residual(values.atPoint3(root_key), p_world_prior), [np.eye(3)]

    noise = gtsam.noiseModel.Isotropic.Sigma(3, settings.position_sigma)
    return custom_factor("gauge prior", noise, [root_key], [3], evaluate)
