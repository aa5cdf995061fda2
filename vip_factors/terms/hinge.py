"""Hinge: elbows and knees turn about axes that are fixed in the upper bone.

With ``a`` the axis in the upper bone and ``d`` a direction in the lower one at a constant angle to it,
``e = aᵀ R_parent_child d − c``: about the sine of the limb's angle to its plane of flexion. ``a`` (tilted slightly from
the usual axis) and ``c`` are constant for a person and contain the carrying angle of the elbow. Elbows have one row,
with ``d`` along the forearm, which leaves pronation free; knees have two.

A right perturbation of the joint gives ``∂e/∂δ = −aᵀ R [d]×``.
"""

from collections.abc import Iterator
from functools import lru_cache

import numpy as np

from vip_factors.body.joint_priors import HINGES, ROWS, TILTS
from vip_factors.factor_settings import SQUARE, HingeSettings
from vip_factors.geometry.rotations import Array, hat, transpose
from vip_factors.terms.equations import DenseEquations, JacobianBlock, Term, prior_equations
from vip_factors.terms.evaluation import WearerEvaluation


def hinge_sigmas(settings: HingeSettings) -> Array:
    """Standard deviations ``(ROWS,)``, radians."""
    sigmas = np.full(ROWS, settings.sigma_deg)
    for hinge in HINGES:
        sigmas[hinge.rows.start + 1 : hinge.rows.stop] = settings.twist_sigma_deg
    return np.radians(sigmas)


_JOINT = np.array([hinge.index for hinge in HINGES for _ in hinge.square.T])  # joint of each row
_HINGE = np.array([number for number, hinge in enumerate(HINGES) for _ in hinge.square.T])
_SQUARE = np.concatenate([hinge.square.T for hinge in HINGES])  # (ROWS, 3)
_SQUARE_HAT = hat(_SQUARE)
_ROW = np.arange(ROWS)


def hinges_of_rows(variables: Array) -> tuple[Array, ...]:
    """Return for each row its hinge, joint, direction in the lower bone ``(ROWS, 3)``, axis in the upper bone
    ``(ROWS, 3)`` and derivative of the axis by its tilt ``(ROWS, 3, 2)``.
    """
    return _HINGE, _JOINT, _SQUARE, *_axes(variables[:TILTS].tobytes())


@lru_cache(maxsize=16)  # tilts seldom change in a stream
def _axes(tilts: bytes) -> tuple[Array, Array]:
    """Axis of each row's hinge in the upper bone ``(ROWS, 3)`` and its derivative by the tilt ``(ROWS, 3, 2)``."""
    pairs = list(zip(HINGES, np.frombuffer(tilts).reshape(-1, 2), strict=True))
    directions = np.array([hinge.direction(tilt) for hinge, tilt in pairs])
    by_tilt = np.array([hinge.direction_by_tilt(tilt) for hinge, tilt in pairs])
    return directions[_HINGE], by_tilt[_HINGE]


def hinge_residual(R_parent_child: Array, variables: Array) -> Array:
    """Residuals ``(t, ROWS)``, approximately radians.

    ``variables`` are the tilts of the axes, then the offsets; ``R_parent_child`` is ``(t, 24, 3, 3)``.
    """
    axes, _ = _axes(variables[:TILTS].tobytes())
    along = (R_parent_child[:, _JOINT] @ _SQUARE[..., None])[..., 0]
    return np.asarray(np.einsum("ri,tri->tr", axes, along) - variables[TILTS:])


def hinge_jacobians(R_parent_child: Array, variables: Array) -> tuple[Array, Array]:
    """Derivatives of :func:`hinge_residual`.

    Returns:
        By each hinge's joint ``(HINGES, t, ROWS, 3)`` and by the variables ``(t, ROWS, HINGE_VARIABLES)``.
    """
    count, R, (axes, by_tilts) = len(R_parent_child), R_parent_child[:, _JOINT], _axes(variables[:TILTS].tobytes())
    by_joints = np.zeros((len(HINGES), count, ROWS, 3))
    axes_in_child = axes[:, None] @ R  # (t, ROWS, 1, 3)
    by_joints[_HINGE, :, _ROW] = (axes_in_child @ transpose(_SQUARE_HAT))[:, :, 0].swapaxes(0, 1)
    by_variables = np.zeros((count, ROWS, len(variables)))
    by_variables[:, _ROW, TILTS + _ROW] = -1.0
    along = (R @ _SQUARE[..., None]).swapaxes(2, 3)
    by_variables[:, _ROW[:, None], 2 * _HINGE[:, None] + np.arange(2)] = (along @ by_tilts)[:, :, 0]
    return by_joints, by_variables


def equations(wearer: WearerEvaluation, stretch: slice) -> Iterator[DenseEquations]:
    """One factor in each frame on all elbows and knees."""
    settings = wearer.problem.settings.hinge
    if not settings.use:
        return
    R, whitening = wearer.state.R_parent_child[stretch], 1 / hinge_sigmas(settings)

    def blocks() -> tuple[JacobianBlock, ...]:
        scaled = [whitening[:, None] * J for J in hinge_jacobians(R, wearer.state.hinges)]
        by_joints = (
            JacobianBlock(wearer.owner, hinge.joint, J[:, None]) for hinge, J in zip(HINGES, scaled[0], strict=True)
        )
        return *by_joints, JacobianBlock(wearer.owner, "hinges", scaled[1][:, None])

    residual = (whitening * hinge_residual(R, wearer.state.hinges))[:, None]
    # Square loss: a robust one would leave an elbow bent backwards.
    yield DenseEquations(stretch.start, residual, 1.0, SQUARE, blocks)


def axes_equations(wearer: WearerEvaluation) -> Iterator[DenseEquations]:
    """One linear factor on the axes of elbows and knees: a Gaussian about the usual or earlier estimated axes."""
    if wearer.problem.free_hinges:
        prior = wearer.problem.hinge_prior
        residual = prior.whitening @ (wearer.state.hinges - prior.mean)
        yield from prior_equations(JacobianBlock(wearer.owner, "hinges", prior.whitening[None, None]), residual[None])


HINGE = Term("hinge", 0, equations)
HINGE_PRIOR = Term.prior("hinge prior", axes_equations)
