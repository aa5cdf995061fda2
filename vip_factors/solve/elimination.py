"""Elimination of variables of a quadratic ``½ xᵀ H x − vᵀ x``, of whose ``H`` only the upper triangle is used."""

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
    """Gaussian conditional ``R x + S y = d`` of variables ``x`` given those that are eliminated later, ``y``.

    Attributes:
        rows: ``(w, w + m)``, ``R`` (upper triangle) and ``S``.
        d: ``(w,)``.
    """

    rows: Array
    d: Array

    @property
    def R(self) -> Array:
        """Square-root information ``(w, w)``, upper triangular."""
        return self.rows[:, : len(self.d)]

    @property
    def S(self) -> Array:
        """Coupling ``(w, m)`` with later variables."""
        return self.rows[:, len(self.d) :]

    def given(self, later_values: Array) -> Array:
        """Back-substitute: values of the variables given those of later ones."""
        if kernels is not None:
            x = self.d.copy()
            kernels.substitute(self.rows, later_values, x)
            return x
        right = self.d - self.S @ later_values
        solved: Array = dtrsv(self.R, right) if len(right) else right  # BLAS refuses empty input
        return solved

    def covariance(self, joint: Array) -> tuple[Array, Array]:
        """Covariance ``Σ_xx`` of the variables and ``Σ_xy`` with later ones, given theirs, ``Σ_yy`` = ``joint``.

        With ``K = −R⁻¹S``, ``Σ_xy = K Σ_yy`` and ``Σ_xx = R⁻¹R⁻ᵀ + Σ_xy Kᵀ`` (Takahashi, Fagan and Chen 1973).
        """
        w = len(self.d)
        solved = dtrsm(1.0, self.R, np.concatenate([np.eye(w), -self.S], axis=1))
        inverse, K = solved[:, :w], solved[:, w:]
        across = K @ joint
        covariance = inverse @ inverse.T + across @ K.T
        return (covariance + covariance.T) / 2, across  # asymmetry would grow from frame to frame

    def forward(self, right: Array, behind: Array) -> Array:
        """Solve ``Rᵀ Y = right`` for ``Y`` and subtract ``Sᵀ Y`` from ``behind`` in place."""
        solved: Array = dtrsm(1.0, self.R, right, trans_a=1) if right.size else right
        behind -= self.S.T @ solved
        return solved


def eliminated(information: Array, coupling: Array, remaining: Array) -> tuple[Array, Array]:
    """Eliminate the first variables of a quadratic; returns ``R`` ``(w, w)`` and ``Sᵀ`` ``(n, w)``.

    Args:
        information: ``(w, w)`` of the eliminated variables.
        coupling: ``(w, n)`` between these and the remaining ones; overwritten.
        remaining: ``(n, n)``, C-ordered, of the remaining variables; its upper triangle becomes the Schur complement.

    Raises:
        SolveError: if the variables are not determined.
    """
    R, failed = dpotrf(information)
    if failed:
        raise SolveError("the linear system is not determined")
    if not coupling.size:  # BLAS refuses empty input
        return R, coupling.T
    S_transposed = dtrsm(1.0, R, coupling.T, side=1, overwrite_b=1)
    dsyrk(-1.0, S_transposed, 1.0, remaining.T, lower=1, overwrite_c=1)
    return R, S_transposed


def eliminate(information: Array, vector: Array, start: int, width: int, kernels: Kernels = kernels) -> None:
    """Eliminate ``width`` variables from ``start`` on in place, after those before them.

    Their rows become the conditional, the later rows the marginal on the remaining variables. ``information``
    ``(n, n)`` is C-ordered.

    Raises:
        SolveError: if the variables are not determined.
    """
    if kernels is not None:
        if not kernels.eliminate(information, vector, start, width):
            raise SolveError("the linear system is not determined")
        return
    columns, rest_columns = slice(start, start + width), slice(start + width, None)
    remaining = np.array(information[rest_columns, rest_columns])
    R, S_transposed = eliminated(information[columns, columns], np.array(information[columns, rest_columns]), remaining)
    if width:
        vector[columns] = dtrsv(R, vector[columns], trans=1)
    information[columns, columns], information[columns, rest_columns], information[rest_columns, rest_columns] = (
        R,
        S_transposed.T,
        remaining,
    )
    vector[rest_columns] -= S_transposed @ vector[columns]


def add_process_noise(
    information: Array, vector: Array, columns: np.ndarray, sigmas: Array, differences: Array
) -> Conditional:
    """Add process noise in place: new variables replace old ones; returns the conditional of the old ones.

    Args:
        information, vector: ``H`` (C-ordered) and ``v``.
        columns: indices of the variables.
        sigmas: standard deviations of the steps.
        differences: new minus old values at the linearisation point.

    Raises:
        SolveError: if the variables are not determined.
    """
    weight = sigmas**-2.0
    S = np.where(np.arange(len(vector)) < columns[:, None], information[:, columns].T, information[columns])
    corner = S[:, columns] + np.diag(weight)
    v = vector[columns] + weight * differences
    S[:, columns] = -np.diag(weight)
    information[columns], information[:, columns] = 0.0, 0.0
    information[columns, columns], vector[columns] = weight, -weight * differences
    R, S_transposed = eliminated(corner, S, information)
    d = dtrsv(R, v, trans=1)
    vector -= S_transposed @ d
    return Conditional(np.concatenate([R, S_transposed.T], axis=1), d)


def add_at(
    information: Array, vector: Array, places: np.ndarray, H: Array, v: Array, kernels: Kernels = kernels
) -> None:
    """Add a quadratic to a larger one ``H, v``, where its variables have the ascending indices ``places``."""
    if kernels is not None:
        kernels.add_at(information, vector, places, H, v)
        return
    H[np.ix_(places, places)] += np.triu(information)
    v[places] += vector


def reordered(information: Array, vector: Array, order: np.ndarray, kernels: Kernels = kernels) -> tuple[Array, Array]:
    """Return the quadratic of some variables in another order."""
    if kernels is None:
        symmetric = np.triu(information) + np.triu(information, 1).T
        return symmetric[np.ix_(order, order)], vector[order]
    H, v = np.empty((len(order), len(order))), np.empty(len(order))
    kernels.reorder(information, vector, order, H, v)
    return H, v
