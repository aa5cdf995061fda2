"""Rotation prior: one rotation near a given one. The mounting prior and the initial-pose prior are both this.

A step on the right stands at the right end of ``R_priorᵀ R``: the derivative is ``J_r⁻¹(r)``.
"""

from dataclasses import dataclass

from vip_factors.body.calibration_pose import HeldPose, held_pose, nominal_pose
from vip_factors.geometry.rotations import Array, log, transpose


@dataclass(frozen=True)
class InitialPoseSettings:
    """How well a declared T- or N-pose is held."""

    scale: float = 0.6  # of the standard deviations measured on two people, joint by joint and axis by axis
    seconds: float = 1.0  # of holding still at the start; people do so for a breath at least
    # To the letter, as the papers and our simulator take poses; off: arms low, turned and bent, as people hold them.
    nominal: bool = False

    def pose(self, name: str) -> HeldPose:
        """A declared pose.

        Raises:
            InputError: for an unknown one.
        """
        return nominal_pose(name) if self.nominal else held_pose(name)


def rotation_prior_residual(R: Array, R_prior: Array) -> Array:
    """``Log(R_priorᵀ R)``, ``(..., 3)`` rad, in the axes of the rotated frame.

    For a mounting, ``R_bone_sensor`` against the placement's (the papers' eq. 4.7, made soft); for the initial pose,
    each ``R_parent_child`` against the declared one.
    """
    return log(transpose(R_prior) @ R)
