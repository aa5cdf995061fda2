"""Rotation prior: one rotation near a given one. The mounting prior and the initial-pose prior are both this.

A step on the right stands at the right end of ``R_priorᵀ R``: the derivative is ``J_r⁻¹(r)``.
"""

from dataclasses import dataclass

import numpy as np

from vip_factors.geometry.rotations import Array, log, transpose


@dataclass(frozen=True)
class InitialPoseSettings:
    """How well a declared T- or N-pose is held."""

    sigma_deg: float = 6.0  # per joint and axis; a pose held by eye turns bones by 10–15° (design: careless T-pose)
    seconds: float = 1.0  # of holding still at the start; people do so for a breath at least

    @property
    def sigma(self) -> float:
        """Standard deviation in radians."""
        return float(np.deg2rad(self.sigma_deg))


def rotation_prior_residual(R: Array, R_prior: Array) -> Array:
    """``Log(R_priorᵀ R)``, ``(..., 3)`` rad, in the axes of the rotated frame.

    For a mounting, ``R_bone_sensor`` against the placement's (the papers' eq. 4.7, made soft); for the initial pose,
    each ``R_parent_child`` against the declared one.
    """
    return log(transpose(R_prior) @ R)
