"""Gauge prior: IMUs alone see neither where the scene is nor how fast it drifts; somebody has to say."""

from dataclasses import dataclass

from vip_factors.geometry.rotations import Array


@dataclass(frozen=True)
class GaugePriorSettings:
    """What fixes the free translation of an inertial reconstruction."""

    position_sigma: float = 0.01  # m: the first root position is a choice, so any small number does


def gauge_prior_residual(p_world_pelvis: Array, p_world_prior: Array) -> Array:
    """Root position less the chosen one, ``(3,)`` metres. Its derivative is the identity."""
    return p_world_pelvis - p_world_prior
