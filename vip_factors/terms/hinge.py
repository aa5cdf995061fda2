"""Hinge: elbows and knees turn about axes that stay where they are in the bone above.

With ``a`` the axis in the upper bone and ``d`` a direction in the lower one that a hinge keeps at one angle to it,
``e = aᵀ R_parent_child d − c``: about the sine of how far the limb is off the plane that it bends in. ``a`` (tilted
a little from the usual axis) and ``c`` are the person's, constant over a recording: the carrying angle of an elbow is
in both. Elbows have one such row, along the forearm, so that it may turn about itself; knees have two.

By a right perturbation of the joint ``∂e/∂δ = −aᵀ R [d]×``, that is ``(Rᵀ a × d)ᵀ`` with its sign turned.
"""

from collections.abc import Iterator
from functools import lru_cache

import numpy as np

from vip_factors.body.hinges import HINGES, ROWS, TILTS
from vip_factors.factor_settings import SQUARE, HingeSettings
from vip_factors.geometry.rotations import Array, hat, transpose
from vip_factors.terms.equations import DenseEquations, JacobianBlock, Term, prior_equations
from vip_factors.terms.evaluation import WearerEvaluation


def hinge_sigmas(settings: HingeSettings) -> Array:
    """Standard deviation of each row, radians."""
    sigmas = np.full(ROWS, settings.sigma_deg)
    for hinge in HINGES:
        sigmas[hinge.rows.start + 1 : hinge.rows.stop] = settings.twist_sigma_deg
    return np.radians(sigmas)


_JOINT = np.array([hinge.index for hinge in HINGES for _ in hinge.square.T])  # of each row
_OF_HINGE = np.array([number for number, hinge in enumerate(HINGES) for _ in hinge.square.T])
_SQUARE = np.concatenate([hinge.square.T for hinge in HINGES])  # (ROWS, 3)
_SQUARE_HAT = hat(_SQUARE)
_EACH = np.arange(ROWS)


def hinges_of_rows(variables: Array) -> tuple[Array, ...]:
    """Of each row the number of its hinge and its joint, its direction in the lower bone ``(ROWS, 3)``, the hinge's
    axis in the upper one ``(ROWS, 3)``, and that by its tilt ``(ROWS, 3, 2)``.
    """
    return _OF_HINGE, _JOINT, _SQUARE, *_axes(variables[:TILTS].tobytes())


@lru_cache(maxsize=16)  # they seldom change, and a stream asks often
def _axes(tilts: bytes) -> tuple[Array, Array]:
    """Of the hinge of each row, in the bone above: its direction ``(ROWS, 3)``, and by its tilt ``(ROWS, 3, 2)``."""
    pairs = list(zip(HINGES, np.frombuffer(tilts).reshape(-1, 2), strict=True))
    directions = np.array([hinge.direction(tilt) for hinge, tilt in pairs])
    return directions[_OF_HINGE], np.array([hinge.direction_by_tilt(tilt) for hinge, tilt in pairs])[_OF_HINGE]


def hinge_residual(R_parent_child: Array, variables: Array) -> Array:
    """``(t, ROWS)``, about radians, of joint rotations ``(t, 24, 3, 3)`` and the variables: tilts of the axes, then
    offsets.
    """
    axes, _ = _axes(variables[:TILTS].tobytes())
    along = (R_parent_child[:, _JOINT] @ _SQUARE[..., None])[..., 0]
    return np.asarray(np.einsum("ri,tri->tr", axes, along) - variables[TILTS:])


def hinge_jacobians(R_parent_child: Array, variables: Array) -> tuple[Array, Array]:
    """Derivatives of :func:`hinge_residual`: by each hinge's joint ``(HINGES, t, ROWS, 3)``, and by the variables ``(t,
    ROWS, HINGE_VARIABLES)``.
    """
    count, R, (axes, by_tilts) = len(R_parent_child), R_parent_child[:, _JOINT], _axes(variables[:TILTS].tobytes())
    by_joints = np.zeros((len(HINGES), count, ROWS, 3))
    axes_in_child = axes[:, None] @ R  # (t, ROWS, 1, 3)
    by_joints[_OF_HINGE, :, _EACH] = (axes_in_child @ transpose(_SQUARE_HAT))[:, :, 0].swapaxes(0, 1)
    by_variables = np.zeros((count, ROWS, len(variables)))
    by_variables[:, _EACH, TILTS + _EACH] = -1.0
    along = (R @ _SQUARE[..., None]).swapaxes(2, 3)
    by_variables[:, _EACH[:, None], 2 * _OF_HINGE[:, None] + np.arange(2)] = (along @ by_tilts)[:, :, 0]
    return by_joints, by_variables


def equations(at: WearerEvaluation, first: slice) -> Iterator[DenseEquations]:
    """One factor a frame on all elbows and knees."""
    settings = at.problem.settings.hinge
    if not settings.use:
        return
    R, whitening = at.state.R_parent_child[first], 1 / hinge_sigmas(settings)

    def blocks() -> tuple[JacobianBlock, ...]:
        scaled = [whitening[:, None] * J for J in hinge_jacobians(R, at.state.hinges)]
        by_joints = (JacobianBlock(at.owner, one.joint, J[:, None]) for one, J in zip(HINGES, scaled[0], strict=True))
        return *by_joints, JacobianBlock(at.owner, "hinges", scaled[1][:, None])

    residual = (whitening * hinge_residual(R, at.state.hinges))[:, None]
    # Square: an elbow that starts on its back has to come round, and a robust loss leaves it there.
    yield DenseEquations(first.start, residual, 1.0, SQUARE, blocks)


def axes_equations(at: WearerEvaluation) -> Iterator[DenseEquations]:
    """One factor on the axes of elbows and knees: usual ones are the likeliest, or those found before; linear."""
    if at.problem.free_hinges:
        prior = at.problem.hinge_prior
        residual = prior.whitening @ (at.state.hinges - prior.mean)
        yield from prior_equations(JacobianBlock(at.owner, "hinges", prior.whitening[None, None]), residual[None])


HINGE = Term("hinge", 0, equations)
HINGE_PRIOR = Term.prior("hinge prior", axes_equations)
