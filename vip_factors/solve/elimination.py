"""Elimination of some variables of ``½ xᵀ H x − vᵀ x``, and what is known of them, of values of all others.

Of ``H`` what lies on and above the diagonal counts.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cython_blas, cython_lapack
from scipy.linalg.blas import dsyrk, dtrsm, dtrsv
from scipy.linalg.lapack import dpotrf

from vip_factors.compiled import Kernels, kernels
from vip_factors.errors import SolveError
from vip_factors.geometry.rotations import Array

if kernels is not None:
    kernels.use_blas({**cython_lapack.__pyx_capi__, **cython_blas.__pyx_capi__})


@dataclass(frozen=True)
class Conditional:
    """``R x + S y = d`` of some variables ``x`` and all that are eliminated after them, ``y``.

    ``rows`` hold ``R``, of which only what lies on and above the diagonal counts, and ``S``.
    """

    rows: Array
    d: Array

    @property
    def R(self) -> Array:
        """``(w, w)``."""
        return self.rows[:, : len(self.d)]

    @property
    def S(self) -> Array:
        """``(w, m)``."""
        return self.rows[:, len(self.d) :]

    def given(self, later: Array) -> Array:
        """The variables, of the values of the later ones."""
        if kernels is not None:
            x = self.d.copy()
            kernels.substitute(self.rows, later, x)
            return x
        right = self.d - self.S @ later
        solved: Array = dtrsv(self.R, right) if len(right) else right  # of nothing at all it complains
        return solved

    def covariance(self, joint: Array) -> tuple[Array, Array]:
        """Of the variables, and with the later ones, whose own is ``joint``.

        With ``K = −R⁻¹S``, ``Σ_xy = K Σ_yy`` and ``Σ_xx = R⁻¹R⁻ᵀ + Σ_xy Kᵀ``: all that a later frame asks for stands in
        the rows of this one (Takahashi, Fagan and Chen 1973).
        """
        w = len(self.d)
        solved = dtrsm(1.0, self.R, np.concatenate([np.eye(w), -self.S], axis=1))
        inverse, K = solved[:, :w], solved[:, w:]
        across = K @ joint
        own = inverse @ inverse.T + across @ K.T
        return (own + own.T) / 2, across  # what is not symmetric would grow from frame to frame

    def forward(self, right: Array, behind: Array) -> Array:
        """``Y`` of ``Rᵀ Y = right``; ``Sᵀ Y`` is taken from ``behind``."""
        solved: Array = dtrsm(1.0, self.R, right, trans_a=1) if right.size else right
        behind -= self.S.T @ solved
        return solved


def eliminated(own: Array, others: Array, rest: Array) -> tuple[Array, Array]:
    """The first variables of a quadratic eliminated: ``R`` ``(w, w)``, and ``Sᵀ`` ``(n, w)``, of ``R x + S y``.

    Args:
        own, others: ``(w, w)`` and ``(w, n)`` of the variables with themselves and with the others; ``others`` is
            changed.
        rest: ``(n, n)`` in C's order: what is known of the others beside; its upper triangle becomes what is left.

    Raises:
        SolveError: if the variables are not determined.
    """
    R, failed = dpotrf(own)
    if failed:
        raise SolveError("the linear system is not determined")
    if not others.size:  # of which BLAS complains
        return R, others.T
    S_transposed = dtrsm(1.0, R, others.T, side=1, overwrite_b=1)
    dsyrk(-1.0, S_transposed, 1.0, rest.T, lower=1, overwrite_c=1)
    return R, S_transposed


def eliminate(information: Array, vector: Array, first: int, width: int, kernels: Kernels = kernels) -> None:
    """Eliminate ``width`` variables from ``first`` on, those before being so already, in place.

    Their rows become those of the conditional, those behind what is known of the others; ``H``, ``(n, n)``, is in C's
    order.

    Raises:
        SolveError: if they are not determined.
    """
    if kernels is not None:
        if not kernels.eliminate(information, vector, first, width):
            raise SolveError("the linear system is not determined")
        return
    own, others = slice(first, first + width), slice(first + width, None)
    rest = np.array(information[others, others])
    R, S_transposed = eliminated(information[own, own], np.array(information[own, others]), rest)
    if width:
        vector[own] = dtrsv(R, vector[own], trans=1)
    information[own, own], information[own, others], information[others, others] = R, S_transposed.T, rest
    vector[others] -= S_transposed @ vector[own]


def add_process_noise(
    information: Array, vector: Array, columns: np.ndarray, sigmas: Array, differences: Array
) -> Conditional:
    """Let some variables step, in place: go on with new ones in their places; returns the old ones given all others.

    Args:
        information, vector: ``H`` in C's order, and ``v``.
        columns: of the variables.
        sigmas: of their steps.
        differences: by how much the new ones are more than the old ones, where both are linearised.

    Raises:
        SolveError: if they are not determined.
    """
    weight = sigmas**-2.0
    S = np.where(np.arange(len(vector)) < columns[:, None], information[:, columns].T, information[columns])
    own = S[:, columns] + np.diag(weight)
    v = vector[columns] + weight * differences
    S[:, columns] = -np.diag(weight)
    information[columns], information[:, columns] = 0.0, 0.0
    information[columns, columns], vector[columns] = weight, -weight * differences
    R, S_transposed = eliminated(own, S, information)
    d = dtrsv(R, v, trans=1)
    vector -= S_transposed @ d
    return Conditional(np.concatenate([R, S_transposed.T], axis=1), d)


def add_at(
    information: Array, vector: Array, places: np.ndarray, H: Array, v: Array, kernels: Kernels = kernels
) -> None:
    """Add what is known of some variables to what is known of more, among which they are at ascending places."""
    if kernels is not None:
        kernels.add_before(information, vector, places, H, v)
        return
    H[np.ix_(places, places)] += np.triu(information)
    v[places] += vector


def reordered(information: Array, vector: Array, order: np.ndarray, kernels: Kernels = kernels) -> tuple[Array, Array]:
    """Some variables of a quadratic, in another order."""
    if kernels is None:
        symmetric = np.triu(information) + np.triu(information, 1).T
        return symmetric[np.ix_(order, order)], vector[order]
    H, v = np.empty((len(order), len(order))), np.empty(len(order))
    kernels.reorder(information, vector, order, H, v)
    return H, v
