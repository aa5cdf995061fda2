"""Normal equations of a long chain of frames, eliminated a stretch at a time.

Factors connect a frame with the next two and with columns that all frames share: a banded matrix with a border. Frames
are eliminated in time order and the border last. Process noise may act on columns of the border between two stretches,
as headings drift.
"""

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import as_strided
from scipy.linalg import solve_triangular
from scipy.linalg.blas import dtrsv

from vip_factors.compiled import Kernels, kernels
from vip_factors.errors import SolveError
from vip_factors.geometry.rotations import Array
from vip_factors.solve.elimination import Conditional, add_process_noise, eliminated
from vip_factors.solve.slices import REACH, Blocks


@dataclass(frozen=True)
class Shape:
    """Dimensions of a chain of frames.

    Attributes:
        frame, static: widths of a frame and of the shared (static) columns.
        far: columns of a frame that factors connect with the frame two before it.
        tied: True if factors connect a frame with later ones.
    """

    frame: int
    static: int
    far: np.ndarray
    tied: bool = True

    @property
    def ahead(self) -> int:
        """Number of columns of later frames that a frame is connected with."""
        return self.frame + len(self.far) if self.tied else 0

    @property
    def rest(self) -> int:
        """Number of columns in a frame's conditional besides its own."""
        return self.ahead + self.static


class Band:
    """Normal equations of a stretch of frames: sum of all factors whose first frame is in the stretch.

    Attributes:
        rows: ``(T + 2, w, m)``, blocks of each frame with itself (upper triangle), the next two frames (if tied) and
            the shared columns. The last two frames follow the stretch.
        gradient: ``(T + 2, w)``.
        static, static_gradient: ``(s, s)`` (upper triangle) and ``(s,)`` of the shared columns.
    """

    def __init__(self, shape: Shape, frames: int, kernels: Kernels = kernels) -> None:
        self.shape, self._kernels, w, s = shape, kernels, shape.frame, shape.static
        self.rows = np.zeros((frames + REACH, w, (REACH + 1 if shape.tied else 1) * w + s))
        self.gradient = np.zeros((frames + REACH, w))
        self.static, self.static_gradient = np.zeros((s, s)), np.zeros(s)

    @property
    def frames(self) -> int:
        """Number of frames in the stretch."""
        return len(self.rows) - REACH

    def first(self, frames: int) -> "Band":
        """Return a view of the first ``frames`` frames."""
        band = copy(self)
        band.rows, band.gradient = self.rows[: frames + REACH], self.gradient[: frames + REACH]
        return band

    def behind(self, frames: int) -> "Band":
        """Return a view without the first ``frames`` frames."""
        band = copy(self)
        band.rows, band.gradient = self.rows[frames:], self.gradient[frames:]
        return band

    def empty(self) -> None:
        """Set all blocks to zero."""
        for array in (self.rows, self.gradient, self.static, self.static_gradient):
            array.fill(0.0)

    @property
    def blocks(self) -> Blocks:
        """Overlapping views into which factors are summed, indexed by a factor's first frame."""
        w, (frame, row, column) = self.shape.frame, self.rows.strides
        triples = (self.frames, REACH + 1)
        of_frames = as_strided(
            self.rows, (*triples, w, (REACH + 1) * w), (frame, frame - w * column, row, column)
        )  # the columns of a later frame's row begin with its own
        coupling, gradient = (
            as_strided(block, (*triples, *block.shape[1:]), (block.strides[0], *block.strides))
            for block in (self.rows[:, :, self.rows.shape[2] - self.shape.static :], self.gradient)
        )
        arrays = self.rows, self.gradient, self.static, self.static_gradient
        target = None if self._kernels is None else self._kernels.Target(*arrays)
        return Blocks(of_frames, coupling, gradient, self.static[None], self.static_gradient[None], target)


