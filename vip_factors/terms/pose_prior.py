"""Pose prior: joint rotations under a Gaussian learnt from motion capture, about the mean of this very recording.

The learnt Gaussian says how people differ *and* how they move. Its mean, believed in every frame anew, would bend the
knees of somebody who only stands. So the mean of a recording is a variable, and only that variable is held, once, to
the learnt mean: a hierarchical model. Where the mean is not free it stays the learnt one (thesis eq. 3.14).

With ``x = Log(R)`` of each joint, ``∂x/∂δ = J_r⁻¹(x)`` block by block, so that the derivative is ``scale · L`` times
these.
"""

from dataclasses import dataclass

from vip_factors.body.pose_prior import PosePrior
from vip_factors.geometry.rotations import Array


@dataclass(frozen=True)
class PosePriorSettings:
    """How much the learnt Gaussian is believed."""

    scale: float = 0.4  # of the whitened residual, once in a correlation time: a pose lasts for some two seconds
    mean_scale: float = 0.6  # of the recording's mean: a recording of one activity is off by more than one pose is


def pose_prior_residual(x: Array, mean: Array, prior: PosePrior, settings: PosePriorSettings) -> Array:
    """``scale · L (x − m)``, ``(T, 69)``, of unit variance where the Gaussian holds (thesis eqs. 3.14, 3.28–3.29).

    ``m`` ``(69,)`` is the mean of the recording; the derivative by it is ``−scale · L``.
    """
    return settings.scale * (x - mean) @ prior.whitening.T


def pose_mean_residual(mean: Array, prior: PosePrior, settings: PosePriorSettings) -> Array:
    """``mean_scale · L (m − μ)``, ``(69,)``: the recording's mean against the learnt one."""
    return settings.mean_scale * prior.whitening @ (mean - prior.mean)
