"""Hinge: elbows and knees turn about axes that stay where they are in the bone above.

With ``a`` the axis in the upper bone and ``d`` a direction in the lower one that a hinge keeps at one angle to it,
``e = aᵀ R_parent_child d − c``: about the sine of how far the limb is off the plane that it bends in. ``a`` (tilted
a little from the usual axis) and ``c`` are the person's, constant over a recording: the carrying angle of an elbow is
in both. Elbows have one such row, along the forearm, so that it may turn about itself; knees have two.

By a right perturbation of the joint ``∂e/∂δ = −aᵀ R [d]×``, that is ``(Rᵀ a × d)ᵀ`` with its sign turned.
"""

from dataclasses import dataclass

import numpy as np

from vip_factors.body.hinges import HINGES, ROWS, TILTS
from vip_factors.geometry.rotations import Array
from vip_factors.terms.robust import SQUARE, RobustLoss


@dataclass(frozen=True)
class HingeSettings:
    """How near elbows and knees are to hinges."""

    use: bool = True
    sigma_deg: float = 4.0  # optical elbows and knees stay within a few degrees of one axis
    twist_sigma_deg: float = 8.0  # of shanks, which turn by 10° against the thigh as the knee bends and by more bent

    # Square: an elbow that starts on its back has to come round, and a robust loss leaves it there.
    loss: RobustLoss = SQUARE

    @property
    def sigmas(self) -> Array:
        """Of each row, radians."""
        sigmas = np.full(ROWS, self.sigma_deg)
        for hinge in HINGES:
            sigmas[hinge.rows.start + 1 : hinge.rows.stop] = self.twist_sigma_deg
        return np.radians(sigmas)


def hinge_residual(R_parent_child: Array, variables: Array) -> Array:
    """``(t, ROWS)``, about radians.

    Args:
        R_parent_child: ``(t, 24, 3, 3)`` joint rotations.
        variables: ``(HINGE_VARIABLES,)`` tilts of the axes, then offsets.
    """
    tilts, offsets = variables[:TILTS].reshape(-1, 2), variables[TILTS:]
    found = np.empty((len(R_parent_child), ROWS))
    for hinge, tilt in zip(HINGES, tilts, strict=True):
        axis = hinge.direction(tilt)
        found[:, hinge.rows] = axis @ R_parent_child[:, hinge.index] @ hinge.square - offsets[hinge.rows]
    return found


def hinge_jacobians(R_parent_child: Array, variables: Array) -> tuple[tuple[Array, ...], Array]:
    """Derivatives of :func:`hinge_residual`.

    Returns:
        By each hinge's joint ``(t, ROWS, 3)``, and by the variables ``(t, ROWS, HINGE_VARIABLES)``.
    """
    count, tilts = len(R_parent_child), variables[:TILTS].reshape(-1, 2)
    by_joints = np.zeros((len(HINGES), count, ROWS, 3))
    by_variables = np.zeros((count, ROWS, len(variables)))
    by_variables[:, np.arange(ROWS), TILTS + np.arange(ROWS)] = -1.0
    for number, (hinge, tilt) in enumerate(zip(HINGES, tilts, strict=True)):
        R = R_parent_child[:, hinge.index]
        axis_in_child = hinge.direction(tilt) @ R  # (t, 3)
        by_joints[number, :, hinge.rows] = np.cross(hinge.square.T[None], axis_in_child[:, None])
        by_tilt = (R @ hinge.square).swapaxes(1, 2) @ hinge.direction_by_tilt(tilt)
        by_variables[:, hinge.rows, 2 * number : 2 * number + 2] = by_tilt
    return tuple(by_joints), by_variables