class BandElimination:
    """Elimination of the frames of a chain, stretch by stretch.

    Args:
        shape: dimensions of the chain. Bands may have extra columns in each frame, after those of the chain; they are
            moved to the end of the border, frame after frame.
        damping: ``(w,)`` added to the diagonal of each frame.
        memory: elimination of an earlier linearisation whose arrays are reused; allocating new pages is slower.
        kernels: compiled kernels, or None for NumPy.

    Attributes:
        information, vector: marginal on the next frame, the far columns of the one after it, and the border.
    """

    def __init__(
        self, shape: Shape, damping: Array, memory: "BandElimination | None" = None, kernels: Kernels = kernels
    ) -> None:
        self.shape, self._damping, self._kernels, self._extra = shape, damping, kernels, 0
        self.information, self.vector = np.zeros((shape.rest, shape.rest)), np.zeros(shape.rest)
        self._conditionals = list[tuple[Array, Array]]()  # for each stretch R and S (T, w, n), and d (T, w)
        self._memory = memory._conditionals[::-1] if memory is not None else []
        # After a stretch: the border columns with process noise, and the conditional of their earlier values.
        self._steps = dict[int, tuple[np.ndarray, Conditional]]()

    def eliminate(self, *bands: Band) -> None:
        """Eliminate the frames of the next stretch; takes a single band.

        Raises:
            SolveError: if the factors do not determine a variable.
        """
        (band,) = bands
        frames, w, n = band.frames, self.shape.frame, self.shape.frame + self.shape.rest
        rows, d = self._memory.pop() if self._memory else (np.zeros((0, 0, 0)), np.zeros((0, 0)))
        if rows.shape != (frames, w, n):
            rows, d = np.empty((frames, w, n)), np.empty((frames, w))
        self._conditionals.append((rows, d))
        self._extra = band.shape.frame - w
        if self._kernels is None:
            self._eliminate_purely(band, rows, d)
            return
        arrays = band.rows, band.gradient, band.static, band.static_gradient
        chain = self.shape.far, self.shape.tied, self.shape.static, self._damping
        if not self._kernels.eliminate_stretch(*arrays, *chain, self.information, self.vector, rows, d):
            raise SolveError("the linear system is not determined")

    def _eliminate_purely(self, band: Band, conditionals: Array, d: Array) -> None:
        shape, w, c, every = self.shape, self.shape.frame, self._extra, band.shape
        end = (REACH + 1 if shape.tied else 1) * w  # of frames; behind it stands the border
        columns = [i * every.frame + np.arange(w) for i in range(end // w)]
        rows = band.rows[:, :w, np.concatenate([*columns, np.arange(-every.static, 0)])]
        band_end, m = end + every.static, end + shape.static
        border = np.arange(end, m)
        later_columns = np.concatenate([w + np.arange(w), 2 * w + shape.far])[: shape.ahead]
        earlier_columns = np.concatenate([later_columns - w, border])
        later_columns = np.concatenate([later_columns, border])
        H, v = np.zeros((m, m)), np.zeros(m)
        H[np.ix_(earlier_columns, earlier_columns)], v[earlier_columns] = np.triu(self.information), self.vector
        for t in range(band.frames):
            met = m - (band.frames - t) * c
            H[:w, :band_end] += rows[t]
            H[:w, met : met + c] += band.rows[t, :w, w : w + c]
            H[range(w), range(w)] += self._damping
            v[:w] -= band.gradient[t, :w]
            remaining = np.ascontiguousarray(H[np.ix_(later_columns, later_columns)])
            R, S_transposed = eliminated(H[:w, :w], np.array(H[:w, later_columns]), remaining)
            conditionals[t, :, :w], conditionals[t, :, w:], d[t] = R, S_transposed.T, dtrsv(R, v[:w], trans=1)
            remaining_vector = v[later_columns] - S_transposed @ d[t]
            H[:], v[:] = 0.0, 0.0
            H[np.ix_(earlier_columns, earlier_columns)], v[earlier_columns] = np.triu(remaining), remaining_vector
        for i in range(REACH if shape.tied else 0):
            columns_i, block = slice(i * w, (i + 1) * w), rows[band.frames + i]
            H[columns_i, i * w : end] += block[:, : end - i * w]
            H[columns_i, end:band_end] += block[:, end:]
            v[columns_i] -= band.gradient[band.frames + i, :w]
        H[end:band_end, end:band_end] += band.static
        v[end:band_end] -= band.static_gradient
        self.information[:], self.vector[:] = H[np.ix_(earlier_columns, earlier_columns)], v[earlier_columns]

    def step(self, columns: np.ndarray, sigmas: Array, differences: Array) -> None:
        """Add process noise to border columns after the last stretch: new variables replace the old ones.

        Args:
            columns: indices in the border.
            sigmas: standard deviations of the steps.
            differences: new minus old values at the linearisation point.
        """
        if not len(columns):
            return
        places = self.shape.ahead + columns
        step = add_process_noise(self.information, self.vector, places, sigmas, differences)
        self._steps[len(self._conditionals) - 1] = columns, step

    @property
    def border(self) -> tuple[Array, Array]:
        """Marginal on the border: information ``(s, s)`` (upper triangle) and vector ``(s,)``."""
        ahead = self.shape.ahead
        return self.information[ahead:, ahead:], self.vector[ahead:]

    def given(self, border: Array) -> tuple[Array, Array]:
        """Substitute the last border's steps: steps ``(T, w)`` of all frames, and ``(K, s)`` of the border in time."""
        shape, behind, borders, stretches = self.shape, np.zeros((REACH, self.shape.frame)), [border], list[Array]()
        for number in range(len(self._conditionals) - 1, -1, -1):
            if number in self._steps:
                columns, step = self._steps[number]
                ahead = np.concatenate([behind[0], behind[1, shape.far]])[: shape.ahead]
                border = borders[-1].copy()
                border[columns] = step.given(np.concatenate([ahead, borders[-1]]))
                borders.append(border)
            steps = self.substituted(number, behind, border)
            stretches.append(steps)
            behind = np.concatenate([steps[:REACH], behind])[:REACH]
        return np.concatenate([np.zeros((0, shape.frame)), *stretches[::-1]]), np.array(borders[::-1])

    def substituted(self, number: int, behind: Array, border: Array) -> Array:
        """Solve for the steps ``(T, w)`` of a stretch given the two frames after it ``(2, w)`` and its border."""
        (conditionals, d), shape = self._conditionals[number], self.shape
        steps = d.copy()
        if self._kernels is not None:
            behind = np.ascontiguousarray(behind)
            self._kernels.substitute_stretch(conditionals, shape.far, shape.tied, self._extra, behind, border, steps)
        else:
            self._substitute_purely(conditionals, behind, border, steps)
        return steps

    def _substitute_purely(self, conditionals: Array, behind: Array, border: Array, steps: Array) -> None:
        later_steps = behind
        for t in range(len(steps) - 1, -1, -1):
            ahead = np.concatenate([later_steps[0], later_steps[1, self.shape.far]])[: self.shape.ahead]
            steps[t] = Conditional(conditionals[t], steps[t]).given(np.concatenate([ahead, border]))
            later_steps = np.stack([steps[t], later_steps[0]])

    def marginals(self, border: Array) -> Iterator[tuple[Array | None, Array]]:
        """Yield marginal covariances backwards from the last border's ``(s, s)``: of each frame ``(w, w)`` and of its
        border; at a step of the border None and the covariance of the border before it.
        """
        ahead, rest = self.shape.ahead, self.shape.rest
        joint = np.zeros((rest, rest))  # next frame, far columns of the one after it, border
        joint[ahead:, ahead:] = border
        for number in range(len(self._conditionals) - 1, -1, -1):
            if number in self._steps:
                columns, step = self._steps[number]
                places = ahead + columns
                covariance, across = step.covariance(joint)
                joint[places], joint[:, places] = across, across.T
                joint[np.ix_(places, places)] = covariance
                yield None, joint[ahead:, ahead:]
            for covariance in self.covariances(number, joint):
                yield covariance, joint[ahead:, ahead:]

    def covariances(self, number: int, joint: Array) -> Iterator[Array]:
        """Yield the marginal covariances of a stretch's frames backwards.

        Args:
            number: of the stretch.
            joint: covariance of the next frame, the far columns of the one after it, and the border; updated in place.
        """
        shape, w, ahead = self.shape, self.shape.frame, self.shape.ahead
        for rows, d in zip(*(arrays[::-1] for arrays in self._conditionals[number]), strict=True):
            covariance, across = Conditional(rows, d).covariance(joint)
            yield covariance
            if shape.tied:
                next_frame, rest_columns = slice(w, ahead), slice(ahead, None)
                joint[next_frame, next_frame], joint[next_frame, rest_columns] = (
                    joint[np.ix_(shape.far, shape.far)],
                    joint[shape.far, ahead:],
                )
                joint[:w, :w], joint[:w, next_frame], joint[:w, rest_columns] = (
                    covariance,
                    across[:, shape.far],
                    across[:, ahead:],
                )
                joint[next_frame, :w], joint[rest_columns, :ahead] = (
                    joint[:w, next_frame].T,
                    joint[:ahead, rest_columns].T,
                )


@dataclass(frozen=True)
class Multipliers:
    """Lagrange multipliers of rows ``A x = b`` that connect distant frames: the last columns of a border.

    The maximum over ``λ`` of ``λᵀ(A x − b) − ½ λᵀλ`` is ``½ |A x − b|²``, so each row becomes a border column with
    information −1. The multipliers are eliminated before the other columns of the border.

    Attributes:
        coupling, inverse, vector: ``B``, ``C⁻¹`` and ``v`` in ``½ xᵀ S x + xᵀ B λ − ½ λᵀ C λ − vᵀ λ``.
    """

    coupling: Array
    inverse: Array
    vector: Array

    @classmethod
    def eliminated(cls, information: Array, vector: Array, start: int) -> tuple["Multipliers", Array, Array]:
        """Eliminate the multipliers from column ``start`` on; also returns the remaining information and vector."""
        corner, B = information[start:, start:], information[:start, start:]
        multipliers = cls(
            B, np.array(np.linalg.inv(-np.triu(corner) - np.triu(corner, 1).T), dtype=float), vector[start:]
        )
        half = B @ multipliers.inverse
        return multipliers, np.triu(information[:start, :start] + half @ B.T), vector[:start] + half @ vector[start:]

    def given(self, border: Array) -> Array:
        """Return the values of the whole border given those before the multipliers."""
        return np.concatenate([border, self.inverse @ (self.coupling.T @ border - self.vector)])

    def covariance(self, border: Array) -> Array:
        """Return the formal covariance of the whole border given that of the columns before the multipliers."""
        half = self.coupling @ self.inverse
        return np.block([[border, border @ half], [half.T @ border, half.T @ border @ half - self.inverse]])


def inverse_of_square(R: Array) -> Array:
    """Inverse of ``Rᵀ R`` from ``R``; inverting the product loses twice the digits."""
    inverse = solve_triangular(R, np.eye(len(R)), check_finite=False) if len(R) else R
    return np.asarray(inverse @ inverse.T, dtype=float)
