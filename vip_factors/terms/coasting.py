"""Coasting: what ties a wearer's root where nothing was measured, so that a silence of the sensors can be bridged.

The pelvis hangs on its neighbours in time by what sensors measure alone. Where no accelerometer says anything, nothing
else says where the root is; where no sensor says how it is turned, nothing else says which way the wearer faces. There,
and only there, two broad priors hold: a root that keeps its velocity, and a pelvis that stays turned as it was.
"""

from dataclasses import dataclass

import numpy as np

from vip_factors.geometry.rotations import Array, log, transpose
from vip_factors.terms.smoothness import turn_jacobians

DIFFERENCE = np.array([1.0, -2.0, 1.0])  # of positions before, now and after: their acceleration, times step²


@dataclass(frozen=True)
class CoastingSettings:
    """How a root goes on unseen; broad priors, which only matter where nothing was measured."""

    use: bool = True  # without it, a frame in which no sensor measured has no solution
    # m/s², each axis: the pelvis of somebody who walks peaks at 3–5 (up and down, and at every heel strike); who runs
    # exceeds it, for a fraction of a step.
    acceleration_sigma: float = 5.0
    turn_sigma: float = 3.0  # rad/s, each axis: a brisk turn on the spot, half a turn in a second


def root_coasting_residual(p_before: Array, p_now: Array, p_after: Array, step: float) -> Array:
    """Acceleration ``(p(t−1) − 2 p(t) + p(t+1))/step²`` of the root ``(..., 3)``, m/s², world axes.

    Its derivatives are ``DIFFERENCE / step²``, each times the identity.
    """
    return (p_before - 2 * p_now + p_after) / step**2


def pelvis_turn_residual(R_world_pelvis: Array, R_world_pelvis_after: Array, step: float) -> Array:
    """Mean angular velocity ``Log(R(t)ᵀ R(t+1))/step``, ``(..., 3)`` rad/s, in the pelvis's axes."""
    return log(transpose(R_world_pelvis) @ R_world_pelvis_after) / step


def pelvis_turn_jacobians(residual: Array, step: float) -> tuple[Array, Array]:
    """Derivatives of :func:`pelvis_turn_residual` by the rotation now and the one after, ``(..., 3, 3)``."""
    by_now, by_after = turn_jacobians(residual * step)
    return by_now / step, by_after / step
