"""The step of a single chain that shares nothing: its Hessian is a band, which LAPACK factors at a third of the time.

GTSAM takes each frame's factors apart and puts them together again; where nothing but frames and their next two are
tied, that is all that it does.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dpbtrf, dpbtrs

from vip_factors.geometry.rotations import Array
from vip_factors.solve.chain_system import ChainPart, ChainSystem


@dataclass(frozen=True)
class ChainStep:
    """A step ``(T, w)`` of every frame of a chain, by GTSAM's names."""

    rows: dict[int, int]
    steps: Array

    def at(self, key: int) -> Array:
        """Of one frame."""
        return np.asarray(self.steps[self.rows[key]])


def is_one_chain(system: object) -> bool:
    """Whether a system is a single chain, without anything that its frames share and without further factors."""
    return (
        isinstance(system, ChainSystem)
        and len(system.parts) == 1
        and not (system.groups or system.between or system.coupling or system.extra)
    )


def chain_step(part: ChainPart, damping: float) -> ChainStep | None:
    """The minimum of the damped quadratic; None where it is not determined."""
    extra = damping * part.damping
    if part.following is None:
        steps = _independent(part.own + np.diag(extra), part.gradient)
    else:
        steps = _tied(part.own, extra, part.following, part.gradient)
    return None if steps is None else ChainStep({key: t for t, key in enumerate(part.keys)}, steps)


def _independent(own: Array, gradient: Array) -> Array | None:
    try:
        factor = np.linalg.cholesky(own)  # it alone says whether the matrix is positive
    except np.linalg.LinAlgError:
        return None
    half = np.linalg.solve(factor, -gradient[..., None])
    return np.asarray(np.linalg.solve(factor.swapaxes(1, 2), half)[..., 0])


def _tied(own: Array, extra: Array, following: Array, gradient: Array) -> Array | None:
    """Of frames tied to the next two: the columns of the lower band, one below the other."""
    T, w = gradient.shape
    band = np.zeros((T, w, 3 * w))
    for a in range(w):
        band[:, a, : w - a] = own[:, a, a:]
        band[:, a, w - a : 3 * w - a] = following[:, :, a].reshape(T, 2 * w)
    band[:, :, 0] += extra
    factor, failed = dpbtrf(band.reshape(T * w, 3 * w).T, lower=1, overwrite_ab=1)
    if failed:
        return None
    steps, _ = dpbtrs(factor, -gradient.reshape(T * w, 1), lower=1)
    return np.asarray(steps.reshape(T, w))
