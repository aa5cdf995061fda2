"""Hinge: elbows and knees turn about axes that stay where they are in the bone above.

With ``a`` the axis in the upper bone and ``d`` a direction in the lower one that a hinge keeps at one angle to it,
``e = aᵀ R_parent_child d − c``: about the sine of how far the limb is off the plane that it bends in. ``a`` (tilted
a little from the usual axis) and ``c`` are the person's, constant over a recording: the carrying angle of an elbow is
in both. Elbows have one such row, along the forearm, so that it may turn about itself; knees have two.

By a right perturbation of the joint ``∂e/∂δ = −aᵀ R [d]×``, that is ``(Rᵀ a × d)ᵀ`` with its sign turned.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from vip_factors.body.hinges import HINGES, ROWS, TILTS
from vip_factors.geometry.rotations import Array, hat
from vip_factors.terms.equations import DenseEquations, JacobianBlock, Term, prior_equations
from vip_factors.terms.evaluation import WearerEvaluation
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
    """``(t, ROWS)``, about radians, of joint rotations ``(t, 24, 3, 3)`` and the variables: tilts of the axes, then
    offsets.
    """
    tilts, offsets = variables[:TILTS].reshape(-1, 2), variables[TILTS:]
    found = np.empty((len(R_parent_child), ROWS))
    for hinge, tilt in zip(HINGES, tilts, strict=True):
        axis = hinge.direction(tilt)
        found[:, hinge.rows] = axis @ R_parent_child[:, hinge.index] @ hinge.square - offsets[hinge.rows]
    return found


def hinge_jacobians(R_parent_child: Array, variables: Array) -> tuple[tuple[Array, ...], Array]:
    """Derivatives of :func:`hinge_residual`: by each hinge's joint ``(t, ROWS, 3)``, and by the variables ``(t, ROWS,
    HINGE_VARIABLES)``.
    """
    count, tilts = len(R_parent_child), variables[:TILTS].reshape(-1, 2)
    by_joints = np.zeros((len(HINGES), count, ROWS, 3))
    by_variables = np.zeros((count, ROWS, len(variables)))
    by_variables[:, np.arange(ROWS), TILTS + np.arange(ROWS)] = -1.0
    for number, (hinge, tilt) in enumerate(zip(HINGES, tilts, strict=True)):
        R = R_parent_child[:, hinge.index]
        axis_in_child = hinge.direction(tilt) @ R  # (t, 3)
        by_joints[number, :, hinge.rows] = (hat(hinge.square.T) @ axis_in_child[:, None, :, None])[..., 0]
        by_tilt = (R @ hinge.square).swapaxes(1, 2) @ hinge.direction_by_tilt(tilt)
        by_variables[:, hinge.rows, 2 * number : 2 * number + 2] = by_tilt
    return tuple(by_joints), by_variables


def equations(at: WearerEvaluation, first: slice) -> Iterator[DenseEquations]:
    """One factor a frame on all elbows and knees."""
    settings: HingeSettings = at.problem.settings.hinge
    if not settings.use:
        return
    R, whitening = at.state.R_parent_child[first], 1 / settings.sigmas

    def blocks() -> tuple[JacobianBlock, ...]:
        by_joints, by_variables = hinge_jacobians(R, at.state.hinges)
        scaled = [(whitening[:, None] * J)[:, None] for J in (*by_joints, by_variables)]
        names = [*(one.joint for one in HINGES), "hinges"]
        return tuple(JacobianBlock(at.owner, name, J) for name, J in zip(names, scaled, strict=True))

    residual = (whitening * hinge_residual(R, at.state.hinges))[:, None]
    yield DenseEquations(first.start, residual, 1.0, settings.loss, blocks)


def axes_equations(at: WearerEvaluation) -> Iterator[DenseEquations]:
    """One factor on the axes of elbows and knees: usual ones are the likeliest, or those found before; linear."""
    if at.problem.free_hinges:
        prior = at.problem.hinge_prior
        residual = prior.whitening @ (at.state.hinges - prior.mean)
        yield from prior_equations(JacobianBlock(at.owner, "hinges", prior.whitening[None, None]), residual[None])


HINGE = Term("hinge", 0, equations)
HINGE_PRIOR = Term.prior("hinge prior", axes_equations)
